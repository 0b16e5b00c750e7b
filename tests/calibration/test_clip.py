"""Calibration from a clip: known cameras of simulated clips, logs that must be refused, and the matches of frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsdeblur import Camera, Exposure, GyroLog, InputError, calibrate, hand_shake, scene, simulate_clip
from rsdeblur.calibration.matches import ReducedFrame, match, match_clip
from rsdeblur.errors import ClockError
from rsdeblur.motion.axes import imu_to_camera, letters, mountings

FRAMES, RATE = 16, 30
WIDTH, HEIGHT, FOCAL, READOUT = 176, 128, 190.0, 0.024
BIAS = np.array([0.02, -0.03, 0.015])
OFFSET = 0.137
AXES = "yXZ"
# 1/40 s of strong shake: paths of 2 to 5 px of 176.
EXPOSURES = [Exposure(1.0 + i / RATE, 1 / 40) for i in range(FRAMES)]
START = Camera(WIDTH, HEIGHT, 0.8 * FOCAL)


def film(direction="bottom-up"):
    """Return the frames and the log, whose axes, bias and clock the calibration does not know, and the true camera."""
    camera = Camera(WIDTH, HEIGHT, FOCAL, readout_time=READOUT, readout_direction=direction, imu_to_camera=AXES)
    log = hand_shake(2.6, strength=0.5, seed=5)
    frames = list(simulate_clip(scene(256, 352), log, camera, EXPOSURES, noise=0.003, samples=4))
    recorded = GyroLog(log.t - OFFSET, log.omega + BIAS)
    return frames, recorded, replace(camera, time_offset=OFFSET)


@pytest.fixture(scope="module")
def clip():
    return film()


@pytest.fixture(scope="module")
def calibration(clip):
    frames, log, _ = clip
    return calibrate(frames, EXPOSURES, log, START, search=(-0.4, 0.4))


def test_the_camera_is_found(calibration, clip):
    """Requirements: offset within 1 ms, focal length within 1 %, readout within 5 %, mounting and direction right."""
    truth = clip[2]
    assert calibration.accepted, calibration.reason
    camera = calibration.camera
    assert calibration.mounting == AXES
    assert camera.readout_direction == truth.readout_direction
    assert camera.time_offset == pytest.approx(OFFSET, abs=1e-3)
    assert camera.focal_length[0] == pytest.approx(FOCAL, rel=0.01)
    assert camera.readout_time == pytest.approx(READOUT, rel=0.05)
    between = camera.imu_to_camera @ truth.imu_to_camera.T
    assert np.degrees(Rotation.from_matrix(between).magnitude()) < 1.0
    assert calibration.confidence > 0.95
    assert calibration.explained > 0.95


def test_deviations_are_honest(calibration):
    truth = {"time_offset": OFFSET, "focal_length": FOCAL, "readout_time": READOUT}
    truth |= dict(zip(("bias_x", "bias_y", "bias_z"), BIAS.tolist(), strict=True))
    for name, value in truth.items():
        estimate = calibration.values[name]
        assert estimate.determined
        # Four deviations: six values, each beyond with a probability of 6e-5.
        assert abs(estimate.value - value) < 4 * estimate.sd, name


def test_half_a_second_does_not_determine_the_drift_of_the_clock(calibration, clip):
    """The start value stays, and the times of the log with it."""
    drift = calibration.values["clock_drift"]
    assert (drift.determined, drift.value) == (False, 0.0)
    assert np.array_equal(calibration.log.t, clip[1].t)


def test_timestamps_that_mark_the_end(clip, calibration):
    """Timestamps of the last row's end, later than those of the first row's start by that, give the same offset."""
    frames, log, _ = clip
    delay = replace(calibration.camera, timestamp_marks="end").timestamp_delay(EXPOSURES[0].duration)
    later = [exposure.shifted(delay) for exposure in EXPOSURES]
    again = calibrate(frames, later, log, replace(START, timestamp_marks="end"), search=(-0.4, 0.4))
    # The starts of the fits differ, and therefore their ends a little.
    assert again.camera.time_offset == pytest.approx(calibration.camera.time_offset, abs=1e-4)


def test_a_left_handed_log_is_named(clip):
    frames, log, _ = clip
    mirrored = GyroLog(log.t, log.omega * (1, 1, -1))
    result = calibrate(frames, EXPOSURES, mirrored, START, search=(-0.4, 0.4))
    assert not result.accepted
    assert "left-handed" in result.reason
    assert result.mounting == "yXz"
    assert result.camera is START
    assert result.log is mirrored


def test_rotation_about_one_axis_is_refused():
    camera = Camera(WIDTH, HEIGHT, FOCAL, imu_to_camera="phone-landscape")
    log = hand_shake(2.6, strength=0.5, seed=5)
    log = GyroLog(log.t, log.omega * (1, 0, 0))
    frames = simulate_clip(scene(256, 352), log, camera, EXPOSURES, noise=0.003, samples=4)
    result = calibrate(frames, EXPOSURES, log, START, search=(-0.2, 0.2))
    assert not result.accepted
    assert "does not decide" in result.reason


def test_too_few_frames_are_refused(clip):
    frames, log, _ = clip
    result = calibrate(frames[:4], EXPOSURES[:4], log, START)
    assert (result.accepted, result.pairs) == (False, 3)
    assert "5 are needed" in result.reason


def test_frames_without_detail_are_refused(clip):
    result = calibrate([np.full((HEIGHT, WIDTH), 0.5)] * FRAMES, EXPOSURES, clip[1], START)
    assert (result.accepted, result.matches) == (False, 0)


def test_wrong_arguments(clip):
    frames, log, _ = clip
    with pytest.raises(InputError, match="one exposure for each frame"):
        calibrate(frames[:4], EXPOSURES[:5], log, START)
    with pytest.raises(InputError, match="one exposure for each frame"):
        calibrate(frames[:4], EXPOSURES[:3], log, START)
    with pytest.raises(InputError, match="order of time"):
        calibrate(frames[:2], EXPOSURES[1::-1], log, START)
    with pytest.raises(InputError, match="the camera's is"):
        calibrate([frame[:, :100] for frame in frames], EXPOSURES, log, START)
    with pytest.raises(InputError, match="search must run"):
        calibrate(frames, EXPOSURES, log, START, search=(0.1, -0.1))
    with pytest.raises(ClockError, match="unrelated clocks"):
        calibrate(frames, EXPOSURES, log.shifted(50.0), START)


def test_matches_follow_a_known_shift():
    """A shift by whole pixels moves every point by just that; 0.05 px is what noise and interpolation leave."""
    picture = scene(200, 260).mean(axis=2)
    grain = np.random.default_rng(0).normal(0.0, 0.003, (2, 160, 220))
    cuts = np.stack([picture[20:180, 20:240], picture[12:172, 33:253]])
    first, second = map(ReducedFrame, cuts + grain)
    points, moved = match(first, second)
    assert len(points) > 30
    assert np.abs(np.median(moved - points, axis=0) - (-13, 8)).max() < 0.05


def test_frames_far_apart_are_not_matched(clip):
    frames = clip[0][:3]
    exposures = [Exposure(0.0, 0.01), Exposure(0.03, 0.01), Exposure(2.0, 0.01)]
    assert len(match_clip(frames, exposures, START).opens) == 1


def test_48_mountings_have_48_names():
    matrices = mountings()
    assert len({letters(matrix) for matrix in matrices}) == 48
    assert all(np.array_equal(imu_to_camera(letters(matrix)), matrix) for matrix in matrices)
    assert sum(np.linalg.det(matrix) > 0 for matrix in matrices) == 24
