"""The demo refuses sizes before it writes anything."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from rsdeblur.cli import demo

Run = Callable[..., Result]


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--size", "63x64"], "--size 63x64: the sides must be at least 64 px"),
        (["--size", "65x4000"], "--size 65x4000: the simulated blur is larger"),
        (["--size", "4000x65"], "use a shape nearer to 4:3"),
        (["--size", "64x9000", "--recording"], "use a shape nearer to 4:3"),
        (["--size", "100000x1000"], "use a smaller size"),
        (["--size", "321x240", "--video"], "the sides of a video must be even"),
    ],
)
def test_a_size_is_refused_before_anything_is_written(
    run: Run, tmp_path: Path, arguments: list[str], problem: str
) -> None:
    out = tmp_path / "demo"
    result = run("demo", *arguments, "-o", out)
    assert result.exit_code == 2
    assert problem in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("session", [None, "recording", "video", "stock-camera"])
@pytest.mark.parametrize("size", [(64, 64), (1024, 768), (768, 1024), (1600, 1200), (160, 320)])
def test_usual_sizes_are_taken(size: tuple[int, int], session: str | None) -> None:
    for seed in range(3):
        demo._check_size(size, seed, session)
