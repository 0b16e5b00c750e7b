"""Tables for the terminal, for pipes and for Markdown, and files with results."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rsdeblur.cli._output import print_table

__all__ = ["append", "markdown", "print_table", "recorded", "report", "write"]


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; the first column is text, the others are numbers."""
    rule = ["---", *("---:" for _ in columns[1:])]
    return "\n".join("| " + " | ".join(row) + " |" for row in (columns, rule, *rows))


def report(text: str, path: Path | None) -> None:
    """Print the tables of a benchmark, and write them to a file if one is given."""
    print(text)
    if path is not None:
        write(path, text)


def recorded(path: Path | None) -> list[dict[str, Any]]:
    """Return the records of a file (JSON lines); none if there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path and path.exists() else []


def append(path: Path | None, record: dict[str, Any]) -> None:
    """Append a record to a file, if one is given, so that an interrupted run can be continued."""
    if path is not None:
        with path.open("a") as file:
            file.write(json.dumps(record) + "\n")


def write(path: Path, text: str) -> None:
    """Write a file and create its folders: a missing folder must not cost the result of a long run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text + "\n")
