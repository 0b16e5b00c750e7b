"""Gravity in the picture."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rsdeblur import Camera, Exposure
from rsdeblur.motion import AccelerationLog
from rsdeblur.motion.axes import imu_to_camera

T = np.arange(0, 2, 0.01)
EXPOSURE = Exposure(0.9, 0.1)


def log(force: tuple[float, float, float]) -> AccelerationLog:
    return AccelerationLog(T, np.tile(force, (len(T), 1)))


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
    angle = log((0.0, 9.8, 0.0)).gravity_angle(camera, EXPOSURE)
    assert angle is not None
    # Rounding; half a turn has either sign.
    assert abs(math.remainder(angle - math.radians(degrees), math.tau)) < 1e-9


def test_a_phone_that_leans_turns_gravity_by_as_much() -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera("phone-portrait"))
    lean = math.radians(30)
    # Its top leans to the right, so that what holds it comes from its left.
    angle = log((-9.8 * math.sin(lean), 9.8 * math.cos(lean), 0.0)).gravity_angle(camera, EXPOSURE)
    assert angle == pytest.approx(lean)


def test_nothing_is_said_where_the_camera_looks_down_or_the_log_has_no_samples() -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera("phone-portrait"))
    assert log((0.0, 4.0, 9.0)).gravity_angle(camera, EXPOSURE) is None
    upright = log((0.0, 9.8, 0.0))
    assert upright.gravity_angle(camera, Exposure(5.0, 0.1)) is None
    # The same moment, counted from another epoch and on a clock that is 1 s late.
    late = Camera(480, 640, 500.0, imu_to_camera=camera.imu_to_camera, time_offset=1.0)
    assert upright.gravity_angle(late, Exposure(-7.1, 0.1, 10**10)) is not None


def test_hands_that_shake_to_and_fro_do_not_matter() -> None:
    camera = Camera(480, 640, 500.0, imu_to_camera=imu_to_camera("phone-portrait"))
    force = np.tile((0.0, 9.8, 0.0), (len(T), 1))
    force[:, 0] = 5 * np.sin(2 * math.pi * 10 * T)
    angle = AccelerationLog(T, force).gravity_angle(camera, EXPOSURE)
    assert angle is not None
    # Six periods average out, but for the samples at the ends.
    assert abs(angle) < math.radians(2)
