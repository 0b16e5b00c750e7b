"""Poses of the camera that another program found: visual-inertial odometry, ARKit, ARCore, motion capture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import InputError
from rsdeblur.motion.axes import imu_to_camera
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Largest deviation of a quaternion's norm from 1. Four decimals deviate by 1e-4.
NORM_TOLERANCE = 0.01


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Positions and orientations of a body, such as a camera or an IMU, in the world.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times in s relative to `epoch_ns`, camera time, strictly increasing, n >= 2.
    position : array_like, shape (n, 3)
        Positions in m, in world axes of any kind.
    quaternion : array_like, shape (n, 4), or None
        Orientations (x, y, z, w), world from body, of norm 1 within 1 %. Without them, positions must be in the
        camera's axes.
    epoch_ns : int, default 0
        Origin of `t`, in nanoseconds, within 64 bits.

    Raises
    ------
    InputError
        If an array has a wrong shape, a value is not finite, the times do not increase, a quaternion's norm is not 1,
        or `epoch_ns` does not fit into 64 bits.

    Examples
    --------
    >>> import rsdeblur
    >>> poses = rsdeblur.motion.Trajectory([0, 1], [[0, 0, 0], [0.02, 0, 0]], [[0, 0, 0, 1], [0, 0, 0, 1]])
    >>> camera, exposure = rsdeblur.Camera(640, 480, 500.0), rsdeblur.Exposure(0.25, 0.05)
    >>> poses.translation(exposure, camera, depth=2.0).depth
    2.0
    """

    t: FloatArray
    position: FloatArray
    quaternion: FloatArray | None
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        # A translation checks the same of its times and positions.
        checked = Translation(self.t, self.position, 1.0, self.epoch_ns)
        for name in ("t", "position", "epoch_ns"):
            object.__setattr__(self, name, getattr(checked, name))
        if self.quaternion is not None:
            quaternion = validate.real_array("quaternion", self.quaternion, (len(checked.t), 4))
            (wrong,) = np.nonzero(np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > NORM_TOLERANCE)
            if wrong.size:
                i = int(wrong[0])
                raise InputError(f"quaternion {i} has the norm {np.linalg.norm(quaternion[i]):.3g} instead of 1")
            object.__setattr__(self, "quaternion", quaternion)

    def translation(
        self, exposure: Exposure, camera: Camera, depth: float | FloatArray, *, axes: str = "camera"
    ) -> Translation:
        """Return the translation during an exposure, for :func:`rsdeblur.deblur`.

        Positions are taken as they are, interpolated linearly. A body beside the camera's centre moves otherwise than
        that when it turns, which is neglected.

        Parameters
        ----------
        exposure, camera
            The time of the exposure, and the camera.
        depth : float or ndarray, shape (R, C)
            Distance of the scene along the optical axis in m, or a map of it, see :class:`rsdeblur.Translation`.
        axes : str, default "camera"
            Axes of the body: "camera" (x right, y down, z forward in the picture as stored), "imu" (those of the gyro
            log, by the camera's `imu_to_camera`), or a preset or an orientation string of
            :func:`rsdeblur.motion.axes.imu_to_camera`. ARKit's and ARCore's camera axes (x right, y up, z back) in a
            picture that is stored as the sensor reads it are "phone-portrait".

        Returns
        -------
        Translation
            Positions in the camera's axes at the start of the exposure.

        Raises
        ------
        InputError
            If `axes` is unknown or `depth` is not positive.
        CoverageError
            If the trajectory does not cover the exposure.
        """
        opens, closes = validate.instance("exposure", exposure, Exposure).span(camera)
        validate.instance("axes", axes, str)
        to_camera = np.eye(3) if axes == "camera" else camera.imu_to_camera if axes == "imu" else imu_to_camera(axes)
        track = Translation(self.t, self.position, depth, self.epoch_ns).covering(opens, closes, exposure.epoch_ns)
        start = track.at(np.array(opens)) * track.middle_depth
        moved = (track.position - start) @ self._orientation(opens, track.t) @ to_camera.T
        return replace(track, position=moved)

    def _orientation(self, time: float, times: FloatArray) -> FloatArray:
        """Return the orientation, world from body, at a time among the trajectory's `times`."""
        if self.quaternion is None:
            return np.eye(3)
        from scipy.spatial.transform import Rotation, Slerp  # takes 0.25 s to import

        # A track may begin or end by a tick of the clock inside the exposure.
        time = float(np.clip(time, times[0], times[-1]))
        i = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 2))
        matrix: FloatArray = Slerp(times[i : i + 2], Rotation.from_quat(self.quaternion[i : i + 2]))(time).as_matrix()
        return matrix
