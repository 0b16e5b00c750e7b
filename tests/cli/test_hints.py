"""Times in another unit, or counted from another moment, get a question that names what was probably meant."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import Result

from rsdeblur import GyroLog
from rsdeblur.cli._hints import refuse_longer, start_hint
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]

FAST = ("--mode", "global", "--prior", "wiener", "--nsr", "0.01", "--no-refine")


@pytest.mark.parametrize(
    ("start", "option"),
    [
        (250.0, "--start 250ms"),
        (250_000.0, "--start 250000us"),
        (250_000_000.0, "--start-ns 250000000"),
        (0.25, None),  # it lies in the log
        (0.7, None),  # just after its end
        (4.0, None),
        (-0.2, None),
    ],
)
def test_starts_in_other_units(start: float, option: str | None) -> None:
    log = GyroLog(np.linspace(0.0, 0.6, 121), np.zeros((121, 3)))
    assert start_hint(start, None, log) == ("" if option is None else f"; did you mean {option}?")


def test_a_start_counted_from_the_first_sample() -> None:
    log = GyroLog(np.linspace(0.0, 0.6, 121), np.zeros((121, 3)), 1_560_000_000_000)
    assert start_hint(0.25, None, log) == "; did you mean --start 1560.25, as the log begins at 1560 s?"
    assert start_hint(1560.25, None, log) == ""
    # Unix time, as of Sensor Logger.
    late = GyroLog(np.linspace(0.0, 0.6, 121), np.zeros((121, 3)), 1_700_000_000_000_000_000)
    assert start_hint(0.25, None, late) == "; did you mean --start 1700000000.25, as the log begins at 1700000000 s?"
    # The start in ms, which lies far after the end.
    assert start_hint(1_560_250.0, None, log) == "; did you mean --start 1560250ms?"


def test_timestamps_in_other_units() -> None:
    log = GyroLog(np.linspace(0.0, 0.6, 121), np.zeros((121, 3)), 1_560_000_000_000)
    for timestamp in (1_560, 1_560_250, 1_560_250_000):
        meant = 1_560_250_000_000 if timestamp > 1_560 else 1_560_000_000_000
        assert start_hint(0.0, timestamp, log) == f"; did you mean --start-ns {meant}?"
    assert start_hint(0.0, 1_560_250_000_000, log) == ""
    assert start_hint(0.0, 5, log) == ""


def test_a_clip_that_starts_at_zero() -> None:
    log = GyroLog(np.linspace(0.0, 0.6, 121), np.zeros((121, 3)), 1_560_000_000_000)
    assert start_hint(0.0, None, log) == "; did you mean --start 1560, as the log begins at 1560 s?"


@pytest.mark.parametrize(
    ("seconds", "hint"),
    [
        (50.0, "did you mean 50ms or 1/50?"),
        (5_000.0, "did you mean 1/5000 or 5000us?"),
        (50_000_000.0, "did you mean 0.05 (50000000 ns)?"),
        (0.7, "give a longer recording"),
        (1e12, "give a longer recording"),
    ],
)
def test_exposures_longer_than_the_log(seconds: float, hint: str) -> None:
    with pytest.raises(InputError, match=rf"is longer than log\.csv \(0\.6 s\); {re.escape(hint)}"):
        refuse_longer(seconds, 0.6, Path("log.csv"))
    refuse_longer(seconds, 1e13, Path("log.csv"))
    refuse_longer(None, 0.01, Path("log.csv"))


def test_commands_ask(run: Run, files: Files, tmp_path: Path) -> None:
    call = ("deblur", files.photo, *files.sources, "--duration", "1/25", *FAST, "-o", tmp_path / "o.png")
    result = run(*call, "--start", "200")
    assert (result.exit_code, "did you mean --start 200ms?" in result.stderr) == (1, True)
    for option, value in (("--start", "1e300"), ("--start-ns", 2**70)):
        result = run(*call, option, value)
        assert result.exit_code == 2
        assert f"Error: {option} must be" in result.stderr


@pytest.mark.parametrize("option", ["focal-length", "weight", "transfer", "rate", "readout-time", "depth", "softness"])
@pytest.mark.parametrize("value", ["nan", "inf", "1e400", "-inf"])
def test_numbers_are_finite(run: Run, files: Files, tmp_path: Path, option: str, value: str) -> None:
    call = ("deblur", files.photo, *files.recording, "--translation", files.gyro, "-o", tmp_path / "o.png")
    result = run(*call, f"--{option}", value)
    assert result.exit_code == 2
    assert f"Invalid value for '--{option}'" in result.stderr
