"""Simulated clips: one frame is a simulated photo, and a still camera films the scene."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, InputError, hand_shake, scene, simulate, simulate_clip

CAMERA = Camera(96, 72, 110.0, readout_time=0.02, readout_direction="right-left")
SHARP = scene(112, 144)


def test_a_clip_of_one_frame_is_a_photo():
    """Both are the scene at the mid-exposure of the middle row."""
    log, exposure = hand_shake(0.5, seed=3), Exposure(0.2, 0.03)
    (frame,) = simulate_clip(SHARP, log, CAMERA, [exposure], samples=12)
    photo = simulate(SHARP, log, CAMERA, exposure, samples=12).blurred
    # The orientation is integrated in steps of 0.5 ms instead of 0.05 ms; a thousandth of a pixel changes an edge so.
    assert np.abs(frame - photo).max() < 1e-3


def test_a_still_camera_films_the_scene():
    still = GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)))
    frames = list(simulate_clip(SHARP, still, CAMERA, [Exposure(0.1, 0.02), Exposure(0.5, 0.02)]))
    assert len(frames) == 2
    for frame in frames:
        # float32 and the cubic interpolation at whole pixels
        assert np.abs(frame - SHARP[20:92, 24:120]).max() < 1e-4


def test_epochs_of_exposures_count():
    log = hand_shake(0.8, seed=3)
    exposures = [Exposure(0.2, 0.01), Exposure(0.4, 0.01)]
    later = [exposures[0], Exposure(-0.1, 0.01, 500_000_000)]
    for one, other in zip(*(simulate_clip(SHARP, log, CAMERA, each) for each in (exposures, later)), strict=True):
        assert np.abs(one - other).max() < 1e-5


def test_refused():
    log = hand_shake(0.5)
    for camera, exposures in (
        (CAMERA, []),
        (Camera(96, 72, 110.0, distortion_model="radtan", distortion=[0.1] * 4), [Exposure(0.2, 0.01)]),
    ):
        with pytest.raises(InputError, match="without lens distortion"):
            next(simulate_clip(SHARP, log, camera, exposures))
