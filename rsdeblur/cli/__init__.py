"""The command line: one module per command, imported when the command is used.

Command modules take the rest of the package from `_engine`, which imports a part at its first use, so that
``rsdeblur --help`` answers at once.
"""

import _thread
import errno
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from itertools import chain
from types import FrameType
from typing import Any, NoReturn

import click

from rsdeblur.cli._output import capture_warnings, level, linked, printable, say_aside, tolerate_output
from rsdeblur.errors import RsdeblurError

# The sections of the help, the most important commands first.
GROUPS = {
    "Start": ("deblur", "app", "demo"),
    "Many pictures": ("batch", "video", "burst"),
    "Set up": ("camera", "calibrate", "sync", "info"),
    "Study": ("compare", "psf", "simulate", "triage"),
}
COMMANDS = tuple(chain.from_iterable(GROUPS.values()))
# Time until an interrupt that came while a kernel was compiled is delivered again, s.
RETRY = 0.02


class Interrupt(KeyboardInterrupt):
    """An interrupt by a signal, whose number is the argument.

    Of its own class: where a KeyboardInterrupt itself passes code that C runs, Python ends with SIGINT even if it is
    caught.
    """


class Commands(click.Group):
    """Group that loads commands by name, and reports every refusal as one line and an exit code."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands, the most important ones first."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command."""
        return _command(cmd_name) if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands in groups."""
        width = max(map(len, COMMANDS))
        for title, names in GROUPS.items():
            helps = (_command(name).get_short_help_str(formatter.width - width - 6) for name in names)
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), text) for name, text in zip(names, helps, strict=True)])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; exit with 1 for refused input and 128 plus the signal's number when interrupted."""
        tolerate_output()
        with ending_signals(), capture_warnings(show=_once()):
            try:
                return super().invoke(ctx)
            except RsdeblurError as error:
                _refuse(ctx, str(error))
            except click.exceptions.NoArgsIsHelpError:
                raise  # it is the help of a group of commands
            except click.UsageError as error:
                # The message may quote the names of files; click's own may have several lines.
                lines = error.format_message().expandtabs().split("\n")
                raise click.UsageError(linked("\n".join(map(printable, lines))), ctx=error.ctx) from error
            except MemoryError:
                _refuse(ctx, "not enough memory; close other programs, set --max-memory, or use a smaller picture")
            except OSError as error:
                # It is no error if the reader of a pipe closes it early; click then exits without a message.
                if error.errno == errno.EPIPE:
                    raise
                # Only the stream that the result is printed to has no name.
                _refuse(ctx, f"{error.filename or 'the output'}: {error.strerror or error}")
            except (KeyboardInterrupt, ImportError) as error:
                number = _signal_of(error)
                if number is None:
                    _refuse(ctx, f"a library cannot be loaded ({error}); free memory, or install rsdeblur again")
                say_aside("interrupted; no unfinished file is left")
                ctx.exit(128 + number)  # as shells report it


def _command(name: str) -> click.Command:
    command: click.Command = import_module(f"rsdeblur.cli.{name}").command
    return command


def _signal_of(error: BaseException | None) -> int | None:
    """Return the signal that caused an error; while a compiled module loads, an interrupt becomes an ImportError."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    if error is None:
        return None
    return error.args[0] if error.args else signal.SIGINT


@contextmanager
def ending_signals() -> Iterator[None]:
    """Let Ctrl-C, `kill` and a terminal that closes raise KeyboardInterrupt, unless the caller handles them."""
    # Windows has no SIGHUP.
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    usual = (signal.SIG_DFL, signal.default_int_handler)
    before = {number: handler for number in numbers if (handler := signal.getsignal(number)) in usual}
    try:
        for number in before:
            signal.signal(number, _interrupt)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    while frame is not None:
        # An exception in these compilers leaves their locks locked, and threads that wait for them never end.
        if str(frame.f_globals.get("__name__")).partition(".")[0] in ("numba", "llvmlite"):
            # A Thread would take locks of its own, which may be the interrupted ones.
            _thread.start_new_thread(_send_again, (number,))
            return
        frame = frame.f_back
    raise Interrupt(number)


def _send_again(number: int) -> None:
    time.sleep(RETRY)
    os.kill(os.getpid(), number)


def _refuse(ctx: click.Context, message: str) -> NoReturn:
    say_aside(f"error: {message}")
    ctx.exit(1)


def _once() -> Callable[[str], None]:
    """Return a function that shows a warning in one line, unless one with other numbers was shown."""
    shown: set[str] = set()

    def show(message: str) -> None:
        kind = re.sub(r"[\d.]+", "", message)
        if level() >= 0 and kind not in shown:
            say_aside(f"warning: {message}")
        shown.add(kind)

    return show


EXAMPLES = """\b
Examples:
  rsdeblur demo
  rsdeblur deblur photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20
"""


@click.group(cls=Commands, epilog=EXAMPLES, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="rsdeblur", message="%(prog)s %(version)s")
def main() -> None:
    """Deblur photos with the gyroscope log of the camera that took them.

    Each row of a rolling-shutter picture has its own exposure window, and therefore its own blur. rsdeblur computes
    the blur from the log and removes it.

    Exit codes: 0 done, 1 input refused, 2 wrong usage, 3 some of several photos failed, 130 interrupted (SIGTERM
    143, SIGHUP 129).
    """


# click suggests these names for an unknown one; `get_command` imports them.
main.commands.update(dict.fromkeys(COMMANDS, main))
