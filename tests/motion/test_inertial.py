"""The camera's path from its accelerometer: exact for motions that are known in closed form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from rsdeblur import (
    AccelerationLog,
    BlurPaths,
    Camera,
    Capture,
    CoverageError,
    Exposure,
    GyroLog,
    InertialTrack,
    InputError,
    fit_drifts,
    read_acceleration,
    read_captures,
    read_gyro,
)
from rsdeblur.kernels.orientation import rotation_matrix

T = np.arange(-0.1, 1.1, 0.002)
G = np.array([1.0, 9.6, 1.5])  # down, a little askew, in the axes of the camera at the time 0
MOUNT = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
CAMERA = Camera(160, 120, 200.0, imu_to_camera=MOUNT, readout_time=0.02)


class Motion(NamedTuple):
    """Position of the accelerometer, its acceleration, and a rotation by `angle` about a fixed axis, over time."""

    position: np.ndarray
    acceleration: np.ndarray
    angle: np.ndarray = np.zeros_like(T)
    rate: np.ndarray = np.zeros_like(T)
    axis: np.ndarray = np.array([0.6, 0.0, 0.8])

    @property
    def rotations(self) -> np.ndarray:
        """Orientations, camera from world."""
        return rotation_matrix(-self.angle[:, None] * self.axis)

    def track(self, t0: float = 0.0, t1: float = 1.0, *, lever: tuple[float, ...] = (0, 0, 0)) -> InertialTrack:
        """Return the track that its sensors give, mounted like a phone's, with clocks that differ."""
        offset = 0.03
        log = GyroLog(T - offset, self.rate[:, None] * self.axis @ MOUNT, 10**18)
        force = np.einsum("tij,tj->ti", self.rotations, self.acceleration - G)
        accelerometer = AccelerationLog(T - offset - 1.0, force @ MOUNT, 10**18 + 10**9)
        camera = Camera(160, 120, 200.0, imu_to_camera=MOUNT, time_offset=offset)
        return InertialTrack.from_logs(log, accelerometer, camera, t0, t1, 10**18, lever=lever)


def sway(*amplitudes: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions of a hand's sway, 0 at the time 0, and their second derivatives."""
    w = np.array([7.0, 11.0, 5.0])
    phase = np.outer(T, w)
    return np.sin(phase) * amplitudes, -(w**2) * np.sin(phase) * amplitudes


def turning() -> dict[str, np.ndarray]:
    return {"angle": 0.3 * np.sin(4 * T), "rate": 1.2 * np.cos(4 * T)}


SWAY = sway(0.01, 0.02, 0.005)
START = np.array([0.07, 0.22, 0.025])  # its velocity at the time 0, m/s


@pytest.mark.parametrize("turn", [{}, turning()], ids=["straight", "turning"])
def test_at_rest_nothing_moves(turn: dict[str, np.ndarray]) -> None:
    track = Motion(np.zeros((len(T), 3)), np.zeros((len(T), 3)), **turn).track()
    # Rates and forces are taken as linear between samples 2 ms apart: 1e-6 of the way that gravity makes in 1 s.
    np.testing.assert_allclose(track.gravity, G, atol=1e-5)
    np.testing.assert_allclose(track.position(track.t, np.zeros(3), G), 0, atol=1e-5)


def test_constant_velocity_is_only_the_velocity() -> None:
    track = Motion(np.outer(T, START), np.zeros((len(T), 3))).track()
    np.testing.assert_allclose(track.position(track.t, START), np.outer(track.t, START), atol=1e-9)


def test_in_free_fall_the_accelerometer_shows_nothing() -> None:
    track = Motion(0.5 * G * T[:, None] ** 2, np.tile(G, (len(T), 1)), **turning()).track()
    np.testing.assert_allclose(track.path, 0, atol=1e-12)
    fall = 0.5 * G * track.t[:, None] ** 2
    np.testing.assert_allclose(track.position(track.t, np.zeros(3), G), fall, atol=1e-12)


@pytest.mark.parametrize("turn", [{}, turning()], ids=["straight", "turning"])
def test_a_sway_comes_out(turn: dict[str, np.ndarray]) -> None:
    track = Motion(*SWAY, **turn).track()
    times = np.linspace(0, 1, 7)
    expected = np.stack([np.interp(times, T, axis) for axis in SWAY[0].T], axis=-1)
    np.testing.assert_allclose(track.position(times, START, G), expected, atol=2e-5)


def test_a_camera_on_a_lever_moves_when_the_phone_turns() -> None:
    lever = np.array([0.02, -0.07, 0.005])
    motion = Motion(*SWAY, **turning())
    track = motion.track(lever=tuple(lever))
    arm = np.einsum("tji,j->ti", motion.rotations, lever) - lever
    times = T[(T > 0) & (T < 1)][::50]
    expected = [np.interp(times, T, axis) for axis in (SWAY[0] + arm).T]
    np.testing.assert_allclose(track.position(times, START, G).T, expected, atol=2e-5)


@pytest.mark.parametrize("lever", [(0.0, 0.0, 0.0), (0.02, -0.07, 0.005)])
def test_a_part_of_the_track_is_the_track_of_the_part(lever: tuple[float, ...]) -> None:
    motion = Motion(*SWAY, **turning())
    whole, part = motion.track(lever=lever), motion.track(0.4, 0.6, lever=lever)
    i = int(np.argmin(np.abs(T - 0.4)))
    turn = motion.rotations[i]
    speed = START * np.cos(np.array([7.0, 11.0, 5.0]) * 0.4)
    camera, exposure = Camera(160, 120, 200.0), Exposure(0.4, 0.2, 10**18)
    own = part.translation(exposure, camera, 2.0, turn @ speed, turn @ G)
    cut = whole.translation(exposure, camera, 2.0, START, G)
    anew = whole.during(exposure, camera)
    # The integrated rotation errs by some 1e-6 rad.
    np.testing.assert_allclose(anew.gravity, turn @ whole.gravity, atol=1e-4)
    again = anew.translation(exposure, camera, 2.0, turn @ speed, turn @ G)
    times = np.linspace(0.4, 0.6, 9)
    np.testing.assert_allclose(own.at(times), cut.at(times), atol=2e-5)
    np.testing.assert_allclose(own.at(times), again.at(times), atol=2e-5)
    assert (cut.epoch_ns, cut.depth) == (10**18, 2.0)


def test_a_translation_covers_its_exposure_whatever_the_epoch() -> None:
    motion = Motion(*SWAY)
    track = motion.track()
    camera = Camera(160, 120, 200.0, imu_to_camera=MOUNT, readout_time=0.02, time_offset=0.03)
    log = GyroLog(T - 0.03, motion.rate[:, None] * motion.axis @ MOUNT, 10**18)
    for i in range(20):
        exposure = Exposure(0.0, 0.1, 10**18 + 12_345_679 * (i + 1))
        Capture.from_log(log, camera, exposure, track.translation(exposure, camera, 1.0, START))


def exposures(count: int = 6, duration: float = 0.1) -> list[Exposure]:
    return [Exposure(0.15 * i, duration, 10**18) for i in range(count)]


def test_a_fit_finds_what_made_the_drifts() -> None:
    motion = Motion(*SWAY, **turning())
    track, pixels = motion.track(), np.array([[20.0, 30.0], [140.0, 100.0]] * 3)
    truth = 2.5
    drifts = []
    for exposure, (x, y) in zip(exposures(), pixels, strict=True):
        capture = Capture.from_log(
            GyroLog(T - 0.03, motion.rate[:, None] * motion.axis @ MOUNT, 10**18),
            camera := Camera(160, 120, 200.0, imu_to_camera=MOUNT, time_offset=0.03),
            exposure,
            track.translation(exposure, camera, truth, START, G),
        )
        still = Capture.from_log(
            GyroLog(T - 0.03, motion.rate[:, None] * motion.axis @ MOUNT, 10**18), camera, exposure
        )
        ways = [BlurPaths.from_capture(each, [y], [x], samples=101).displacements[0, 0] for each in (capture, still)]
        share = np.linspace(0, 1, 101)
        drifts.append(np.polyfit(share, ways[0] - ways[1], 1)[0])
    fit = fit_drifts(track, camera, exposures(), np.array(drifts), pixels=pixels, drift_sd=1e-3, velocity_sd=10.0)
    # Drifts of 0.2 to 1 px, which a turning camera bends by some per cent.
    assert fit.depth == pytest.approx(truth, rel=0.05)
    # Along the optical axis, a movement shows only beside the middle, and less.
    np.testing.assert_array_less(np.abs(fit.velocity - START), (0.01, 0.01, 0.05))
    np.testing.assert_array_less(np.abs(fit.gravity - G), (0.02, 0.02, 0.1))
    assert fit.r2 > 0.999


def test_drifts_that_contradict_the_accelerometer_are_refused() -> None:
    track = Motion(*SWAY).track()
    camera = Camera(160, 120, 200.0)
    moved = [[np.interp(i * 0.15 + end, T, axis) for axis in SWAY[0].T[:2]] for i in range(6) for end in (0.0, 0.1)]
    drifts = -200.0 / 2.5 * np.diff(np.reshape(moved, (6, 2, 2)), axis=1)[:, 0]
    # Some 0.7 px, of which the bend of the path, not in the drift, is a tenth.
    assert fit_drifts(track, camera, exposures(), drifts, drift_sd=0.1, velocity_sd=1.0).depth == pytest.approx(
        2.5, rel=0.1
    )
    with pytest.raises(InputError, match="no positive depth"):
        fit_drifts(track, camera, exposures(), -drifts, drift_sd=0.1)
    with pytest.raises(InputError, match="at least one exposure"):
        fit_drifts(track, camera, [], np.zeros((0, 2)))
    with pytest.raises(InputError, match="velocity_sd"):
        fit_drifts(track, camera, exposures(), drifts, velocity_sd=0.0)


def test_times_outside_are_refused() -> None:
    track = Motion(*SWAY).track(0.2, 0.8)
    with pytest.raises(CoverageError, match="inertial track spans"):
        track.translation(Exposure(0.1, 0.2, 10**18), CAMERA, 1.0, START)
    with pytest.raises(CoverageError, match="inertial track spans"):
        fit_drifts(track, Camera(160, 120, 200.0), exposures(), np.ones((6, 2)))
    with pytest.raises(CoverageError, match="the accelerometer log does not cover"):
        InertialTrack.from_logs(GyroLog(T, np.zeros((len(T), 3))), AccelerationLog([0, 1], [G, G]), CAMERA, 0.5, 1.05)
    with pytest.raises(InputError, match="t1"):
        Motion(*SWAY).track(0.5, 0.5)


def test_a_real_recording_predicts_its_drifts(data_dir) -> None:
    """Drifts of a waste bin near the phone, measured between frames: 8 numbers, found again to a fifth.

    The bin is seen at 1.3 m; its drifts predict each other through the accelerometer, those of opposite sign too.
    """
    folder = data_dir / "real/mars-phone-240ms"
    log, accelerometer = read_gyro(folder / "gyro_accel.csv"), read_acceleration(folder / "gyro_accel.csv")
    captures = read_captures(folder / "movie_metadata.csv")
    camera = Camera(1080, 1920, 1500.0, imu_to_camera=np.diag([1.0, -1.0, -1.0]))
    track = InertialTrack.from_logs(log, accelerometer, camera, *log.span, log.epoch_ns)
    drifts = {2: (-8.6, 8.1), 5: (8.7, -3.7), 8: (7.5, 6.6), 9: (5.4, 3.8)}
    fit = fit_drifts(track, camera, [captures[i] for i in drifts], list(drifts.values()))
    assert fit.r2 > 0.98
    assert fit.depth == pytest.approx(1.3, abs=0.15)
    # Gravity agrees with the mean reading within what a hand's velocity can change it.
    np.testing.assert_allclose(fit.gravity, track.gravity, atol=0.2)
