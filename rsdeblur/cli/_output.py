"""Output of the commands: folders, JSON, tables and progress bars."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.errors import OutputError

if TYPE_CHECKING:
    from rsdeblur.types import Progress


def prepare_folder(folder: Path, names: Iterable[str], *, force: bool) -> None:
    """Make `folder` if needed and check that the files called `names` may be written into it.

    Raises
    ------
    OutputError
        If the folder cannot be made, or a file cannot be written, or exists and `force` is not set.
    """
    from rsdeblur._util.atomic import check_target

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot make the folder: {error.strerror or error}") from error
    for name in names:
        check_target(folder / name, force=force)


def print_json(payload: Any) -> None:
    """Print `payload` as JSON."""
    click.echo(json.dumps(payload, indent=2))


def write_json(path: Path, payload: Any) -> None:
    """Write `payload` as JSON, atomically."""
    from rsdeblur._util.atomic import atomic_write

    with atomic_write(path) as file:
        file.write((json.dumps(payload, indent=2) + "\n").encode())


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table; the first column is aligned left, the others right."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="right" if i else "left", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    # A pipe has no width, and 80 columns, the default, would cut the table.
    Console(file=sys.stdout, width=None if sys.stdout.isatty() else 200).print(table)


@contextmanager
def progress(title: str) -> Iterator[Progress | None]:
    """Show a progress bar on a terminal; yield the function that moves it, or None if stderr is not a terminal.

    Until its first move, the bar shows activity only.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)

        def move(stage: str, fraction: float) -> None:
            # A smaller fraction starts another stage, whose remaining time is estimated again.
            if fraction < bar.tasks[0].completed:
                bar.reset(task)
            bar.update(task, description=f"{title}: {stage}", total=1.0, completed=fraction)

        yield move
