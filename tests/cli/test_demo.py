"""The demo refuses sizes before it writes anything, and its logs are those of the apps that it plays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rsdeblur.io import open_gyro

Run = Callable[..., Result]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--size", "63x64"], "--size 63x64: the sides must be at least 64 px"),
        (["--size", "100000x1000"], "a scene has at most"),
        (["--size", "321x240", "--video"], "the sides of a video must be even"),
    ],
)
def test_a_size_is_refused_before_anything_is_written(
    run: Run, tmp_path: Path, arguments: list[str], problem: str
) -> None:
    out = tmp_path / "demo"
    result = run("demo", *arguments, "-o", out)
    assert result.exit_code in (1, 2)
    assert problem in result.stderr
    assert not out.exists()


@pytest.mark.parametrize(
    ("session", "name", "format"),
    [("stock-camera", "Gyroscope.csv", "sensorlogger"), ("recording", "gyro_accel.csv", "mars")],
)
def test_the_log_is_that_of_the_app(run: Run, tmp_path: Path, session: str, name: str, format: str) -> None:
    assert run("demo", f"--{session}", "--size", "64x64", "-o", tmp_path).exit_code == 0
    file = open_gyro(tmp_path / name)
    assert (file.format, file.axes) == (format, "phone")
    assert np.abs(file.log.omega).max() > 0.01
