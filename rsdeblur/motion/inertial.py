"""Positions of the camera from its accelerometer: all of its motion up to a few numbers.

An accelerometer measures the specific force f, its acceleration minus that of gravity g. In world axes, the camera's at
the time t0, the position of the accelerometer is

    P(t) = s(t) + v (t - t0) + g (t - t0)^2 / 2,    s'' = C(t)^T f(t), s(t0) = s'(t0) = 0,

where the gyro gives the orientation C, and the velocity v at t0 and gravity are unknown. A constant error of the
accelerometer has the same effect as one of gravity while the camera hardly turns. A picture shows P / Z, where Z is the
depth of the scene: seven unknowns, in which every displacement in the picture is linear if they are 1/Z, v/Z and g/Z.
:func:`fit_drifts` finds them from displacements that were measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.motion.acceleration import AccelerationLog
from rsdeblur.motion.arguments import exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.track import MOST_RECORDED, OrientationTrack
from rsdeblur.motion.translation import CLOCK_TICK, Translation
from rsdeblur.types import FloatArray

# Times of an exposure at which a straight line is fitted to a path.
LINE_SAMPLES = 33

# m. Depth from which a fit starts: that of a room.
FIRST_DEPTH = 3.0


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class InertialTrack:
    """Positions of the camera during a recording, up to gravity, start velocity and depth.

    Use :meth:`from_logs` to make one. World axes are those of the camera at the first time.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s relative to `epoch_ns`, camera time.
    path : ndarray, shape (n, 3)
        Positions of the camera's centre in m, in world axes, without gravity and from rest: s(t).
    speed : ndarray, shape (n, 3)
        Velocities of the accelerometer on that path in m/s: s'(t) without the part of the lever.
    orientation : OrientationTrack
        Orientation of the camera over time, of any world.
    epoch_ns : int
        Origin of `t` in nanoseconds.
    gravity : ndarray, shape (3,)
        Acceleration of gravity in m/s^2, in world axes, of a camera that ends with the velocity it started with. The
        longer the recording, the better this holds: hands reach some 0.1 m/s.
    """

    t: FloatArray
    path: FloatArray
    speed: FloatArray
    orientation: OrientationTrack
    epoch_ns: int
    gravity: FloatArray

    def __post_init__(self) -> None:
        for array in (self.t, self.path, self.speed, self.gravity):
            array.setflags(write=False)

    @classmethod
    def from_logs(
        cls,
        log: GyroLog,
        acceleration: AccelerationLog,
        camera: Camera,
        t0: float,
        t1: float,
        epoch_ns: int = 0,
        *,
        lever: ArrayLike = (0.0, 0.0, 0.0),
    ) -> InertialTrack:
        """Return the track over a span of time.

        Parameters
        ----------
        log : GyroLog
            Rates that cover the span.
        acceleration : AccelerationLog
            Specific forces that cover the span, on the gyro's clock and in its axes.
        camera : Camera
            The camera, with the orientation of the IMU and its time offset.
        t0, t1 : float
            Span in camera time, s relative to `epoch_ns`, `t0 < t1`; for one exposure, :meth:`Exposure.span`.
        epoch_ns : int, default 0
            Origin of the times in nanoseconds.
        lever : array_like, shape (3,)
            Position of the camera's centre relative to the accelerometer, in m, in the camera's axes.

        Returns
        -------
        InertialTrack
            The track, from `t0` to `t1`.

        Raises
        ------
        InputError
            If a number is not finite or `t1` is not after `t0`.
        CoverageError, ClockError, GapError
            If a log does not describe the span, see :meth:`GyroLog.covering`.
        """
        validate.instance("log", log, GyroLog)
        validate.instance("acceleration", acceleration, AccelerationLog)
        validate.instance("camera", camera, Camera)
        t0 = validate.time("t0", t0)
        t1 = validate.time("t1", t1, above=t0)
        arm = validate.real_array("lever", lever, (3,))
        track = OrientationTrack.from_log(log, camera, t0, t1, epoch_ns, most=MOST_RECORDED)
        offset = camera.time_offset
        samples = acceleration.covering(t0 - offset, t1 - offset, epoch_ns)
        timestamps = np.union1d(samples.t + offset, track.t)
        t = np.concatenate([[t0], timestamps[(timestamps > t0) & (timestamps < t1)], [t1]])
        rotations = track.at(t)
        rotations = rotations @ rotations[0].T
        force = np.stack([np.interp(t, samples.t + offset, axis) for axis in samples.force.T], axis=-1)
        force = np.einsum("tji,tj->ti", rotations, force @ camera.imu_to_camera.T)
        # The force is linear between the times, so both integrals are exact.
        step = np.diff(t)[:, None]
        start = np.zeros((1, 3))
        speed = np.concatenate([start, np.cumsum(0.5 * step * (force[1:] + force[:-1]), axis=0)])
        way = step * speed[:-1] + step**2 / 6.0 * (2.0 * force[:-1] + force[1:])
        path = np.concatenate([start, np.cumsum(way, axis=0)]) + rotations.transpose(0, 2, 1) @ arm - arm
        gravity = -speed[-1] / (t1 - t0)
        return cls(t, path, speed, track, epoch_ns, gravity)

    def during(self, exposure: Exposure, camera: Camera) -> InertialTrack:
        """Return the track of one exposure, which starts anew: with the velocity at its start as the unknown.

        Parameters
        ----------
        exposure : Exposure
            The exposure, within the track.
        camera : Camera
            The camera.

        Returns
        -------
        InertialTrack
            The track during the exposure, in the camera's axes at its start, with this track's gravity.

        Raises
        ------
        CoverageError
            If the track does not cover the exposure.
        """
        opens, closes = self._span(exposure, camera)
        t = self._times(opens, closes)
        turn = self._orientation(opens)
        path, speed = (
            np.stack([np.interp(t, self.t, axis) for axis in each.T], axis=-1) for each in (self.path, self.speed)
        )
        path = path - path[0] - speed[0] * (t - opens)[:, None]
        shift = (self.epoch_ns - exposure.epoch_ns) * 1e-9
        return InertialTrack(
            t=t + shift,
            path=path @ turn.T,
            speed=(speed - speed[0]) @ turn.T,
            orientation=replace(self.orientation, t=self.orientation.t + shift),
            epoch_ns=exposure.epoch_ns,
            gravity=turn @ self.gravity,
        )

    def position(self, times: ArrayLike, velocity: ArrayLike, gravity: ArrayLike | None = None) -> FloatArray:
        """Return the positions of the camera's centre.

        Parameters
        ----------
        times : array_like
            Times in s relative to `epoch_ns`, within the track; any shape.
        velocity : array_like, shape (3,)
            Velocity of the accelerometer at the start of the track in m/s, in world axes.
        gravity : array_like, shape (3,), optional
            Gravity in m/s^2, in world axes; by default :attr:`gravity`.

        Returns
        -------
        ndarray, shape ``times.shape + (3,)``
            Positions in m, in world axes, relative to that at the start of the track.

        Raises
        ------
        InputError
            If an array has a wrong shape or a value is not finite.
        """
        times = validate.real_array("times", times)
        velocity = validate.real_array("velocity", velocity, (3,))
        gravity = validate.real_array("gravity", self.gravity if gravity is None else gravity, (3,))
        since = (times - self.t[0])[..., None]
        path = np.stack([np.interp(times, self.t, axis) for axis in self.path.T], axis=-1)
        position: FloatArray = path + velocity * since + 0.5 * gravity * since**2
        return position

    def translation(
        self,
        exposure: Exposure,
        camera: Camera,
        depth: float | FloatArray,
        velocity: ArrayLike,
        gravity: ArrayLike | None = None,
    ) -> Translation:
        """Return the translation during an exposure, for :func:`rsdeblur.deblur`.

        Parameters
        ----------
        exposure : Exposure
            The exposure, within the track.
        camera : Camera
            The camera.
        depth : float or ndarray, shape (R, C)
            Distance of the scene along the optical axis in m, or a map of it, see :class:`rsdeblur.Translation`.
        velocity, gravity
            See :meth:`position`: the velocity is that at the start of the track.

        Returns
        -------
        Translation
            Positions in the camera's axes at the start of the exposure.

        Raises
        ------
        InputError
            If a value is out of its range.
        CoverageError
            If the track does not cover the exposure.
        """
        opens, closes = self._span(exposure, camera)
        t = self._times(opens, closes)
        position = self.position(t, velocity, gravity)
        moved = (position - position[0]) @ self._orientation(opens).T
        return Translation(t + (self.epoch_ns - exposure.epoch_ns) * 1e-9, moved, depth, exposure.epoch_ns)

    def _span(self, exposure: Exposure, camera: Camera) -> tuple[float, float]:
        """Return the start and the end of an exposure, in the track's times and within them."""
        span = validate.instance("exposure", exposure, Exposure).span(camera)
        opens, closes = (edge + (exposure.epoch_ns - self.epoch_ns) * 1e-9 for edge in span)
        first, last = float(self.t[0]), float(self.t[-1])
        if opens < first - CLOCK_TICK or closes > last + CLOCK_TICK:
            raise CoverageError(
                f"the inertial track spans {first:.4f} s to {last:.4f} s, the exposure needs {opens:.4f} s to "
                f"{closes:.4f} s; use a longer track"
            )
        return max(opens, first), min(closes, last)

    def _times(self, opens: float, closes: float) -> FloatArray:
        """Return a start, the track's times after it, and an end."""
        return np.concatenate([[opens], self.t[(self.t > opens) & (self.t < closes)], [closes]])

    def _orientation(self, time: float) -> FloatArray:
        """Return the orientation at a time, camera from world."""
        rotation, start = self.orientation.at(np.array([time, self.t[0]]))
        turned: FloatArray = rotation @ start.T
        return turned


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class DriftFit:
    """Motion of the camera during a recording, from drifts of pictures and the accelerometer.

    Parameters
    ----------
    velocity : ndarray, shape (3,)
        Velocity at the start of the track in m/s, in its world axes.
    gravity : ndarray, shape (3,)
        Acceleration of gravity in m/s^2, in the same axes, minus the constant error of the accelerometer.
    depth : float
        Depth of the scene in m.
    drifts : ndarray, shape (k, 2)
        The drifts that these values predict, in px.
    r2 : float
        Share of the measured drifts' sum of squares that the predicted ones explain, at most 1.
    """

    velocity: FloatArray
    gravity: FloatArray
    depth: float
    drifts: FloatArray
    r2: float


def fit_drifts(
    track: InertialTrack,
    camera: Camera,
    exposures: Sequence[Exposure],
    drifts: ArrayLike,
    *,
    pixels: ArrayLike | None = None,
    drift_sd: float = 0.5,
    velocity_sd: float = 0.1,
    gravity_sd: float = 0.1,
) -> DriftFit:
    """Find start velocity, gravity and depth from the drifts of several pictures of one recording.

    A drift is the displacement over the exposure of a part of the picture, beyond what its rotation explains, as a
    straight and even movement. The same part of the scene must be measured in all pictures, or parts at one depth.

    The fit minimises the squares of the differences to the drifts, to the velocity 0 and to the track's gravity, each
    divided by its standard deviation.

    Parameters
    ----------
    track : InertialTrack
        Track that covers the exposures.
    camera : Camera
        The camera.
    exposures : sequence of Exposure, length k
        The exposures.
    drifts : array_like, shape (k, 2)
        Drifts as (x, y) in px: the way of the scene in the picture, x right, y down.
    pixels : array_like, shape (k, 2), optional
        Where the drifts were measured, as (x, y) in px; by default at the principal point.
    drift_sd : float, default 0.5
        Standard deviation of the drifts in px, from 1e-12 to 1e12.
    velocity_sd : float, default 0.1
        Standard deviation of the start velocity in m/s, from 1e-12 to 1e12: that of a hand.
    gravity_sd : float, default 0.1
        Standard deviation of the track's gravity in m/s^2, from 1e-12 to 1e12: the change of velocity over the
        duration.

    Returns
    -------
    DriftFit
        The best values.

    Raises
    ------
    InputError
        If there is no drift, a number is out of its range, or the drifts contradict the accelerometer: their best fit
        has no positive depth.
    CoverageError
        If the track does not cover an exposure.
    """
    from scipy.optimize import least_squares  # takes 0.2 s to import

    validate.instance("track", track, InertialTrack)
    validate.instance("camera", camera, Camera)
    exposures = exposure_list(exposures)
    measured = validate.real_array("drifts", drifts, (len(exposures), 2))
    if not len(exposures):
        raise InputError("exposures must contain at least one exposure")
    places = np.tile(camera.principal_point, (len(exposures), 1)) if pixels is None else pixels
    rays = camera.rays(validate.real_array("pixels", places, (len(exposures), 2)))
    deviations = {"drift_sd": drift_sd, "velocity_sd": velocity_sd, "gravity_sd": gravity_sd}
    drift_sd, *others = (validate.finite(name, sd, minimum=1e-12, maximum=1e12) for name, sd in deviations.items())
    pairs = zip(exposures, rays / rays[:, 2:], strict=True)
    matrix = np.concatenate([_drifts_of(track, camera, *pair) for pair in pairs])
    prior = np.concatenate([np.zeros(3), track.gravity])
    scale = np.repeat(others, 3)

    def residuals(values: FloatArray) -> FloatArray:
        misfit = values[0] * (matrix[:, 0] + matrix[:, 1:] @ values[1:]) - measured.ravel()
        return np.concatenate([misfit / drift_sd, (values[1:] - prior) / scale])

    start = np.concatenate([[1.0 / FIRST_DEPTH], prior])
    values = least_squares(residuals, start, x_scale=np.array([1.0 / FIRST_DEPTH, *scale])).x
    if values[0] <= 0:
        raise InputError("the drifts contradict the accelerometer: their best fit has no positive depth")
    misfit = residuals(values)[: measured.size].reshape(-1, 2) * drift_sd
    return DriftFit(
        velocity=values[1:4],
        gravity=values[4:],
        depth=1.0 / float(values[0]),
        drifts=measured + misfit,
        r2=1.0 - float(np.sum(misfit**2) / max(np.sum(measured**2), np.finfo(float).tiny)),
    )


def _drifts_of(track: InertialTrack, camera: Camera, exposure: Exposure, ray: FloatArray) -> FloatArray:
    """Return the drift at a depth of 1 m of s(t), and for unit values of v (3) and g (3), shape (2, 7)."""
    opens, closes = track._span(exposure, camera)
    times = np.linspace(opens, closes, LINE_SAMPLES)
    none, axes = np.zeros(3), np.eye(3)
    path = track.position(times, none, none)
    paths = [path]
    paths += [track.position(times, axis, none) - path for axis in axes]
    paths += [track.position(times, none, axis) - path for axis in axes]
    moved = np.stack(paths, axis=-1)  # (T, 3, 7)
    moved = np.einsum("ij,tjk->tik", track._orientation(opens), moved)
    # The way of a straight line fitted to the path.
    share = np.linspace(-0.5, 0.5, LINE_SAMPLES)
    way = np.einsum("t,tik->ik", share / np.sum(share**2), moved)
    focal = np.array(camera.focal_length)[:, None]
    drift: FloatArray = -focal * (way[:2] - ray[:2, None] * way[2])
    return drift
