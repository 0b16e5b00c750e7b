"""Tables for the terminal, for pipes and for Markdown, and files with results."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from rsdeblur.cli._output import print_table

__all__ = ["markdown", "print_table", "report", "write"]


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; the first column is text, the others are numbers."""
    rule = ["---", *("---:" for _ in columns[1:])]
    return "\n".join("| " + " | ".join(row) + " |" for row in (columns, rule, *rows))


def report(text: str, path: Path | None) -> None:
    """Print the tables of a benchmark, and write them to a file if one is given."""
    print(text)
    if path is not None:
        write(path, text)


def write(path: Path, text: str) -> None:
    """Write a file and create its folders: a missing folder must not cost the result of a long run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + "\n")
