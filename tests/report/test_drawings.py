"""Drawings: each part is shown, and at its place."""

from __future__ import annotations

from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, triage
from rsdeblur.errors import InputError
from rsdeblur.psf import PsfBank
from rsdeblur.report import psf_map, side_by_side
from rsdeblur.report.drawings import LONG_SIDE, TITLE
from rsdeblur.report.timeline import timeline_svg


def bank(bands: int, strips: int, size: tuple[int, int] = (9, 15)) -> PsfBank:
    """Return kernels that are bars along x, at the tile centres of a picture of 120x160."""
    kernels = np.zeros((bands, strips, *size), np.float32)
    kernels[:, :, size[0] // 2, 1:-1] = 1.0 / (size[1] - 2)
    return PsfBank.for_picture(kernels, (120, 160))


@pytest.mark.parametrize(("bands", "strips"), [(1, 1), (5, 8), (16, 1), (64, 8)])
def test_psf_map_draws_within_its_cells(bands: int, strips: int) -> None:
    drawing = psf_map(bank(bands, strips), (120, 160))
    height = LONG_SIDE * 120 // 160
    assert drawing.shape == (height + TITLE, LONG_SIDE, 3)
    assert drawing.dtype == np.float32
    assert drawing.min() >= 0.0
    assert drawing.max() <= 1.0
    red = drawing[:height, :, 0] > 0.6
    # Each strip's kernel leaves the borders of its cell free, so kernels never touch.
    borders = np.linspace(0, LONG_SIDE, strips + 1).round().astype(int)
    assert not red[:, np.clip(borders, 0, LONG_SIDE - 1)].any()
    for left, right in pairwise(borders):
        assert red[:, left:right].any()


def test_psf_map_dims_the_picture_below() -> None:
    drawing = psf_map(bank(1, 1), (120, 160), picture=np.ones((120, 160), np.float32))
    assert 0.2 < drawing[5, 5].mean() < 0.5
    with pytest.raises(InputError, match="shape"):
        psf_map(bank(1, 1), (120, 160), picture=np.ones((120, 161), np.float32))


def test_side_by_side_shows_each_picture_in_its_column() -> None:
    grey = np.full((60, 80), 0.25, np.float32)
    sheet = side_by_side({"dark": grey, "light": np.dstack([grey * 3] * 3)})
    assert sheet.ndim == 3
    half = sheet.shape[1] // 2
    assert np.median(sheet[100:400, 100 : half - 100]) == pytest.approx(0.25, abs=1 / 255)
    assert np.median(sheet[100:400, half + 100 : -100]) == pytest.approx(0.75, abs=1 / 255)


def test_side_by_side_refuses_unlike_sizes_and_shapes() -> None:
    with pytest.raises(InputError, match="'b' has 80x61 px"):
        side_by_side({"a": np.zeros((60, 80), np.float32), "b": np.zeros((61, 80), np.float32)})
    with pytest.raises(InputError, match="shape"):
        side_by_side({"a": np.zeros(5, np.float32)})


def test_the_timeline_has_a_dot_for_each_exposure() -> None:
    exposures = [Exposure(0.2, 0.01), Exposure(1.2, 0.1), Exposure(5.0, 0.1)]
    t, camera = np.arange(0.0, 2.0, 0.005), Camera(160, 120, 400.0)
    # A turn of 1 rad/s about the y axis until 1 s, then rest.
    log = GyroLog(t, np.where(t < 1.0, 1.0, 0.0)[:, None] * [0.0, 1.0, 0.0])
    root = ElementTree.fromstring(timeline_svg([0.0, 1.0, None], triage(log, camera, exposures)))
    dots = [dot for dot in root.iter() if dot.tag.endswith("circle") and dot.get("r") == "2.5"]
    assert len(dots) == 2
    assert float(dots[0].get("cx")) < float(dots[1].get("cx"))
    # Higher is more.
    assert float(dots[0].get("cy")) < float(dots[1].get("cy"))
    # Nothing to draw is no error.
    ElementTree.fromstring(timeline_svg([], triage(log, camera, [])))
