"""Simulated clips: one frame is a simulated photo, and a still camera films the scene."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, InputError, hand_shake, scene, simulate, simulate_clip

CAMERA = Camera(96, 72, 110.0, readout_time=0.02, readout_direction="right-left")


@pytest.fixture(scope="module")
def sharp():
    return scene(112, 144)


def test_a_clip_of_one_frame_is_a_photo(sharp):
    """Both are the scene at the mid-exposure of the middle row."""
    log, exposure = hand_shake(0.5, seed=3), Exposure(0.2, 0.03)
    (frame,) = simulate_clip(sharp, log, CAMERA, [exposure], samples=12)
    photo = simulate(sharp, log, CAMERA, exposure, samples=12).blurred
    # The orientation is integrated in steps of 0.5 ms instead of 0.05 ms; a thousandth of a pixel changes an edge so.
    assert np.abs(frame - photo).max() < 1e-3


def test_a_still_camera_films_the_scene(sharp):
    still = GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)))
    frames = list(simulate_clip(sharp, still, CAMERA, [Exposure(0.1, 0.02), Exposure(0.5, 0.02)]))
    assert len(frames) == 2
    for frame in frames:
        # float32 and the cubic interpolation at whole pixels
        assert np.abs(frame - sharp[20:92, 24:120]).max() < 1e-4


def test_epochs_of_exposures_count(sharp):
    log = hand_shake(0.8, seed=3)
    exposures = [Exposure(0.2, 0.01), Exposure(0.4, 0.01)]
    later = [exposures[0], Exposure(-0.1, 0.01, 500_000_000)]
    for one, other in zip(*(simulate_clip(sharp, log, CAMERA, each) for each in (exposures, later)), strict=True):
        assert np.abs(one - other).max() < 1e-5


def test_refused(sharp):
    log = hand_shake(0.5)
    for camera, exposures in (
        (CAMERA, []),
        (Camera(96, 72, 110.0, distortion_model="radtan", distortion=[0.1] * 4), [Exposure(0.2, 0.01)]),
    ):
        with pytest.raises(InputError, match="without lens distortion"):
            next(simulate_clip(sharp, log, camera, exposures))
