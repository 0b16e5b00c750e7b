"""Laws of the exposure: times of each row, for the four readout directions."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.choices import READOUT_DIRECTIONS
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure

EXPOSURE = Exposure(2.0, 0.01)


def camera_of(direction, readout_time=0.03):
    return Camera(60, 40, 50.0, readout_time=readout_time, readout_direction=direction)


@pytest.mark.parametrize(
    ("direction", "first", "last"),
    [("top-down", 0, 39), ("bottom-up", 39, 0), ("left-right", 0, 59), ("right-left", 59, 0)],
)
def test_first_and_last_line(direction, first, last):
    camera = camera_of(direction)
    opens, closes = EXPOSURE.window([first, last], camera)
    assert opens[0] == 2.0
    # The readout ends one row past the last.
    assert opens[1] == pytest.approx(2.0 + 0.03 * (camera.lines - 1) / camera.lines)
    np.testing.assert_allclose(closes - opens, 0.01, atol=1e-15)


@pytest.mark.parametrize("direction", READOUT_DIRECTIONS)
def test_span_holds_every_window_and_no_more(direction):
    camera = camera_of(direction)
    opens, closes = EXPOSURE.window(np.arange(camera.lines), camera)
    assert EXPOSURE.span(camera) == (opens.min(), closes.max())


@pytest.mark.parametrize("direction", ["top-down", "bottom-up", "left-right", "right-left"])
def test_the_timestamp_marks_what_the_camera_says(direction: str) -> None:
    exposure = Exposure(1.0, 0.04)
    rows = np.arange(10.0)

    def windows(timestamp: str) -> tuple[np.ndarray, np.ndarray]:
        camera = Camera(10, 10, 50.0, readout_time=0.02, readout_direction=direction, timestamp_marks=timestamp)
        return exposure.window(rows, camera)

    assert windows("start")[0].min() == 1.0
    # Rounding of a few sums near 1.
    assert windows("end")[1].max() == pytest.approx(1.0, abs=1e-15)
    opens, closes = windows("middle")
    assert (opens + closes).mean() / 2 == pytest.approx(1.0, abs=1e-15)
