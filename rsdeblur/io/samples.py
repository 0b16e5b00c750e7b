"""Samples as a reader returns them, and the log made from them: units applied, faults repaired or refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io.columns import ACCELERATION, RATE, Quantity
from rsdeblur.io.source import INT64_LIMIT, Rows, line_error
from rsdeblur.motion.gyro import LARGEST, SUSPICIOUS_MEDIAN, SUSPICIOUS_PEAK, AccelerationLog, GyroLog
from rsdeblur.motion.units import FASTEST, SLOWEST, saturated, shows_degrees
from rsdeblur.types import FloatArray

# The frame of the rates: a phone's (x right, y up, z out of the screen, whichever app wrote them), Gyroflow's (x up,
# y left, z back), or the sensor's own, which only its owner knows.
Axes = Literal["phone", "gyroflow", "sensor"]

# m/s^2. At rest an accelerometer shows gravity, in nearly every sample; a gyro does not.
GRAVITY = 9.80665
# Hz, twice the frequencies of a hand's shake.
SHAKE_RATE = 50.0

Log = TypeVar("Log", GyroLog, AccelerationLog)


@dataclass(frozen=True, slots=True, eq=False)
class Sensor(Generic[Log]):
    """What a log is of: name, name of its values, columns, units (the first is that of files without one), and type."""

    what: str
    values: str
    quantity: Quantity
    units: Mapping[str, float]
    make: Callable[[FloatArray, FloatArray, int], Log]

    @property
    def unit(self) -> str:
        """Unit of files that name none."""
        return next(iter(self.units))


GYRO = Sensor(
    "gyro log", "rates", RATE, {"rad/s": 1.0, "deg/s": pi / 180, "mrad/s": 1e-3, "mdeg/s": pi / 180e3}, GyroLog
)
ACCELEROMETER = Sensor(
    "log of an accelerometer",
    "accelerations",
    ACCELERATION,
    {"m/s^2": 1.0, "g": GRAVITY, "mg": 1e-3 * GRAVITY},
    AccelerationLog,
)
AnySensor = Sensor[GyroLog] | Sensor[AccelerationLog]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples as they are in a file."""

    path: Path
    ns: NDArray[np.int64] | None  # timestamps in ns, shape (n,); None if the file contains none
    values: FloatArray  # rates or accelerations in `unit`, shape (n, 3)
    rows: Rows | None = None  # lines of the samples in the file, counted from 0, if they have any
    unit: str | None = "rad/s"  # unit of the values; None if the samples must show it
    axes: Axes = "phone"  # the frame of the values after `turn`, the rotation from the file's axes
    turn: FloatArray | None = None
    time_unit: str = "ns"  # unit of the timestamps in the file, for reports
    facts: Mapping[str, Any] = field(default_factory=dict)  # other content of the file, for reports
    cautions: Sequence[str] = ()  # reasons to distrust the log; each becomes a warning
    forces: FloatArray | None = None  # accelerations beside the rates, in their axes and in any unit, shape (n, 3)

    @classmethod
    def of_ms(cls, path: Path, milliseconds: FloatArray, values: FloatArray, **fields: Any) -> Samples:
        """Return samples of Gyroflow or telemetry-parser; raise `FileFormatError` for a time that int64 ns lack."""
        samples = cls(path, None, values, axes="gyroflow", time_unit="ms", **fields)
        # float64 is coarser than 1 ns near the limit: a margin keeps rounding inside.
        (beyond,) = np.nonzero(~(np.abs(milliseconds) < (INT64_LIMIT - 1024) / 1e6))
        if beyond.size:
            i = int(beyond[0])
            raise samples.error(f"timestamp {milliseconds[i]:g} ms is beyond the int64 range of nanoseconds", i)
        return replace(samples, ns=np.round(milliseconds * 1e6).astype(np.int64))

    def error(self, message: str, i: int | None = None) -> FileFormatError:
        """Return the error that names the file and the place of sample `i` in it."""
        if i is not None and self.rows is None:
            message = f"sample {i}: {message}"
        return line_error(self.path, message, None if i is None or self.rows is None else self.rows[i])


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class GyroFile:
    """A gyro log with the other content of its file."""

    log: GyroLog  # the samples, in rad/s
    format: str  # name of the file's format
    axes: Axes  # the frame of the rates: a phone's, Gyroflow's, or one that the file does not name
    time_unit: str
    rate_unit: str  # units in the file
    facts: Mapping[str, Any]  # other content of the file: readout time, device, clock offsets


def vectors(samples: Sequence[Mapping[str, Any]], sensor: str) -> tuple[FloatArray, FloatArray]:
    """Return the times in ms and the vectors of a sensor of telemetry-parser, which some samples lack."""
    own = [sample for sample in samples if sample.get(sensor) is not None]
    return np.array([sample["timestamp_ms"] for sample in own], float), np.array([each[sensor] for each in own], float)


def finish(samples: Samples, sensor: Sensor[Log], unit: str | None, rate: float | None) -> tuple[Log, str]:
    """Return the log and the unit of its values in the file: repair what is harmless, refuse what is not."""
    if unit is not None:
        validate.choice("unit", unit, sensor.units)
    is_gyro = sensor.values == "rates"
    likely = unit or samples.unit or sensor.unit
    _check_values(samples, sensor.values, likely)
    ns: NDArray[np.int64] = _timestamps(samples, rate)
    cautions: list[str] = list(samples.cautions)
    sizes: FloatArray = sensor.units[likely] * np.sqrt(np.einsum("ij,ij->i", samples.values, samples.values))
    if not is_gyro:
        gravity = float(np.median(sizes))
        if not 0.5 < gravity / GRAVITY < 1.5:
            raise samples.error(
                f"an accelerometer shows gravity, 9.8 m/s^2, but the median of these samples is {gravity:.3g} m/s^2, "
                f"read as {likely}; give their unit ({', '.join(sensor.units)}), or a log with gravity"
            )
    elif np.mean(np.abs(sizes - GRAVITY) < 0.5) > 0.9:
        raise samples.error(
            "these look like the samples of an accelerometer at rest (9.8 m/s^2), not of a gyro; "
            "give the gyro's file, or the unit if it is not rad/s"
        )
    elif unit is None and samples.unit is None:
        likely = _unit_of_rates(samples, ns, cautions)
    t, values, epoch, repairs = ordered(ns, samples)
    if sensor.units[likely] != 1:
        values = values * sensor.units[likely]
    # Extremes are those of the raw axes.
    if is_gyro and (count := saturated(samples.values * sensor.units[likely])):
        cautions.append(
            f"the gyro was saturated: {count} of {len(values)} samples are equal extremes, {np.abs(values).max():.3g} "
            "rad/s; the motion was faster, so the blur of those moments is unknown; set a wider range of the gyro"
        )
    # Degrees are excluded, or extremes explain the large rates.
    with warnings.catch_warnings(action="ignore" if len(cautions) > len(samples.cautions) else None):
        try:
            log = sensor.make(t, values, epoch)
        except InputError as reason:
            raise samples.error(str(reason), 0) if len(t) < 2 else samples.error(str(reason)) from reason
    if is_gyro and log.rate > FASTEST:
        raise samples.error(
            f"the timestamps in {samples.time_unit} mean a sampling rate of {log.rate:.3g} Hz, but no gyro is faster "
            "than 10 kHz; check the unit of time: --columns t=1:us,gx=2,gy=3,gz=4"
        )
    if log.rate < SHAKE_RATE:
        slow = f"the gyro was sampled at {log.rate:.3g} Hz; shake needs {SHAKE_RATE:g} Hz"
        cautions.insert(0, f"{slow}, so much of the motion is missing")
    for remark in (cautions if is_gyro else []) + repairs:
        text = f"{samples.path}: {remark}" if is_gyro else f"{samples.path}: accelerometer: {remark}"
        warnings.warn(text, RsdeblurWarning, stacklevel=3)
    return log, likely


def _unit_of_rates(samples: Samples, ns: NDArray[np.int64], cautions: list[str]) -> str:
    """Return the unit of rates for which the file names none, and add a caution if it is not rad/s."""
    if samples.forces is not None and shows_degrees(ns, samples.values, samples.forces):
        cautions.append(
            "the rates are taken as deg/s: gravity, which the accelerometer shows, does not turn as rates in rad/s "
            "would turn it; --unit replaces that"
        )
        return "deg/s"
    sizes = np.linalg.norm(samples.values, axis=1)
    median, peak = float(np.median(sizes)), float(sizes.max())
    if median > SUSPICIOUS_MEDIAN or peak > SUSPICIOUS_PEAK:
        raise samples.error(
            f"the file names no unit of its rates, and a median of {median:.3g} and a peak of {peak:.3g} look "
            "like degrees; give the unit: unit (--unit deg/s or --unit rad/s)"
        )
    return "rad/s"


def _check_values(samples: Samples, what: str, unit: str) -> None:
    """Raise `FileFormatError` if there are no samples, or one is not finite or so large that computing may overflow."""
    values = samples.values
    if not len(values):
        raise samples.error("the file contains no samples")
    (bad,) = np.nonzero(~(np.abs(values) <= LARGEST).all(axis=1))
    if bad.size:
        i = int(bad[0])
        raise samples.error(f"impossible {what}: {values[i].tolist()} {unit}; is the unit right?", i)


def ordered(ns: NDArray[np.int64], samples: Samples) -> tuple[FloatArray, FloatArray, int, list[str]]:
    """Return times in s, values in their final axes, the first timestamp in ns, and a note of each repair."""
    ns, values, repairs = _repaired(ns, samples)
    if samples.turn is not None:
        values = values @ samples.turn.T
    # Ordered int64 differ by at most 2**64 - 1: unsigned, the difference cannot overflow.
    t = (ns.view(np.uint64) - ns[:1].view(np.uint64)).astype(np.float64) * 1e-9
    return t, values, int(ns[0]), repairs


def _timestamps(samples: Samples, rate: float | None) -> NDArray[np.int64]:
    """Return the timestamps of the file, or those that follow from the sampling rate in Hz."""
    if samples.ns is not None:
        if rate is not None:
            raise samples.error("the file contains timestamps; leave out the sampling rate (rate, --rate)")
        return samples.ns
    if rate is None:
        raise samples.error(
            "no column is named like timestamps; give the sampling rate in Hz (rate, --rate), or choose the columns, "
            "like --columns t=1:ms,gx=2,gy=3,gz=4"
        )
    rate = validate.finite("rate", rate, above=0.0)
    if not SLOWEST <= rate <= FASTEST:
        raise InputError(f"rate must be a gyro's sampling rate from 2 to 10000 Hz, got {rate:g}")
    ns: NDArray[np.int64] = np.rint(np.arange(len(samples.values)) * (1e9 / rate)).astype(np.int64)
    return ns


def _repaired(ns: NDArray[np.int64], samples: Samples) -> tuple[NDArray[np.int64], FloatArray, list[str]]:
    """Return timestamps and values in order and without repetitions, and a note of each repair."""
    values, repairs = samples.values, []
    origin = np.arange(len(ns))
    if (ns[1:] < ns[:-1]).any():
        late = _late(ns, samples)
        origin = np.argsort(ns, kind="stable")
        ns, values = ns[origin], values[origin]
        repairs.append(f"{late} samples came late and were sorted in")
    (twice,) = np.nonzero(ns[1:] == ns[:-1])
    if twice.size:
        differ = twice[(values[twice] != values[twice + 1]).any(axis=1)]
        if differ.size:
            i = int(origin[differ[0] + 1])
            timestamp = ns[differ[0]]
            raise samples.error(f"duplicate timestamp {timestamp} ns with another value; keep one of the samples", i)
        ns, values = np.delete(ns, twice + 1), np.delete(values, twice + 1, axis=0)
        repairs.append(f"{twice.size} repeated samples were dropped")
    return ns, values, repairs


def _late(ns: NDArray[np.int64], samples: Samples) -> int:
    """Return the number of samples that come after later ones, if they are few and each fills a hole in time."""
    t = ns.astype(np.float64)  # differences of arbitrary timestamps may overflow
    latest, ordered = np.maximum.accumulate(t), np.unique(t)
    (late,) = np.nonzero(t < latest)
    interval, steps = float(np.median(np.abs(np.diff(t)))), np.diff(ordered)
    place = np.searchsorted(ordered, t[late])
    nearest = np.minimum(steps[np.maximum(place - 1, 0)], steps[place])
    # Samples that come late by up to ten intervals, at most one in a hundred, are harmless delays. Anything else is
    # another recording or a broken clock, which sorting would hide.
    is_harmless = (latest[late] - t[late] <= 10 * interval) & (nearest >= 0.7 * interval)
    if late.size > max(1, 0.01 * len(ns)) or not is_harmless.all():
        i = int(late[np.argmin(is_harmless)])
        raise samples.error(
            f"timestamp out of order: {ns[i]} ns comes after {ns[i - 1]} ns; the clock was set back, or the file "
            "contains several recordings; cut the log there",
            i,
        )
    return int(late.size)
