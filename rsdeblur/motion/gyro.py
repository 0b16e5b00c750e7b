"""Gyroscope samples and the orientation track integrated from them.

`GyroLog` contains the recorded rates, in IMU axes and gyro time. `OrientationTrack` contains the orientation of the
camera, in camera axes and camera time: `C(t)`, camera-from-world, with `dC/dt = -[omega]x C`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import InputError, RsdeblurWarning
from rsdeblur.motion.sensor_log import SensorLog
from rsdeblur.types import FloatArray

if TYPE_CHECKING:
    from rsdeblur.motion.camera import Camera

# rad/s. The range of a consumer gyro ends at 2000 deg/s = 34.9 rad/s, and nobody takes a photo during a sustained turn
# of 5 rad/s (286 deg/s; the fastest pan measured is 3.3 rad/s). A log beyond either is probably in degrees per second.
SUSPICIOUS_PEAK = 35.0
SUSPICIOUS_MEDIAN = 5.0

# rad/s. No gyro gives larger numbers, whatever the unit, and the squares of these do not overflow.
LARGEST_RATE = 1e12

# Most samples during an exposure: 50 s at 200 Hz, 1.25 s at 8 kHz. Every path has two points for each of them.
MOST_SAMPLES = 10_000


@one_line("t", "rate", "span", "epoch_ns")
@dataclass(frozen=True, slots=True, eq=False)
class GyroLog(SensorLog):
    """Angular rates as the gyroscope recorded them.

    Parameters
    ----------
    t : array_like, shape (n,)
        Sample times in s relative to `epoch_ns`, strictly increasing, n >= 2.
    omega : array_like, shape (n, 3)
        Angular rates in rad/s about the IMU's own x, y and z axes, right-handed.
    epoch_ns : int, default 0
        Origin of `t`, in nanoseconds, within 64 bits. It stays an exact integer, because timestamps of 1e18 ns lose
        200 ns in float64.

    Raises
    ------
    InputError
        If an array has a wrong shape, a value is not finite, a rate is beyond 1e12 rad/s, the times do not increase, or
        `epoch_ns` does not fit into 64 bits.

    Warns
    -----
    RsdeblurWarning
        If the rates look like degrees per second: their median is beyond 5 rad/s, or the largest beyond 35 rad/s.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log = rsdeblur.GyroLog(np.arange(200) * 0.005, np.full((200, 3), 0.1))
    >>> log.minus_bias([0.1, 0.1, 0.1]).shifted(2.0)
    GyroLog(t=float64[200], rate=200, span=(2, 2.995), epoch_ns=0)
    """

    SENSOR: ClassVar = "gyro"
    UNIT: ClassVar = "rad/s"
    VALUES: ClassVar = "omega"
    LARGEST: ClassVar = LARGEST_RATE

    t: FloatArray
    omega: FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        self._check()
        self._warn_if_degrees()

    def _warn_if_degrees(self) -> None:
        magnitude = np.sqrt(np.einsum("ij,ij->i", self.omega, self.omega))
        median, peak = float(np.median(magnitude)), float(magnitude.max())
        if median > SUSPICIOUS_MEDIAN or peak > SUSPICIOUS_PEAK:
            warnings.warn(
                f"gyro rates look like degrees per second (median {median:.3g}, peak {peak:.3g}, taken as rad/s); "
                "if they are, multiply by pi/180, or read the log with unit='deg/s' (--unit deg/s)",
                RsdeblurWarning,
                stacklevel=4,
            )

    def minus_bias(self, b: ArrayLike) -> GyroLog:
        """Return the log with a constant rate subtracted from every sample.

        Parameters
        ----------
        b : array_like, shape (3,)
            Bias in rad/s about the IMU's axes.

        Returns
        -------
        GyroLog
            The log without the bias.

        Raises
        ------
        InputError
            If `b` does not have this shape or is not finite.
        """
        return self._derived(omega=self.omega - validate.real_array("b", b, (3,)))


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class OrientationTrack:
    """Camera orientation `C(t)`, camera-from-world, between the samples of a gyro log.

    Rates are interpolated linearly between samples. Each step is the rotation of the fourth-order Magnus expansion, so
    `C` stays a rotation, and a constant rate is integrated without error.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Sample times in s, camera time.
    omega : ndarray, shape (n, 3)
        Rates in rad/s, camera axes.
    rotations : ndarray, shape (n, 3, 3)
        `C(t[i])`; the first is the identity.
    """

    t: FloatArray
    omega: FloatArray
    rotations: FloatArray

    @classmethod
    def from_log(cls, log: GyroLog, camera: Camera, t0: float, t1: float, epoch_ns: int) -> OrientationTrack:
        """Return the track over a span of time, integrated from a gyro log.

        Parameters
        ----------
        log : GyroLog
            Rates that cover the span.
        camera : Camera
            The camera, with the orientation of the IMU and its time offset.
        t0, t1 : float
            Span in camera time, s relative to `epoch_ns`.
        epoch_ns : int
            Origin of the track's times in nanoseconds.

        Returns
        -------
        OrientationTrack
            Track from the last sample before `t0` to the first one after `t1`.

        Raises
        ------
        InputError
            If there are more than 10,000 samples in the span.
        CoverageError, ClockError, GapError
            See :meth:`GyroLog.covering`.
        """
        # camera_time = gyro_time + time_offset
        log = log.covering(t0 - camera.time_offset, t1 - camera.time_offset, epoch_ns)
        if len(log) > MOST_SAMPLES:
            raise InputError(
                f"the exposure from {t0:g} s to {t1:g} s has {len(log)} gyro samples, more than {MOST_SAMPLES}; are "
                "its duration and the readout time in s?"
            )
        return cls.integrated(log.t + camera.time_offset, log.omega @ camera.imu_to_camera.T)

    @classmethod
    def integrated(cls, t: FloatArray, omega: FloatArray) -> OrientationTrack:
        """Return the track of rates in camera axes at increasing times, over gaps as well."""
        steps = rotation_matrix(-_magnus(omega[:-1], omega[1:], np.diff(t)))
        rotations = np.empty((len(t), 3, 3))
        rotations[0] = np.eye(3)
        for i, step in enumerate(steps):
            rotations[i + 1] = step @ rotations[i]
        return cls(t, omega, rotations)

    def at(self, times: FloatArray) -> FloatArray:
        """Return the orientation at given times.

        Parameters
        ----------
        times : ndarray
            Times in s within the track; any shape.

        Returns
        -------
        ndarray, shape ``times.shape + (3, 3)``
            Matrices `C`.
        """
        i, elapsed, omega = self._segment(times)
        rotations: FloatArray = rotation_matrix(-_magnus(self.omega[i], omega, elapsed)) @ self.rotations[i]
        return rotations

    def angles(self, times: FloatArray) -> FloatArray:
        """Return the integral of the rates since the first sample, the small-angle approximation of the rotation.

        Parameters
        ----------
        times : ndarray
            Times in s within the track; any shape.

        Returns
        -------
        ndarray, shape ``times.shape + (3,)``
            Angles in rad about the camera's axes, in no order of rotations.
        """
        i, elapsed, omega = self._segment(times)
        step = 0.5 * (self.omega[1:] + self.omega[:-1]) * np.diff(self.t)[:, None]
        integral = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
        angles: FloatArray = integral[i] + 0.5 * elapsed[..., None] * (self.omega[i] + omega)
        return angles

    def _segment(self, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        """Return the sample before each time, the time since that sample, and the rate at that time."""
        i = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        elapsed = times - self.t[i]
        fraction = elapsed / (self.t[i + 1] - self.t[i])
        return i, elapsed, self.omega[i] + fraction[..., None] * (self.omega[i + 1] - self.omega[i])


def _magnus(omega0: FloatArray, omega1: FloatArray, dt: NDArray[np.float64]) -> FloatArray:
    """Return the rotation vector of a step `dt` in which the rate changes linearly from `omega0` to `omega1`.

    Fourth-order Magnus expansion (Iserles and Norsett 1999): dt (w0 + w1)/2 + dt^2/12 (w0 x w1).
    """
    h = dt[..., None]
    return 0.5 * h * (omega0 + omega1) + h**2 / 12.0 * np.cross(omega0, omega1)


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """Return the matrices `exp([v]x)` of rotation vectors v, shape (..., 3), by Rodrigues' formula."""
    angle = np.sqrt(np.sum(vector**2, axis=-1))[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)
    # sinc(a/pi) = sin(a)/a, and (1 - cos a)/a^2 = sinc(a/2pi)^2 / 2: both regular at zero.
    rotation: FloatArray = (
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)
    )
    return rotation
