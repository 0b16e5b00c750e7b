"""Samples of the gyroscope and of the accelerometer, in IMU axes and gyro time, and gravity as these show it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import ClockError, CoverageError, GapError, InputError, RsdeblurWarning
from rsdeblur.motion.axes import PRESETS, imu_to_camera
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.units import SLOWEST
from rsdeblur.types import FloatArray

# rad/s or m/s^2. No sensor gives larger numbers, whatever the unit, and the squares of these do not overflow.
LARGEST = 1e12

# s. A log further than this from the exposure is neither late nor early: its clock has another origin.
UNRELATED_CLOCK = 60.0

# Samples before and after an exposure that the median interval is taken from.
NEIGHBOURS = 1000

# rad/s. The range of a consumer gyro ends at 2000 deg/s = 34.9 rad/s, and nobody takes a photo during a sustained turn
# of 5 rad/s (286 deg/s; the fastest pan measured is 3.3 rad/s). A log beyond either is probably in degrees per second.
SUSPICIOUS_PEAK = 35.0
SUSPICIOUS_MEDIAN = 5.0

# Time before and after an exposure over which the force is averaged, s: hands accelerate a camera to and fro.
AROUND = 0.25
# Least share of gravity in the plane of the picture that tells where its bottom is: the camera looks at most 60 degrees
# up or down.
LEAST_IN_PLANE = 0.5
# Angle (rad) from which gravity does not point to the bottom of a picture, and that from which it points to its top.
ASIDE, TOP = math.radians(50), math.radians(130)
# Pictures of a clip, spread over it, that show gravity on average: a camera in motion tilts and turns.
AVERAGED = 16


def checked_samples(t: ArrayLike, name: str, values: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return increasing times (n,) and values (n, 3), at least two, as arrays; messages call the values `name`."""
    t = validate.real_array("t", t, (None,))
    values = validate.real_array(name, values, (None, 3), most=LARGEST)
    if len(t) != len(values) or len(t) < 2:
        raise InputError(f"t and {name} must have the same length, at least 2 samples; got {len(t)} and {len(values)}")
    (wrong,) = np.nonzero(np.diff(t) <= 0)
    if wrong.size:
        i = int(wrong[0])
        raise InputError(
            f"t must increase: sample {i + 1} (t = {t[i + 1]:.9f} s) is not after sample {i} (t = {t[i]:.9f} s); "
            "sort the samples and drop repeated timestamps"
        )
    return t, values


def samples_around(t: FloatArray, t0: float, t1: float) -> slice:
    """Return the samples from the last one at or before `t0` to the first one at or after `t1`, at least two."""
    first = int(np.clip(np.searchsorted(t, t0, side="right") - 1, 0, len(t) - 2))
    return slice(first, max(int(np.searchsorted(t, t1)) + 1, first + 2))


class SensorLog:
    """Samples of three values, with their times in s relative to an integer epoch.

    A subclass is a frozen dataclass with the fields `t`, `epoch_ns` and one of shape (n, 3), whose name is `VALUES`.
    """

    __slots__ = ()
    SENSOR: ClassVar[str]
    VALUES: ClassVar[str]

    t: FloatArray
    epoch_ns: int

    def _check(self) -> None:
        """Validate the fields and make the arrays read-only."""
        t, values = checked_samples(self.t, self.VALUES, getattr(self, self.VALUES))
        object.__setattr__(self, "t", t)
        object.__setattr__(self, self.VALUES, values)
        object.__setattr__(self, "epoch_ns", validate.nanoseconds("epoch_ns", self.epoch_ns))

    def _derived(self, **changes: FloatArray | int) -> Self:
        """Return a changed copy of this valid log, without the checks and without a second warning."""
        log = copy(self)
        for name, value in changes.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(log, name, value)
        return log

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SensorLog) or type(other) is not type(self):
            return NotImplemented
        same = self.epoch_ns == other.epoch_ns and np.array_equal(self.t, other.t)
        return same and np.array_equal(getattr(self, self.VALUES), getattr(other, self.VALUES))

    def __hash__(self) -> int:
        # Equal logs agree in these; to hash every sample would take long.
        return hash((self.epoch_ns, len(self), self.span))

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

    def gaps(self) -> FloatArray:
        """Return the gaps of the log: intervals longer than three times the median interval.

        Returns
        -------
        ndarray, shape (k, 2)
            Times in s relative to `epoch_ns` of the samples before and after each gap.
        """
        step = np.diff(self.t)
        (i,) = np.nonzero(step > 3 * np.median(step))
        return np.stack([self.t[i], self.t[i + 1]], axis=1)

    def shifted(self, dt: float) -> Self:
        """Return the log with other sample times.

        Parameters
        ----------
        dt : float
            Seconds added to every sample time.

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

    def trimmed(self, t0: float, t1: float) -> Self:
        """Return the samples from the last one at or before `t0` to the first one at or after `t1`.

        The samples just outside are kept so that rates can be interpolated over all of [t0, t1]. At least two samples
        remain.

        Parameters
        ----------
        t0, t1 : float
            Times in s relative to `epoch_ns`, `t0 <= t1`.

        Raises
        ------
        InputError
            If a time is not finite, `t1` is before `t0`, or the log has no sample between them.
        """
        t0, t1 = validate.time("t0", t0), validate.time("t1", t1)
        if t1 < t0:
            raise InputError(f"t1 must not be before t0, got t0 = {t0} and t1 = {t1}")
        if t1 < self.t[0] or t0 > self.t[-1]:
            raise InputError(f"no samples between {t0} s and {t1} s: the log spans {self.t[0]} s to {self.t[-1]} s")
        part = samples_around(self.t, t0, t1)
        return self._derived(t=self.t[part], **{self.VALUES: getattr(self, self.VALUES)[part]})

    def covering(self, t0: float, t1: float, epoch_ns: int) -> Self:
        """Return the samples that describe [t0, t1], with their times relative to another epoch.

        Parameters
        ----------
        t0, t1 : float
            Gyro time in s relative to the new epoch.
        epoch_ns : int
            The new epoch in nanoseconds.

        Raises
        ------
        ClockError
            If the log is more than a minute away: the clocks are unrelated.
        CoverageError
            If the log starts too late or ends too early.
        GapError
            If the log has a gap inside [t0, t1].
        """
        t0, t1 = validate.time("t0", t0), validate.time("t1", t1)
        epoch_ns = validate.nanoseconds("epoch_ns", epoch_ns)
        # The difference of the epochs is exact: both are integers.
        shift = (self.epoch_ns - epoch_ns) * 1e-9
        start, end = (edge + shift for edge in self.span)
        late, early = start - t0, t1 - end
        if max(late, early) > UNRELATED_CLOCK:
            raise ClockError(
                f"the {self.SENSOR} log and the exposure are on unrelated clocks: the log spans {start:.3f} s to "
                f"{end:.3f} s, the exposure needs {t0:.3f} s to {t1:.3f} s (both relative to {epoch_ns} ns, after the "
                "time offset); give the time offset between the clocks"
            )
        if late > 0 or early > 0:
            missing = [f"{1e3 * s:.3f} ms at its {end}" for s, end in ((late, "start"), (early, "end")) if s > 0]
            raise CoverageError(
                f"the {self.SENSOR} log does not cover the exposure: it misses {' and '.join(missing)}; "
                "check the time offset, the capture's timestamp and the readout time, or use a longer log"
            )
        # The median interval is taken from the neighbourhood: for all samples of a day it would take a second.
        first, last = np.searchsorted(self.t, (t0 - shift, t1 - shift))
        near = slice(max(first - NEIGHBOURS, 0), last + NEIGHBOURS)
        values = {self.VALUES: getattr(self, self.VALUES)[near]}
        log = self._derived(t=self.t[near] + shift, epoch_ns=epoch_ns, **values)
        for before, after in log.gaps():
            if before < t1 and after > t0:
                raise GapError(
                    f"the {self.SENSOR} log has a gap of {1e3 * (after - before):.1f} ms inside the exposure, "
                    f"{1e3 * abs(before - t0):.1f} ms {'after' if before >= t0 else 'before'} the first row opens; the "
                    "motion there is unknown"
                )
        return log.trimmed(t0, t1)


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
        If the rates look like degrees per second: their median is beyond 5 rad/s, or the largest beyond 35 rad/s; or
        if rates that change have fewer than two samples per second.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log = rsdeblur.GyroLog(np.arange(200) * 0.005, np.full((200, 3), 0.1))
    >>> log.minus_bias([0.1, 0.1, 0.1]).shifted(2.0)
    GyroLog(t=float64[200], rate=200, span=(2, 2.995), epoch_ns=0)
    """

    SENSOR: ClassVar = "gyro"
    VALUES: ClassVar = "omega"

    t: FloatArray
    omega: FloatArray
    epoch_ns: int = 0

    def __post_init__(self) -> None:
        self._check()
        magnitude = np.sqrt(np.einsum("ij,ij->i", self.omega, self.omega))
        median, peak = float(np.median(magnitude)), float(magnitude.max())
        if median > SUSPICIOUS_MEDIAN or peak > SUSPICIOUS_PEAK:
            warnings.warn(
                f"gyro rates look like degrees per second (median {median:.3g}, peak {peak:.3g}, taken as rad/s); "
                "if they are, multiply by pi/180, or read the log with unit='deg/s' (--unit deg/s)",
                RsdeblurWarning,
                stacklevel=3,
            )
        # A constant rate needs no samples between.
        if self.rate < SLOWEST and np.ptp(self.omega, axis=0).any():
            warnings.warn(
                f"the log has {self.rate:.2g} samples per second; its times must be in s, not ms or ns",
                RsdeblurWarning,
                stacklevel=3,
            )

    def minus_bias(self, b: ArrayLike) -> GyroLog:
        """Return the log with a constant rate subtracted from every sample.

        Parameters
        ----------
        b : array_like, shape (3,)
            Bias in rad/s about the IMU's axes.

        Raises
        ------
        InputError
            If `b` does not have this shape or is not finite.
        """
        return self._derived(omega=self.omega - validate.real_array("b", b, (3,)))


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
        As for :class:`GyroLog`, with forces up to 1e12 m/s^2.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.motion.AccelerationLog([0.0, 0.01, 0.02], [[0, 0, 9.81]] * 3)
    AccelerationLog(t=[0, 0.01, 0.02], rate=100, span=(0, 0.02), epoch_ns=0)
    """

    SENSOR: ClassVar = "accelerometer"
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


class Gravity(NamedTuple):
    """Where gravity points in pictures that are viewed upright.

    `side` is "bottom" where it confirms the camera's axes, and empty where nothing is known. If the axes cannot be
    right, it is "top", "left" or "right", or "edge" or "user" where a phone's camera would look along an edge of the
    phone or towards its user. `fits` are then the names of axes with which gravity points to the bottom.
    """

    side: str = ""
    fits: tuple[str, ...] = ()

    @property
    def contradicts(self) -> bool:
        """Whether the axes cannot be right."""
        return self.side not in ("", "bottom")


def gravity_in(
    log: AccelerationLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    bottom: float,
    presets: Collection[str],
    is_phone: bool,
    is_rear: bool,
) -> Gravity:
    """Return where gravity points in a picture, or on average in the frames of a clip.

    `bottom` is where the bottom of the viewed picture is in the stored one, rad. `presets` are the axes that the log
    may have, `is_phone` says whether it has those of a phone, and `is_rear` whether its app takes the rear camera and
    shows the same sign on all devices: raw values of iOS have the opposite one, like a picture upside down.
    """
    exposures = exposures[:: -(-len(exposures) // AVERAGED)]

    def turn(camera: Camera) -> float | None:
        """Return the mean angle from the bottom of the viewed picture, from -pi to pi; None if it is unknown."""
        angles = [angle for each in exposures if (angle := log.gravity_angle(camera, each)) is not None]
        mean = math.atan2(sum(map(math.sin, angles)), sum(map(math.cos, angles)))
        return math.remainder(mean - bottom, math.tau) if angles else None

    angle = turn(camera)
    # Cameras of phones look along their z axis, within 45 degrees, those on the back towards its negative end.
    forward = camera.imu_to_camera[2, 2] if is_phone else -1.0
    if abs(forward) < 0.7:
        side = "edge"
    elif forward > 0 and is_rear:
        side = "user"
    elif angle is None or (abs(angle) > TOP and not is_rear):
        return Gravity()
    elif abs(angle) < ASIDE:
        return Gravity("bottom")
    else:
        side = "top" if abs(angle) > TOP else "right" if angle > 0 else "left"
    turns = {name: turn(replace(camera, imu_to_camera=imu_to_camera(name))) for name in PRESETS if name in presets}
    return Gravity(side, tuple(name for name, angle in turns.items() if angle is not None and abs(angle) < ASIDE))
