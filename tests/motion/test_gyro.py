"""Laws of the gyro log, and gravity in the picture."""

import math
import pickle

import numpy as np
import pytest

from rsdeblur import Camera, CoverageError, Exposure, GyroLog, RsdeblurWarning
from rsdeblur.errors import ClockError, GapError
from rsdeblur.motion import AccelerationLog
from rsdeblur.motion.axes import imu_to_camera

EPOCH = 1_700_000_000_123_456_789


@pytest.mark.parametrize("ns", [1, -1, 123_456_789])
def test_epochs_of_today_keep_nanoseconds(shaky_log, ns):
    log = shaky_log()
    dated = GyroLog(log.t, log.omega, EPOCH)
    based = dated.covering(0.15, 0.2, EPOCH + ns)
    assert based.epoch_ns == EPOCH + ns
    kept = log.trimmed(0.15 + ns * 1e-9, 0.2 + ns * 1e-9)
    # Float64 would round whole timestamps to 256 ns; the difference is right to a millionth of a nanosecond.
    np.testing.assert_allclose(based.t, kept.t - ns * 1e-9, rtol=0, atol=1e-15)
    assert np.array_equal(based.omega, kept.omega)


def test_logs_of_equal_values_are_equal(shaky_log):
    log = shaky_log()
    for same in (shaky_log(), pickle.loads(pickle.dumps(log))):
        assert same == log
        assert hash(same) == hash(log)
    other_rates = GyroLog(log.t, 2 * log.omega)
    others = (other_rates, log.shifted(1.0), log.trimmed(0.1, 0.2), GyroLog(log.t, log.omega, EPOCH))
    assert log not in (*others, AccelerationLog(log.t, log.omega), "log")


T = np.arange(101) * 0.005
EVEN = GyroLog(T, np.zeros((101, 3)))
# Samples at 195 ms and 250 ms remain.
HOLED = GyroLog(np.delete(T, slice(40, 50)), np.zeros((91, 3)))


def test_a_part_has_the_samples_around_the_window():
    part = EVEN.covering(0.1012, 0.1993, 0)
    assert part.span == pytest.approx((0.1, 0.2))
    assert len(part) == 21
    # A gap outside does not matter.
    for window in ((0.05, 0.195), (0.25, 0.4)):
        assert HOLED.covering(*window, 0).span == pytest.approx(window)


@pytest.mark.parametrize(
    ("log", "start", "epoch", "error", "words"),
    [
        (EVEN, -0.0125, 0, CoverageError, r"misses 12\.500 ms at its start"),
        *(
            (EVEN, start, epoch, ClockError, "unrelated clocks: .*give the time offset")
            for start, epoch in ((0.1, EPOCH), (0.1, -EPOCH), (61.0, 0), (-60.5, 0))
        ),
        (HOLED, 0.18, 0, GapError, r"gap of 55\.0 ms .*15\.0 ms after"),
        (HOLED, 0.21, 0, GapError, r"gap of 55\.0 ms .*15\.0 ms before"),
    ],
)
def test_what_a_log_does_not_cover_is_refused(log, start, epoch, error, words):
    with pytest.raises(CoverageError, match=words) as caught:
        log.covering(start, start + 0.1, epoch)
    assert type(caught.value) is error


def test_a_log_holds_its_own_read_only_arrays():
    t, omega = np.arange(3.0), np.ones((3, 3))
    log = GyroLog(t, omega, EPOCH)
    t[0], omega[0] = -1.0, 2.0
    assert (log.t[0], log.omega[0, 0]) == (0.0, 1.0)
    for changed in (log, log.shifted(1.0), log.trimmed(0.1, 0.2), log.minus_bias([0, 0, 0])):
        assert changed.epoch_ns == EPOCH
        assert not changed.t.flags.writeable
        assert not changed.omega.flags.writeable


def test_gaps_lists_long_intervals():
    t = np.delete(np.arange(50) * 0.01, [10, 20, 21, 22, 23])
    log = GyroLog(t, np.zeros((45, 3)))
    np.testing.assert_allclose(log.gaps(), [[0.19, 0.24]])


@pytest.mark.parametrize(
    ("t0", "t1", "first", "last"),
    [(0.101, 0.199, 20, 40), (0.099, 0.201, 19, 41), (-1.0, 9.0, 0, 80), (0.301, 0.302, 60, 61)],
)
def test_trimmed_keeps_the_neighbours(shaky_log, t0, t1, first, last):
    log = shaky_log()
    assert log.trimmed(t0, t1).span == (log.t[first], log.t[last])


def test_minus_bias(shaky_log):
    log, bias = shaky_log(), np.array([0.1, -0.2, 0.3])
    np.testing.assert_allclose(log.minus_bias(bias).omega + bias, log.omega, atol=1e-15)


def test_times_in_ms_are_suspected(shaky_log):
    log = shaky_log()
    with pytest.warns(RsdeblurWarning, match="must be in s"):
        GyroLog(1000 * log.t, log.omega)


def test_degrees_are_suspected_once(shaky_log):
    log = shaky_log()
    with pytest.warns(RsdeblurWarning, match="degrees per second") as caught:
        suspicious = GyroLog(log.t, 180 / np.pi * log.omega)
    assert caught[0].filename == __file__
    # Warnings are errors in tests.
    suspicious.shifted(1.0).minus_bias([0, 0, 0]).trimmed(1.1, 1.3).covering(1.15, 1.2, 0)
    omega = log.omega.copy()
    omega[7, 1] = 40.0
    with pytest.warns(RsdeblurWarning, match="peak 40"):
        GyroLog(log.t, omega)


TIMES = np.arange(0, 2, 0.01)
EXPOSURE = Exposure(0.9, 0.1)


def held(force: tuple[float, float, float]) -> AccelerationLog:
    return AccelerationLog(TIMES, np.tile(force, (len(TIMES), 1)))


@pytest.mark.parametrize(
    ("preset", "degrees"),
    [
        ("phone-portrait", 0),
        ("phone-landscape", 90),
        ("phone-portrait-reversed", 180),
        ("phone-landscape-reversed", -90),
    ],
)
def test_presets_turn_gravity_of_a_phone_held_upright(preset: str, degrees: float) -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera(preset))
    angle = held((0.0, 9.8, 0.0)).gravity_angle(camera, EXPOSURE)
    assert angle is not None
    # Rounding; half a turn has either sign.
    assert abs(math.remainder(angle - math.radians(degrees), math.tau)) < 1e-9


def test_a_phone_that_leans_turns_gravity_by_as_much() -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera("phone-portrait"))
    lean = math.radians(30)
    # Its top leans to the right, so that what holds it comes from its left.
    angle = held((-9.8 * math.sin(lean), 9.8 * math.cos(lean), 0.0)).gravity_angle(camera, EXPOSURE)
    assert angle == pytest.approx(lean)


def test_nothing_is_said_where_the_camera_looks_down_or_the_log_has_no_samples() -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera("phone-portrait"))
    assert held((0.0, 4.0, 9.0)).gravity_angle(camera, EXPOSURE) is None
    upright = held((0.0, 9.8, 0.0))
    assert upright.gravity_angle(camera, Exposure(5.0, 0.1)) is None
    # The same moment, counted from another epoch and on a clock that is 1 s late.
    late = Camera(480, 640, 500.0, imu_to_camera=camera.imu_to_camera, time_offset=1.0)
    assert upright.gravity_angle(late, Exposure(-7.1, 0.1, 10**10)) is not None


def test_hands_that_shake_to_and_fro_do_not_matter() -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera("phone-portrait"))
    force = np.tile((0.0, 9.8, 0.0), (len(TIMES), 1))
    force[:, 0] = 5 * np.sin(2 * math.pi * 10 * TIMES)
    angle = AccelerationLog(TIMES, force).gravity_angle(camera, EXPOSURE)
    assert angle is not None
    # Six periods average out, but for the samples at the ends.
    assert abs(angle) < math.radians(2)
