"""Clipped highlights on the command line: a few are separated by default."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from rsdeblur.io import read_picture

if TYPE_CHECKING:
    from conftest import Files

    Run = Callable[..., Result]

WIDTH, HEIGHT = 96, 72


@pytest.mark.parametrize(
    ("side", "options", "separated"),
    [
        (0, (), False),
        (3, (), True),
        (3, ("--max-memory", "1GiB"), False),
        (3, ("--saturation", "ignore"), False),
        # 2.1 % are many, so they are left unless that is asked for.
        (12, (), False),
        (12, ("--saturation", "always"), True),
    ],
)
def test_few_highlights_are_separated(
    run: Run, files: Files, tmp_path: Path, side: int, options: tuple[str, ...], separated: bool
) -> None:
    pixels = np.minimum(read_picture(files.photo).pixels, 200)
    pixels[30 : 30 + side, 40 : 40 + side] = 255
    photo = tmp_path / "photo.png"
    Image.fromarray(pixels).save(photo)
    call = "deblur", photo, *files.recording, "--no-refine", "--force", *options, "-o", tmp_path / "sharp.png"
    assert ("highlights" in json.loads(run(*call, "--json").stdout)["timings"]) == separated


def test_saturation_reaches_the_solver(run, files, tmp_path):
    pixels = np.full((HEIGHT, WIDTH, 3), 20, dtype=np.uint8)
    pixels[30:34, 40:52] = 255
    Image.fromarray(pixels).save(files.photo)
    common = [files.photo, *files.recording, "--quality", "fast", "--nsr", 0.01, "--saturation"]
    plain, bounded, compared = tmp_path / "plain.png", tmp_path / "bounded.png", tmp_path / "compared"
    for word, name in (("ignore", "without.png"), ("always", plain.name)):
        assert run("deblur", *common, word, "-o", tmp_path / name).exit_code == 0
    assert run("deblur", *common, "always", "--max-memory", "1GiB", "-o", bounded).exit_code == 0
    assert run("compare", *common, "always", "--mode", "banded", "-o", compared).exit_code == 0
    results = plain, bounded, compared / "banded.png", tmp_path / "without.png"
    separated, *same, ignored = (read_picture(path).pixels for path in results)
    assert (separated != ignored).any()
    for other in same:
        np.testing.assert_array_equal(other, separated)
