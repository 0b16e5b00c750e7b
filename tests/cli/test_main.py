"""The command line as a whole: help, lazy imports, exit codes."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numba
import pytest
from click.testing import CliRunner, Result

from rsdeblur.cli import COMMANDS, RETRY, ending_signals, main
from rsdeblur.cli._options import Recording
from rsdeblur.cli._output import progress
from rsdeblur.pipeline.options import Options

if TYPE_CHECKING:
    from conftest import Files

HEAVY = ("numpy", "scipy", "numba", "pyfftw", "skimage", "PIL", "rich")


def import_error_of(cause: BaseException) -> ImportError:
    """Return the error of a compiled module whose import another error interrupts."""
    error = ImportError("initialization failed")
    error.__cause__ = cause
    return error


def test_help_imports_nothing_heavy() -> None:
    program = (
        "import sys\n"
        "from rsdeblur.cli import COMMANDS, main\n"
        "for name in ([], *([name] for name in COMMANDS)):\n"
        "    main([*name, '--help'], standalone_mode=False)\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-P", "-c", program], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"
    assert done.stdout.count("Usage: ") == 1 + len(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_has_examples(name: str) -> None:
    result = CliRunner().invoke(main, [name, "--help"])
    assert result.exit_code == 0
    assert f"Examples:\n    rsdeblur {name} " in result.stdout


def test_options_are_made_of_the_table() -> None:
    """Each field with a help text is an option of the command that deblurs a photo, with its text and section."""
    assert len(CliRunner().invoke(main, ["deblur", "--help"]).stdout.splitlines()) <= 30
    text = " ".join(CliRunner().invoke(main, ["deblur", "--help-all"], terminal_width=10_000).stdout.split())
    for each in (*fields(Options), *fields(Recording)):
        if each.metadata.get("help") and each.name != "numbered_from":
            assert f"--{each.name.replace('_', '-')} " in text
            assert " ".join(each.metadata["help"].split()) in text or each.name == "refine"


def test_quiet_and_verbose(files: Files, run: Callable[..., Result], caplog: pytest.LogCaptureFixture) -> None:
    arguments = ["deblur", str(files.photo), *files.recording, "--quality", "fast"]
    with caplog.at_level("DEBUG", "rsdeblur"):
        quiet = run(*arguments, "-o", str(files.photo.with_name("a.png")), "-q")
    assert quiet.output == ""
    assert "stage apply: " in caplog.text
    verbose = run(*arguments, "-o", str(files.photo.with_name("b.png")), "-v")
    for text in ("rsdeblur: log: plain", "rsdeblur: exposure: 0 ns + 0.200000 s, 40 ms", "rsdeblur: stage apply"):
        assert text in verbose.stderr
    assert len(verbose.stdout.splitlines()) >= 1


@pytest.mark.parametrize(
    ("raised", "code", "message"),
    [
        (KeyboardInterrupt(), 130, "rsdeblur: interrupted"),
        (import_error_of(KeyboardInterrupt()), 130, "rsdeblur: interrupted"),
        (MemoryError(), 1, "rsdeblur: error: not enough memory"),
        (PermissionError(13, "Permission denied", "a.png"), 1, "rsdeblur: error: a.png: Permission denied"),
    ],
)
def test_no_traceback(
    monkeypatch: pytest.MonkeyPatch, tmp_path: object, raised: BaseException, code: int, message: str
) -> None:
    def fail(_: object) -> None:
        raise raised

    monkeypatch.setattr("rsdeblur.report.facts.read_picture", fail)
    picture = f"{tmp_path}/a.png"
    with open(picture, "wb"):
        result = CliRunner().invoke(main, ["info", picture])
    assert result.exit_code == code
    assert result.stderr.startswith(message)
    assert len(result.stderr.splitlines()) == 1


def test_compilation_is_announced_once(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("work"):
        for function in (lambda x: x + 1, lambda x: x + 2):
            numba.njit(function)(1)
    assert capsys.readouterr().err.count("compiling") == 1


def test_a_compiler_is_not_interrupted() -> None:
    """An exception would leave its locks locked; the interrupt comes when it has ended."""
    compiler: dict[str, Any] = {"__name__": "numba.core", "signal": signal, "time": time, "done": False}
    exec(
        "def compile(wait):\n  signal.raise_signal(signal.SIGTERM)\n  time.sleep(wait)\n  global done\n  done = True",
        compiler,
    )

    def work() -> None:
        with ending_signals():
            compiler["compile"](3 * RETRY)
            time.sleep(30)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        work()
    assert compiler["done"]
    assert signal.getsignal(signal.SIGTERM) is before
