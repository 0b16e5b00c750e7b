"""Hostile input for every reader: ``python -m benchmarks.fuzz``.

`seeds` makes small valid files of every format, `mutate` spoils them, `targets` says what reads them and what must hold
afterwards, and `__main__` runs as many as are asked for and reports.
"""
