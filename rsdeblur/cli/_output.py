"""Output of the commands: lines, JSON, tables, progress bars, folders.

No other module of the command line prints, so that nothing reaches the terminal that it would interpret. `schema.toml`
lists the stable keys of JSON.
"""

from __future__ import annotations

import io
import json
import logging
import re
import sys
import unicodedata
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.files import atomic_write, check_target, file_state
from rsdeblur.cli import _engine as rs
from rsdeblur.errors import InputError, OutputError, RsdeblurWarning

# Raised when a stable key of JSON is removed or changes its meaning.
SCHEMA = 1
# Key of the context's `meta` under which the level of detail is: -1 quiet, 1 verbose.
LEVEL = "rsdeblur.level"
# The inputs and the stages of the work, which a verbose command prints.
LOG = logging.getLogger("rsdeblur")
COMPILING = "compiling what this command needs, once after the installation, which may take a minute"
# Pages of the documentation that help with messages, by what these contain.
PAGES = {
    r"give --readout-time|readout time is unknown": "readout-times",
    r"\baxes\b|imu_to_camera|--imu\b": "camera-file",
    r"--gyro('|( and --camera)? missing)|as --gyro$|unknown gyro log format|no gyro (data|samples)": "formats",
}


def level() -> int:
    """Return how much the command prints: -1 errors only, 0 results and warnings, 1 also inputs and stages."""
    context = click.get_current_context(silent=True)
    return 0 if context is None else int(context.meta.get(LEVEL, 0))


def printable(text: object) -> str:
    """Return a text whose control characters, line breaks and bytes are escaped: a terminal would interpret them."""
    return "".join(
        character if character.isprintable() or unicodedata.category(character) == "Zs" else ascii(character)[1:-1]
        for character in str(text)
    )


def say(*lines: object) -> None:
    """Print lines, unless the command is quiet."""
    if level() >= 0:
        for line in lines:
            click.echo(printable(line))


def say_aside(line: object) -> None:
    """Print one line on stderr: an error, a warning, a remark."""
    click.echo("rsdeblur: " + printable(linked(" ".join(str(line).split()))), err=True)


def linked(message: str) -> str:
    """Return a message with the page of the documentation that helps, once for each page and command."""
    context = click.get_current_context(silent=True)
    shown: set[str] = set() if context is None else context.meta.setdefault("rsdeblur.pages", set())
    page = next((page for pattern, page in PAGES.items() if re.search(pattern, message)), None)
    if page is None or page in shown:
        return message
    shown.add(page)
    return f"{message.rstrip('.')}; see docs/{page}.md"


def reason(error: Exception, file: object = "") -> str:
    """Return the message of an error, which begins with the name of a file unless it contains it."""
    message = str(error)
    if isinstance(error, OSError) and error.filename is not None:
        message = f"{error.filename}: {error.strerror}"
    return message if str(file) in message else f"{file}: {message}"


@contextmanager
def usage_as_input_error() -> Iterator[None]:
    """Turn wrong usage into an `InputError`, for the page and for workers, which have no usage to show."""
    try:
        yield
    except click.ClickException as error:
        raise InputError(error.format_message()) from error


@contextmanager
def capture_warnings(*, show: Callable[[str], None] | bool = True) -> Iterator[list[str]]:
    """Collect the texts of the package's warnings; all are shown as before, by a function, or (False) not at all."""
    texts: list[str] = []
    before = warnings.showwarning

    def collect(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        text = str(message)
        if not issubclass(category, RsdeblurWarning):
            text = text.partition("\n")[0]  # a library may add a traceback
        elif text not in texts:
            texts.append(text)
        if show is True:
            before(message, category, *place, **more)
        elif show:
            show(text)

    with warnings.catch_warnings():
        warnings.simplefilter("always", RsdeblurWarning)
        warnings.showwarning = collect
        yield texts


def warn(message: str) -> None:
    """Warn as the package does."""
    warnings.warn(message, RsdeblurWarning, stacklevel=2)


class _Lines(logging.Handler):
    """Prints what is logged on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one line."""
        say_aside(record.getMessage())


def be_verbose(context: click.Context) -> None:
    """Print what is logged, until the command ends."""
    handler, before = _Lines(), LOG.level
    LOG.addHandler(handler)
    LOG.setLevel(logging.DEBUG)
    context.call_on_close(lambda: LOG.removeHandler(handler))
    context.call_on_close(lambda: LOG.setLevel(before))


def tolerate_output() -> None:
    """Escape characters that the encoding of stdout lacks from now on; stderr does so anyway."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def refuse_inputs(output: Path) -> None:
    """Refuse an output that is one of the files which the command reads, under any name."""
    context, state = click.get_current_context(silent=True), file_state(output)
    if context is None or state is None or not output.is_file():
        return
    for value in context.params.values():
        for path in value if isinstance(value, tuple) else (value,):
            if isinstance(path, Path) and path is not output and file_state(path) == state:
                raise OutputError(f"{output}: the result would replace an input; give it another name")


def prepare_folder(folder: Path, names: Iterable[str], *, force: bool, dry_run: bool = False) -> None:
    """Make `folder` if needed, but not in a dry run, and check that files called `names` may be written into it."""
    if not folder.is_dir() and (folder.exists() or folder.suffix.lower() in rs.KINDS):
        raise OutputError(f"{folder}: the results are several files, so the output is a folder; give the name of one")
    if dry_run and not folder.exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        check_output(folder / name, force=force)


def check_output(path: Path, *, force: bool, suffixes: Sequence[str] = (), kind: str = "") -> None:
    """Check before the work that a file can be written."""
    if suffixes and path.suffix.lower() not in suffixes:
        raise OutputError(f"{path}: {kind}; give it a name that ends in {suffixes[0]}")
    refuse_inputs(path)
    check_target(path, force=force)


def _json(facts: Mapping[str, Any]) -> str:
    return json.dumps({"schema": SCHEMA} | dict(facts), indent=2)


def print_json(facts: Mapping[str, Any]) -> None:
    """Print facts as JSON."""
    click.echo(_json(facts))


def write_json(path: Path, facts: Mapping[str, Any]) -> None:
    """Write facts as JSON, atomically."""
    with atomic_write(path) as file:
        file.write(f"{_json(facts)}\n".encode())


def print_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table; the first column is aligned left, the others right. A quiet command prints none."""
    lines = [[printable(cell) for cell in row] for row in (columns, *rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for first, *rest in lines:
        cells = (cell.rjust(width) for cell, width in zip(rest, widths[1:], strict=True))
        say("  ".join([first.ljust(widths[0]), *cells]).rstrip())


def compiling() -> AbstractContextManager[Callable[[], float]]:
    """Return a context that says, once for each command, that functions are compiled."""
    context = click.get_current_context(silent=True)
    meta = {} if context is None else context.meta

    def begin() -> None:
        if not meta.get(COMPILING):
            say_aside(COMPILING)
        meta[COMPILING] = True

    return rs.compilation() if level() < 0 else rs.compilation(begin)


@contextmanager
def progress(title: str) -> Iterator[rs.Progress]:
    """Yield the function that moves a progress bar, which is shown if stderr is a terminal."""
    # There is no stream if it was closed before the start (2>&-).
    if level() or sys.stderr is None or not sys.stderr.isatty():
        with compiling():
            yield lambda stage, fraction: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    task = TextColumn("{task.description}", markup=False)
    columns = (task, BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with compiling(), Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        bar.add_task(title, total=None)

        def move(stage: str, fraction: float) -> None:
            # A smaller fraction starts another stage, whose remaining time is estimated again.
            shown = bar.tasks[0]
            if fraction < shown.completed:
                bar.reset(shown.id)
            bar.update(shown.id, description=f"{title}: {stage}", total=1.0, completed=fraction)

        yield move
