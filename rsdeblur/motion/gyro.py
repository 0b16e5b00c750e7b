"""Gyroscope samples and the orientation track integrated from them.

`GyroLog` contains the recorded rates, in IMU axes and gyro time. `OrientationTrack` contains the orientation of the
camera, in camera axes and camera time: `C(t)`, camera-from-world, with `dC/dt = -[omega]x C`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.errors import ClockError, CoverageError, GapError, InputError, RsdeblurWarning
from rsdeblur.types import FloatArray

if TYPE_CHECKING:
    from rsdeblur.motion.camera import Camera

# rad/s. The range of a consumer gyro ends at 2000 deg/s = 34.9 rad/s, and nobody takes a photo during a sustained turn
# of 5 rad/s (286 deg/s; the fastest pan measured is 3.3 rad/s). A log beyond either is probably in degrees per second.
SUSPICIOUS_PEAK = 35.0
SUSPICIOUS_MEDIAN = 5.0

# rad/s. No gyro gives larger numbers, whatever the unit, and the squares of these do not overflow.
LARGEST_RATE = 1e12

# s. A log further than this from the exposure is neither late nor early: its clock has another origin.
UNRELATED_CLOCK = 60.0

# Most samples during an exposure: 50 s at 200 Hz, 1.25 s at 8 kHz. Every path has two points for each of them.
MOST_SAMPLES = 10_000

# Samples before and after an exposure that the median interval is taken from.
NEIGHBOURS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class GyroLog:
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
    """

    t: FloatArray
    omega: FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        t = validate.real_array("t", self.t, (None,))
        omega = validate.real_array("omega", self.omega, (None, 3))
        if len(t) != len(omega):
            raise InputError(f"t and omega must have the same length, got {len(t)} and {len(omega)}")
        if len(t) < 2:
            raise InputError(f"a gyro log needs at least 2 samples, got {len(t)}")
        if max(omega.max(), -omega.min()) > LARGEST_RATE:
            i, axis = map(int, np.argwhere(np.abs(omega) > LARGEST_RATE)[0])
            raise InputError(f"omega must be rates in rad/s, got {omega[i, axis]:g} about {'xyz'[axis]} in sample {i}")
        step = np.diff(t)
        if step.min() <= 0:
            i = int(np.argmin(step > 0))
            kind = "a duplicate" if step[i] == 0 else "out of order"
            raise InputError(
                f"t must increase: sample {i + 1} (t = {t[i + 1]:.9f} s) is {kind} after sample {i} "
                f"(t = {t[i]:.9f} s); sort the samples and drop repeated timestamps"
            )
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "omega", omega)
        object.__setattr__(self, "epoch_ns", validate.nanoseconds("epoch_ns", self.epoch_ns))
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

    def _derived(self, **changes: FloatArray | int) -> GyroLog:
        """Return a changed copy of this valid log, without the checks and without a second warning."""
        log = object.__new__(GyroLog)
        for name in ("t", "omega", "epoch_ns"):
            value = changes.get(name, getattr(self, name))
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(log, name, value)
        return log

    def __len__(self) -> int:
        return len(self.t)

    @property
    def rate(self) -> float:
        """Sampling rate in Hz: the inverse of the median interval."""
        return float(1.0 / np.median(np.diff(self.t)))

    @property
    def span(self) -> tuple[float, float]:
        """First and last sample time in s relative to `epoch_ns`."""
        return float(self.t[0]), float(self.t[-1])

    def gaps(self, *, factor: float = 3.0) -> FloatArray:
        """Return the gaps of the log: intervals longer than `factor` times the median interval.

        Parameters
        ----------
        factor : float, default 3.0
            Greater than 1.

        Returns
        -------
        ndarray, shape (k, 2)
            Times in s relative to `epoch_ns` of the samples before and after each gap.

        Raises
        ------
        InputError
            If `factor` is not a finite number greater than 1.
        """
        factor = validate.finite("factor", factor, above=1.0)
        step = np.diff(self.t)
        (i,) = np.nonzero(step > factor * np.median(step))
        return np.stack([self.t[i], self.t[i + 1]], axis=1)

    def shifted(self, dt: float) -> GyroLog:
        """Return the log with other sample times.

        Parameters
        ----------
        dt : float
            Seconds added to every sample time.

        Returns
        -------
        GyroLog
            The log that is `dt` later.

        Raises
        ------
        InputError
            If `dt` is not finite, or is so large that rounding makes sample times equal.
        """
        t = self.t + validate.finite("dt", dt)
        if (np.diff(t) <= 0).any():
            raise InputError(
                f"dt = {dt:g} s is so large that rounding makes sample times equal; change epoch_ns instead"
            )
        return self._derived(t=t)

    def trimmed(self, t0: float, t1: float) -> GyroLog:
        """Return the samples from the last one at or before `t0` to the first one at or after `t1`.

        The samples just outside are kept so that rates can be interpolated over all of [t0, t1]. At least two samples
        remain.

        Parameters
        ----------
        t0, t1 : float
            Times in s relative to `epoch_ns`, `t0 <= t1`.

        Returns
        -------
        GyroLog
            Part of the log.

        Raises
        ------
        InputError
            If a time is not finite, `t1` is before `t0`, or the log has no sample between them.
        """
        t0, t1 = validate.finite("t0", t0), validate.finite("t1", t1)
        if t1 < t0:
            raise InputError(f"t1 must not be before t0, got t0 = {t0} and t1 = {t1}")
        if t1 < self.t[0] or t0 > self.t[-1]:
            raise InputError(f"no samples between {t0} s and {t1} s: the log spans {self.t[0]} s to {self.t[-1]} s")
        first = int(np.clip(np.searchsorted(self.t, t0, side="right") - 1, 0, len(self) - 2))
        last = int(np.clip(np.searchsorted(self.t, t1, side="left") + 1, first + 2, len(self)))
        return self._derived(t=self.t[first:last], omega=self.omega[first:last])

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

    def covering(self, t0: float, t1: float, epoch_ns: int) -> GyroLog:
        """Return the samples that describe [t0, t1], with their times relative to another epoch.

        Parameters
        ----------
        t0, t1 : float
            Gyro time in s relative to the new epoch.
        epoch_ns : int
            The new epoch in nanoseconds.

        Returns
        -------
        GyroLog
            Part of the log, with the new epoch.

        Raises
        ------
        ClockError
            If the log is more than a minute away: the clocks are unrelated.
        CoverageError
            If the log starts too late or ends too early.
        GapError
            If the log has a gap inside [t0, t1].
        """
        t0, t1 = validate.finite("t0", t0), validate.finite("t1", t1)
        epoch_ns = validate.nanoseconds("epoch_ns", epoch_ns)
        # The difference of the epochs is exact: both are integers.
        shift = (self.epoch_ns - epoch_ns) * 1e-9
        start, end = (edge + shift for edge in self.span)
        late, early = start - t0, t1 - end
        if max(late, early) > UNRELATED_CLOCK:
            raise ClockError(
                f"the gyro log and the exposure are on unrelated clocks: the log spans {start:.3f} s to {end:.3f} s, "
                f"the exposure needs {t0:.3f} s to {t1:.3f} s (both relative to {epoch_ns} ns, after the time offset); "
                "give the time offset between the clocks"
            )
        if late > 0 or early > 0:
            missing = [f"{1e3 * late:.3f} ms at its start"] * (late > 0) + [f"{1e3 * early:.3f} ms at its end"] * (
                early > 0
            )
            raise CoverageError(
                f"the gyro log does not cover the exposure: it misses {' and '.join(missing)}; "
                "check the time offset, the capture's stamp and the readout time, or use a longer log"
            )
        # The median interval is taken from the neighbourhood: for all samples of a day it would take a second.
        first, last = np.searchsorted(self.t, (t0 - shift, t1 - shift))
        near = slice(max(first - NEIGHBOURS, 0), last + NEIGHBOURS)
        log = self._derived(t=self.t[near] + shift, omega=self.omega[near], epoch_ns=epoch_ns)
        for before, after in log.gaps():
            if before < t1 and after > t0:
                raise GapError(
                    f"the gyro log has a gap of {1e3 * (after - before):.1f} ms inside the exposure, "
                    f"{1e3 * (before - t0):.1f} ms after the first row opens; the motion there is unknown"
                )
        return log.trimmed(t0, t1)


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
        t = log.t + camera.time_offset
        omega = log.omega @ camera.imu_to_camera.T
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
