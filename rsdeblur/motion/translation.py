"""Positions of the camera, which a gyroscope does not measure, with the depth of the scene; poses of other programs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.motion.axes import imu_to_camera
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.camera_values import MOST_PIXELS
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import checked_samples
from rsdeblur.types import FloatArray

# s. Times relative to different epochs differ by less, from rounding; clocks count in it.
CLOCK_TICK = 1e-9
# Largest deviation of a quaternion's norm from 1. Four decimals deviate by 1e-4.
NORM_TOLERANCE = 0.01


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Translation:
    """Positions of the camera over time, and the depth of the scene.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times in s relative to `epoch_ns`, camera time, strictly increasing, n >= 2.
    position : array_like, shape (n, 3)
        Positions of the camera's centre in m, in the camera's axes (x right, y down, z forward) at the start of the
        exposure, from any origin; interpolated linearly between the times.
    depth : float or array_like, shape (R, C)
        Distance of the scene along the optical axis in m, positive: of the whole scene, or at R x C places that are
        spread evenly over the picture as stored, from corner to corner. Between them its inverse is interpolated
        linearly, which is exact for planes.
    epoch_ns : int, default 0
        Origin of `t`, in nanoseconds, within 64 bits.

    Raises
    ------
    InputError
        If an array has a wrong shape, a value is not finite, the times do not increase, a depth is not positive, or
        `epoch_ns` does not fit into 64 bits.

    Examples
    --------
    >>> import rsdeblur
    >>> sideways = rsdeblur.Translation([0.2, 0.3], [[0, 0, 0], [0.002, 0, 0]], depth=1.5)
    >>> camera, exposure = rsdeblur.Camera(64, 48, 600.0), rsdeblur.Exposure(0.22, 0.05)
    >>> still = rsdeblur.GyroLog([0, 1], [[0, 0, 0], [0, 0, 0]])
    >>> rsdeblur.psfs(still, camera, exposure, mode="global", translation=sideways).size
    (3, 3)
    """

    t: FloatArray
    position: FloatArray
    depth: float | FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        t, position = checked_samples(self.t, "position", self.position)
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "depth", _depths(self.depth))
        object.__setattr__(self, "epoch_ns", validate.nanoseconds("epoch_ns", self.epoch_ns))

    @classmethod
    def drift(
        cls,
        px: ArrayLike,
        camera: Camera,
        exposure: Exposure,
        *,
        acceleration: ArrayLike = (0.0, 0.0),
        known: Translation | None = None,
    ) -> Translation:
        """Return the motion under which the scene moves by a number of pixels during the exposure.

        Parameters
        ----------
        px : array_like, shape (2,)
            Shift of the scene in the picture, (x, y) in px, from -1e6 to 1e6, during the exposure of a row; of what is
            at the median depth, if a map of depths is known.
        camera : Camera
            Camera of the picture as stored.
        exposure : Exposure
            The exposure.
        acceleration : array_like, shape (2,), default (0, 0)
            Acceleration of the scene in the picture, (x, y) in px/s^2, from -1e9 to 1e9. The velocity is that of the
            drift in the middle of the exposure of all rows; without acceleration it is constant.
        known : Translation, optional
            Track to which it is added; by default one around the exposure, of a scene at 1 m.

        Returns
        -------
        Translation
            The track. Only the ratio of its speed and depth matters.

        Examples
        --------
        >>> import rsdeblur
        >>> camera, exposure = rsdeblur.Camera(64, 48, 600.0), rsdeblur.Exposure(0.22, 0.05)
        >>> still = rsdeblur.GyroLog([0, 1], [[0, 0, 0], [0, 0, 0]])
        >>> drift = rsdeblur.Translation.drift((4, 0), camera, exposure)
        >>> bank = rsdeblur.psfs(still, camera, exposure, mode="global", translation=drift)
        >>> bank.kernels[0, 0].sum(axis=0).round(3)
        array([0.   , 0.125, 0.25 , 0.25 , 0.25 , 0.125, 0.   ], dtype=float32)
        """
        validate.instance("camera", camera, Camera)
        opens, closes = validate.instance("exposure", exposure, Exposure).span(camera)
        margin = closes - opens
        if known is not None:
            validate.instance("known", known, Translation)
        else:
            known = cls(np.array([opens - margin, closes + margin]), np.zeros((2, 3)), 1.0, exposure.epoch_ns)
        px = validate.real_array("px", px, (2,), most=MOST_PIXELS)
        acceleration = validate.real_array("acceleration", acceleration, (2,), most=1e9)
        # The scene moves against the camera.
        px, acceleration = (
            np.append(-each / np.array(camera.focal_length), 0.0) * known.middle_depth for each in (px, acceleration)
        )
        t, position = known.t, known.position
        if acceleration.any():
            # Between 33 samples the motion is straight: a thousandth of its bend is lost.
            samples = np.linspace(opens, closes, 33) + (exposure.epoch_ns - known.epoch_ns) * 1e-9
            # A track that does not cover the exposure still does not.
            t = np.union1d(t, samples[(samples > t[0]) & (samples < t[-1])])
            position = np.stack([np.interp(t, known.t, axis) for axis in position.T], axis=-1)
            position = position + 0.5 * acceleration * np.square(t - samples.mean())[:, None]
        return replace(known, t=t, position=position + t[:, None] * (px / exposure.duration))

    def covering(self, t0: float, t1: float, epoch_ns: int) -> Translation:
        """Return the whole track with its times relative to another epoch.

        Parameters
        ----------
        t0, t1 : float
            Times that the track must cover, in s relative to the new epoch.
        epoch_ns : int
            The new epoch in nanoseconds.

        Raises
        ------
        CoverageError
            If the track does not cover [t0, t1].
        """
        t0, t1 = validate.time("t0", t0), validate.time("t1", t1)
        epoch_ns = validate.nanoseconds("epoch_ns", epoch_ns)
        t = self.t + (self.epoch_ns - epoch_ns) * 1e-9
        if t[0] > t0 + CLOCK_TICK or t[-1] < t1 - CLOCK_TICK:
            raise CoverageError(
                f"the translation track spans {t[0]:.4f} s to {t[-1]:.4f} s, the exposure needs {t0:.4f} s to "
                f"{t1:.4f} s; use a longer track"
            )
        return replace(self, t=t, epoch_ns=epoch_ns)

    @property
    def middle_depth(self) -> float:
        """The depth, or the median of the depths, in m."""
        return self.depth if isinstance(self.depth, float) else float(np.median(self.depth))

    def at(self, times: FloatArray) -> FloatArray:
        """Return the positions at given times, in units of `middle_depth`, shape ``times.shape + (3,)``.

        Parameters
        ----------
        times : ndarray
            Times in s relative to `epoch_ns`; any shape.
        """
        times = validate.array("times", times)
        return np.stack([np.interp(times, self.t, axis) for axis in self.position.T], axis=-1) / self.middle_depth

    def relative_depth(self, across: FloatArray, down: FloatArray) -> FloatArray:
        """Return the depth at places of the picture, in units of `middle_depth`.

        Parameters
        ----------
        across, down : ndarray
            Places as shares of the way from the first to the last column, and from the first to the last row. Beyond
            the picture, the depth of its border continues.
        """
        if isinstance(self.depth, float):
            return np.ones(np.shape(across))
        from scipy import ndimage  # imported here: it takes 0.2 s, which other recordings need not spend

        inverse = self.middle_depth / self.depth
        places = [place * (n - 1) for place, n in zip((down, across), inverse.shape, strict=True)]
        return 1 / ndimage.map_coordinates(inverse, places, order=1, mode="nearest")

    def cropped(self, camera: Camera, left: int, top: int, width: int, height: int) -> Translation:
        """Return the track for a part of the picture, see :meth:`rsdeblur.Camera.cropped`.

        Parameters
        ----------
        camera : Camera
            Camera of the whole picture.
        left, top, width, height : int
            The part, in px.

        Returns
        -------
        Translation
            The track in the time of the part's camera. A map of depths has four times as many points in the part as the
            whole map in the whole picture.

        Raises
        ------
        InputError
            If the part does not fit into the picture.
        """
        validate.instance("camera", camera, Camera)
        later = camera.cropped(left, top, width, height).time_offset - camera.time_offset
        moved = replace(self, t=self.t + later)
        if isinstance(self.depth, float):
            return moved
        spans = ((top, height, camera.height), (left, width, camera.width))
        # The part has four times as many points of depth as the whole; between them the inverse depth is linear.
        down, across = (
            np.linspace(first, first + size - 1, 4 * (count - 1) + 1) / max(whole - 1, 1)
            for (first, size, whole), count in zip(spans, self.depth.shape, strict=True)
        )
        return replace(moved, depth=self.relative_depth(*np.meshgrid(across, down)) * self.middle_depth)

    def turned(self) -> Translation:
        """Return the track in the axes of the turned camera, see :meth:`rsdeblur.Camera.turned`."""
        x, y, z = self.position.T
        depth = self.depth if isinstance(self.depth, float) else np.rot90(self.depth, -1)
        return replace(self, position=np.stack([-y, x, z], axis=-1), depth=depth)


def _depths(depth: float | ArrayLike) -> float | FloatArray:
    """Return one positive depth, or a grid of them."""
    if validate.array("depth", depth).ndim == 0:
        return validate.finite("depth", depth, above=0.0)
    depths = validate.real_array("depth", depth, (None, None))
    if not depths.size or (depths <= 0).any():
        raise InputError(f"depth must be positive, got {depths.min() if depths.size else 'no number'}")
    return depths


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
        turn = np.eye(3)  # world from body
        if self.quaternion is not None:
            from scipy.spatial.transform import Rotation, Slerp  # takes 0.25 s to import

            # A track may begin or end by a tick of the clock inside the exposure.
            time = float(np.clip(opens, track.t[0], track.t[-1]))
            turn = Slerp(track.t, Rotation.from_quat(self.quaternion))(time).as_matrix()
        return replace(track, position=(track.position - start) @ turn @ to_camera.T)
