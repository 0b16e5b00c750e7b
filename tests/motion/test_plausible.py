"""Probable mistakes in a camera are named, and ordinary cameras raise no doubt."""

from __future__ import annotations

import pytest

from rsdeblur.motion.camera import Camera
from rsdeblur.motion.plausible import doubts


@pytest.mark.parametrize(
    ("camera", "hint"),
    [
        (Camera(4000, 3000, 4.7), "is it in mm?"),
        (Camera(640, 480, 26), "is it in mm?"),
        (Camera(640, 480, 30_000), "measured in a larger picture?"),
        (Camera(640, 480, 500, readout_time=18.0), "did you mean 18 ms?"),
    ],
)
def test_mistakes_are_named(camera: Camera, hint: str) -> None:
    (doubt,) = doubts(camera)
    assert hint in doubt


def test_ordinary_cameras_raise_no_doubt() -> None:
    # A phone, an action camera's fisheye, and a telescope of 600 mm on a full-frame sensor.
    fisheye = Camera(4000, 3000, 1000, distortion_model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0))
    for camera in (Camera(4000, 3000, 3000, readout_time=0.03), fisheye, Camera(6000, 4000, 100_000)):
        assert doubts(camera) == []
