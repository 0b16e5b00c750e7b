"""Samples of an accelerometer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.sensor_log import SensorLog
from rsdeblur.types import FloatArray

# Time before and after an exposure over which the force is averaged, s: hands accelerate a camera to and fro.
AROUND = 0.25
# Least share of gravity in the plane of the picture that tells where its bottom is: the camera looks at most 60 degrees
# up or down.
LEAST_IN_PLANE = 0.5


@one_line("t", "rate", "span", "epoch_ns")
@dataclass(frozen=True, slots=True, eq=False)
class AccelerationLog(SensorLog):
    """Specific forces as the accelerometer recorded them: its acceleration minus that of gravity.

    At rest, an accelerometer shows 9.8 m/s^2 upwards.

    Parameters
    ----------
    t : array_like, shape (n,)
        Sample times in s relative to `epoch_ns`, strictly increasing, n >= 2, on the gyro's clock.
    force : array_like, shape (n, 3)
        Specific forces in m/s^2 along the IMU's x, y and z axes, which are those of the gyro log.
    epoch_ns : int, default 0
        Origin of `t`, in nanoseconds, within 64 bits.

    Raises
    ------
    InputError
        If an array has a wrong shape, a value is not finite, a force is beyond 1e12 m/s^2, the times do not increase,
        or `epoch_ns` does not fit into 64 bits.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.motion.AccelerationLog([0.0, 0.01, 0.02], [[0, 0, 9.81]] * 3)
    AccelerationLog(t=[0, 0.01, 0.02], rate=100, span=(0, 0.02), epoch_ns=0)
    """

    SENSOR: ClassVar = "accelerometer"
    UNIT: ClassVar = "m/s^2"
    VALUES: ClassVar = "force"

    t: FloatArray
    force: FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        self._check()

    def gravity_angle(self, camera: Camera, exposure: Exposure) -> float | None:
        """Return the angle in the picture by which gravity is turned from the picture's bottom towards its right.

        In an upright picture it is small, and that of a camera held upside down is near pi. A large angle means that
        the picture is not upright, that the accelerometer shows the opposite sign (raw values of iOS), or that the
        camera's `imu_to_camera` is wrong.

        Parameters
        ----------
        camera, exposure
            The camera, and the time of the picture.

        Returns
        -------
        float or None
            In rad, from -pi to pi; None where the camera looks up or down by more than 60 degrees, or the log has no
            samples within 0.25 s of the exposure.

        Examples
        --------
        >>> import rsdeblur
        >>> log = rsdeblur.motion.AccelerationLog([0.0, 0.1, 0.2], [[0, 9.8, 0]] * 3)
        >>> portrait = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
        >>> camera = rsdeblur.Camera(480, 640, 500.0, imu_to_camera=portrait)
        >>> abs(log.gravity_angle(camera, rsdeblur.Exposure(0.1, 0.02))) < 1e-6
        True
        """
        validate.instance("camera", camera, Camera)
        opens, closes = validate.instance("exposure", exposure, Exposure).span(camera)
        t = self.t + (1e-9 * (self.epoch_ns - exposure.epoch_ns) + camera.time_offset)
        near = (t >= opens - AROUND) & (t <= closes + AROUND)
        if not near.any():
            return None
        right, down, _ = gravity = -camera.imu_to_camera @ self.force[near].mean(axis=0)
        in_plane = np.hypot(right, down)
        return float(np.arctan2(right, down)) if in_plane > LEAST_IN_PLANE * np.linalg.norm(gravity) else None
