"""Calibration from a clip: known cameras of simulated clips, logs that must be refused, and the matches of frames."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsdeblur import Camera, Exposure, GyroLog, calibrate, hand_shake, scene, simulate_clip
from rsdeblur.calibration.clip import calibrate_matches
from rsdeblur.calibration.fit import ClipModel, MeanOrientation, Parameters, fit_clip
from rsdeblur.calibration.matches import ClipMatches, ReducedFrame, match, match_clip
from rsdeblur.errors import ClockError
from rsdeblur.motion.axes import imu_to_camera, letters, mountings
from rsdeblur.motion.track import OrientationTrack

FRAMES, RATE = 16, 30
WIDTH, HEIGHT, FOCAL, READOUT = 176, 128, 190.0, 0.024
BIAS = np.array([0.02, -0.03, 0.015])
OFFSET = 0.137
AXES = "yXZ"
# 1/40 s of strong shake: paths of 2 to 5 px of 176.
EXPOSURES = [Exposure(1.0 + i / RATE, 1 / 40) for i in range(FRAMES)]
START = Camera(WIDTH, HEIGHT, 0.8 * FOCAL)


@pytest.fixture(scope="module")
def clip():
    """Return the frames and the log, whose axes, bias and clock the calibration does not know, and the true camera."""
    camera = Camera(WIDTH, HEIGHT, FOCAL, readout_time=READOUT, readout_direction="bottom-up", imu_to_camera=AXES)
    log = hand_shake(2.6, strength=0.5, seed=5)
    frames = list(simulate_clip(scene(256, 352), log, camera, EXPOSURES, noise=0.003, samples=4))
    return frames, GyroLog(log.t - OFFSET, log.omega + BIAS), replace(camera, time_offset=OFFSET)


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
    end = replace(calibration.camera, timestamp_marks="end")
    later = [replace(each, start=2 * each.start - each.span(end)[0]) for each in EXPOSURES]
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


def test_unrelated_clocks_are_refused(clip):
    frames, log, _ = clip
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


CAMERA = Camera(640, 480, 600.0)
MOUNTING = imu_to_camera("phone-portrait")
TRUTH = Parameters(offset=0.05, across=-0.02, focal=0.1, turn_y=0.03, bias_x=0.02, bias_z=-0.01, drift=5e-5)
FREE = ("offset", "across", "focal", "turn_y", "bias_x", "bias_z")
POINTS = 20


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
