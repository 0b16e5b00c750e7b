"""Poses in the world become positions in the camera's axes at the start of the exposure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsdeblur import Camera, Exposure
from rsdeblur.motion import Trajectory
from rsdeblur.motion.axes import imu_to_camera

T = np.linspace(0.0, 1.0, 31)
EXPOSURE = Exposure(0.25, 0.2, 7 * 10**18)
CAMERA = Camera(160, 120, 200.0, readout_time=0.02, imu_to_camera="phone-landscape")
# A straight way to the right of the camera, in its axes, at 0.3 m/s.
WAY = np.outer(T, (0.3, 0.0, 0.0))
# The camera in the world: askew, without turning.
POSE = Rotation.from_rotvec((0.4, -1.1, 0.7))


def seen(body_to_camera: np.ndarray, axes: str) -> np.ndarray:
    """Return positions at the start and the end of the exposure, of a body mounted like this."""
    world = POSE.apply(WAY) + np.array([10.0, -20.0, 3.0])
    body = POSE * Rotation.from_matrix(body_to_camera)
    trajectory = Trajectory(T, world, np.tile(body.as_quat(), (len(T), 1)), EXPOSURE.epoch_ns)
    track = trajectory.translation(EXPOSURE, CAMERA, 2.0, axes=axes)
    assert track.epoch_ns == EXPOSURE.epoch_ns
    return 2.0 * track.at(np.array([0.25, 0.45]))


@pytest.mark.parametrize("axes", ["camera", "imu", "phone-portrait", "gyroflow", "YxZ"])
def test_the_way_is_that_in_the_cameras_axes(axes: str) -> None:
    matrix = {"camera": np.eye(3), "imu": CAMERA.imu_to_camera.copy()}.get(axes)
    found = seen(imu_to_camera(axes) if matrix is None else matrix, axes)
    # From zero at the start of the exposure.
    np.testing.assert_allclose(found, [[0, 0, 0], [0.06, 0, 0]], atol=1e-12)


def test_the_orientation_is_that_at_the_start_of_the_exposure() -> None:
    turning = Rotation.from_rotvec(np.outer(T - EXPOSURE.start, (0.0, 0.5, 0.0)))
    trajectory = Trajectory(T, WAY, turning.as_quat(), EXPOSURE.epoch_ns)
    track = trajectory.translation(EXPOSURE, CAMERA, 1.0)
    # At the start the body's axes are the world's; a rotation about y is interpolated without error.
    np.testing.assert_allclose(track.at(np.array(0.45)), (0.06, 0, 0), atol=1e-12)


def test_without_orientations_positions_are_in_the_cameras_axes() -> None:
    track = Trajectory(T, WAY, None, EXPOSURE.epoch_ns).translation(EXPOSURE, CAMERA, 1.0)
    np.testing.assert_allclose(track.at(np.array(0.45)), (0.06, 0, 0), atol=1e-12)


@pytest.mark.parametrize("early", [2e-10, 9e-10])
def test_an_exposure_may_open_a_tick_of_the_clock_before_the_first_pose(early: float) -> None:
    poses = Rotation.from_rotvec(np.outer(T, (0.0, 0.5, 0.0))).as_quat()
    trajectory = Trajectory(T + EXPOSURE.start + early, WAY, poses, EXPOSURE.epoch_ns)
    whole = replace(trajectory, t=T + EXPOSURE.start)
    first, second = (each.translation(EXPOSURE, CAMERA, 2.0).at(np.array([0.45])) for each in (trajectory, whole))
    # 1 ns of 0.3 m/s.
    np.testing.assert_allclose(first, second, atol=1e-9)
