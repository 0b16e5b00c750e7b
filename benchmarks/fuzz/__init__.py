"""Hostile input for every reader: ``python -m benchmarks.fuzz``.

`seeds` makes small valid files of every format, `mutate` damages them, `targets` defines what reads them and what must
hold afterwards, and `__main__` runs the requested number and reports.
"""
