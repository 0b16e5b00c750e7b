"""The fit of a clip on matches that follow the model: drift of the clock, honest deviations, and shared errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, hand_shake
from rsdeblur.calibration.clip import calibrate_matches
from rsdeblur.calibration.fit import ClipModel, MeanOrientation, Parameters, fit_clip
from rsdeblur.calibration.matches import ClipMatches
from rsdeblur.motion.axes import imu_to_camera
from rsdeblur.motion.track import OrientationTrack

CAMERA = Camera(640, 480, 600.0)
MOUNTING = imu_to_camera("phone-portrait")
TRUTH = Parameters(offset=0.05, across=-0.02, focal=0.1, turn_y=0.03, bias_x=0.02, bias_z=-0.01, drift=5e-5)
FREE = ("offset", "across", "focal", "turn_y", "bias_x", "bias_z")
POINTS = 40


def matched(starts, log, *, camera=CAMERA, truth=TRUTH, noise=0.05, shake=0.0, seed=0):
    """Return matches of pairs of frames 1/30 s apart, with errors of points and of pairs (shifts), px."""
    random = np.random.default_rng(seed)
    opens = np.stack([starts, starts + 1 / 30], axis=1)
    points = random.uniform((0, 0), (639, 479), (len(starts) * POINTS, 2))
    pair = np.repeat(np.arange(len(starts)), POINTS)
    orientation = MeanOrientation(log.t, log.omega)
    moved = points
    # The row in the second frame decides its time, so the prediction is repeated until it stays.
    for _ in range(4):
        matches = ClipMatches(points, moved, pair, opens, np.full(opens.shape, 0.01))
        moved = moved + ClipModel(matches, camera, orientation, MOUNTING).residuals(truth)
    moved = moved + random.normal(0.0, noise, moved.shape) + random.normal(0.0, shake, (len(starts), 2))[pair]
    return ClipMatches(points, moved, pair, opens, matches.durations)


def test_deviations_are_those_of_the_errors():
    """With independent errors, of points and of pairs, scores have a deviation of 1/2: deviations are doubled."""
    log = hand_shake(2.5, strength=0.3, seed=1)
    starts = 0.3 + np.arange(30) / 30
    orientation = MeanOrientation(log.t, log.omega)
    scores = []
    for seed in range(8):
        matches = matched(starts, log, shake=0.5, seed=seed)
        model = ClipModel(matches, CAMERA, orientation, MOUNTING)
        fit = fit_clip(model, TRUTH, FREE, np.ones(len(starts), bool), rounds=3)
        scores += [(getattr(fit.parameters, name) - getattr(TRUTH, name)) / fit.sd(**{name: 1.0}) for name in FREE]
    # 48 scores: their rms is known to 10 %; correlated parameters allow twice that and more.
    assert 0.25 < np.sqrt(np.mean(np.square(scores))) < 0.8


def test_a_minute_shows_the_drift_of_the_clock():
    log = hand_shake(62.0, strength=0.3, seed=2)
    starts = (np.arange(6)[:, None] * 11.5 + 1.0 + np.arange(6) / 30).ravel()
    found = calibrate_matches(matched(starts, log), 0, log, CAMERA, (-0.2, 0.3))
    assert found.accepted, found.reason
    drift = found.values["clock_drift"]
    assert drift.determined
    assert abs(drift.value - TRUTH.drift) < 4 * drift.sd
    # The corrected log runs faster by just that, around the middle of the clip.
    assert np.ptp(found.log.t - log.t) == pytest.approx(drift.value * 62.0, rel=1e-6)
    assert found.camera.readout_direction == "right-left"
    # A turn of 0.03 rad is far beyond its deviation, so it is in the camera.
    assert np.abs(found.camera.imu_to_camera - MOUNTING).max() > 0.02


def test_a_distorting_lens():
    coefficients = (0.05, -0.01, 0, 0)
    camera = replace(CAMERA, distortion_model="fisheye", distortion=coefficients)
    log = hand_shake(2.5, strength=0.3, seed=1)
    found = calibrate_matches(matched(0.3 + np.arange(30) / 30, log, camera=camera), 0, log, camera, (-0.2, 0.3))
    assert found.accepted, found.reason
    assert found.camera.focal_length[0] == pytest.approx(600 * np.exp(TRUTH.focal), rel=2e-3)
    assert found.camera.distortion == coefficients


def test_a_global_shutter_has_no_direction():
    """The readout time is 0 within its deviation, so the start's direction stays, and so do the neat axes."""
    log = hand_shake(2.5, strength=0.3, seed=1)
    truth = Parameters(offset=0.05)
    start = replace(CAMERA, readout_time=0.01, readout_direction="bottom-up")
    found = calibrate_matches(matched(0.3 + np.arange(30) / 30, log, truth=truth), 0, log, start, (-0.2, 0.3))
    assert found.accepted, found.reason
    readout = found.values["readout_time"]
    assert readout.determined
    assert readout.value < 3 * readout.sd < 1e-3
    assert found.camera.readout_direction == "bottom-up"
    assert np.array_equal(found.camera.imu_to_camera, MOUNTING)


def test_mean_orientation_is_that_of_the_middle_at_a_constant_rate():
    t = np.arange(0, 1, 0.01)
    omega = np.tile([0.3, -0.5, 0.2], (100, 1))
    mean = MeanOrientation(t, omega).at(np.array([0.2, 0.5]), np.array([0.1, 0.0]))
    truth = OrientationTrack.integrated(t, omega).at(np.array([0.25, 0.5005]))
    # A mean of no duration is taken over 1 ms; the table has a step of 0.5 ms.
    assert np.abs(mean.as_matrix() - truth).max() < 3e-4
