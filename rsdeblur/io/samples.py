"""Samples as a reader returns them, and the log made from them: units applied, faults repaired or refused."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import pi
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io.columns import ACCELERATION, RATE, SPACING, Quantity
from rsdeblur.io.text import INT64_LIMIT, Table, line_error
from rsdeblur.motion.acceleration import AccelerationLog
from rsdeblur.motion.gyro import LARGEST_RATE, GyroLog
from rsdeblur.types import FloatArray

# The frame of the rates: a phone's (x right, y up, z out of the screen, whichever app wrote them), Gyroflow's (x up,
# y left, z back), or the sensor's own, which only its owner knows.
Axes = Literal["phone", "gyroflow", "sensor"]

# m/s^2. At rest an accelerometer shows gravity, in nearly every sample; a gyro does not.
GRAVITY = 9.80665

Log = TypeVar("Log", GyroLog, AccelerationLog)
ErrorAt = Callable[[str, int], FileFormatError]


@dataclass(frozen=True, slots=True, eq=False)
class Sensor(Generic[Log]):
    """What a log is of: its name and that of its values, their columns, their units (in rad/s or m/s^2), their type.

    The first unit is that of files that name none.
    """

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

    ns: NDArray[np.int64] | None
    """Timestamps in ns, shape (n,); None if the file contains none."""
    values: FloatArray
    """Rates or accelerations in `unit`, shape (n, 3)."""
    error_at: ErrorAt
    """Returns the error for a message about sample i."""
    unit: str = "rad/s"
    axes: Axes = "phone"
    """The frame of the values after `turn`, the rotation from the file's axes."""
    turn: FloatArray | None = None
    time_unit: str = "ns"
    """Unit of the timestamps in the file, for reports."""
    facts: Mapping[str, Any] = field(default_factory=dict)
    """Other content of the file, for reports."""
    cautions: Sequence[str] = ()
    """Reasons to distrust the log; each becomes a warning."""


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class GyroFile:
    """A gyro log with the other content of its file."""

    log: GyroLog
    """The samples, in rad/s."""
    format: str
    """Name of the file's format."""
    axes: Axes
    """The frame of the rates: a phone's, Gyroflow's, or one that the file does not name."""
    time_unit: str
    rate_unit: str
    """Units in the file."""
    facts: Mapping[str, Any]
    """Other content of the file: readout time, device, clock offsets."""


def table_samples(table: Table, ns: NDArray[np.int64] | None, *, scale: float = 1.0, **fields: Any) -> Samples:
    """Return the samples of a text table, its values times `scale`; errors name its lines."""
    # The errors must not keep the text alive, which may be a gigabyte.
    path, rows = table.text.path, table.rows
    values = table.values if scale == 1 else table.values * scale
    return Samples(ns, values, lambda message, i: line_error(path, message, rows[i]), **fields)


def nanoseconds(milliseconds: FloatArray, error_at: ErrorAt) -> NDArray[np.int64]:
    """Return timestamps in ms as integers in ns; raise the error of the first one that does not fit."""
    # float64 is coarser than 1 ns near the limit: a margin keeps rounding inside.
    (beyond,) = np.nonzero(~(np.abs(milliseconds) < (INT64_LIMIT - 1024) / 1e6))
    if beyond.size:
        i = int(beyond[0])
        raise error_at(f"timestamp {milliseconds[i]:g} ms is beyond the int64 range of nanoseconds (292 years)", i)
    return np.round(milliseconds * 1e6).astype(np.int64)


def finish(
    samples: Samples, sensor: Sensor[Log], unit: str | None, rate: float | None, error: Callable[[str], FileFormatError]
) -> Log:
    """Make the log: repair what is harmless, refuse what is not, scale the values."""
    if unit is not None:
        validate.choice("unit", unit, sensor.units)
    unit = unit or samples.unit
    is_gyro = sensor.values == "rates"
    _check_values(samples, sensor.values, unit, error)
    t, values, epoch, repairs = ordered(_timestamps(samples, rate, error), samples)
    if sensor.units[unit] != 1:
        values = values * sensor.units[unit]
    sizes: FloatArray = np.sqrt(np.einsum("ij,ij->i", values, values))
    if is_gyro:
        if np.mean(np.abs(sizes - GRAVITY) < 0.5) > 0.9:
            raise error(
                "these look like the samples of an accelerometer at rest (9.8 m/s^2), not of a gyro; "
                "give the gyro's file, or the unit if it is not rad/s"
            )
    else:
        _check_gravity(float(np.median(sizes)), sensor.units, unit, error)
    try:
        log = sensor.make(t, values, epoch)
    except InputError as reason:
        raise samples.error_at(str(reason), 0) if len(t) < 2 else error(str(reason)) from reason
    for caution in _cautions(samples, log.rate, repairs) if is_gyro else [f"accelerometer: {each}" for each in repairs]:
        warnings.warn(str(error(caution)), RsdeblurWarning, stacklevel=3)
    return log


def _cautions(samples: Samples, rate: float, repairs: list[str]) -> list[str]:
    """Return reasons to distrust a gyro log."""
    # Gyros sample at 20 Hz to 8 kHz; beyond these bounds timestamps are rather in another unit, by a factor of 1000.
    if 5.0 <= rate <= 50_000.0:
        return [*samples.cautions, *repairs]
    text = f"the timestamps in {samples.time_unit} mean a sampling rate of {rate:.3g} Hz"
    return [*samples.cautions, *repairs, f"{text}, but a gyro's is 20 to 8000 Hz; is the unit of time right?"]


def _check_gravity(size: float, units: Mapping[str, float], unit: str, error: Callable[[str], FileFormatError]) -> None:
    """Raise `FileFormatError` if the median of an accelerometer, in m/s^2 by `unit`, is not gravity."""
    if 0.5 < size / GRAVITY < 1.5:
        return
    fits = (name for name, factor in units.items() if 0.5 < size / units[unit] * factor / GRAVITY < 1.5)
    likely = next(fits, None)
    raise error(
        f"an accelerometer shows gravity, 9.8 m/s^2, but the median of these samples is {size:.3g} m/s^2 "
        f"(read as {unit}); "
        + (f"they look like {likely}: give the unit" if likely else "is gravity already removed from them?")
    )


def _check_values(samples: Samples, what: str, unit: str, error: Callable[[str], FileFormatError]) -> None:
    """Raise `FileFormatError` if there are no samples, or one is not finite or so large that computing may overflow."""
    values = samples.values
    if not len(values):
        raise error("the file contains no samples")
    (bad,) = np.nonzero(~(np.abs(values) <= LARGEST_RATE).all(axis=1))
    if bad.size:
        i = int(bad[0])
        raise samples.error_at(f"impossible {what}: {values[i].tolist()} {unit}; is the unit right?", i)


def ordered(ns: NDArray[np.int64], samples: Samples) -> tuple[FloatArray, FloatArray, int, list[str]]:
    """Return times in s, values in their final axes, the first timestamp in ns, and a note of each repair."""
    ns, values, repairs = _repaired(ns, samples)
    if samples.turn is not None:
        values = values @ samples.turn.T
    # Ordered int64 differ by at most 2**64 - 1: unsigned, the difference cannot overflow.
    t = (ns.view(np.uint64) - ns[:1].view(np.uint64)).astype(np.float64) * 1e-9
    return t, values, int(ns[0]), repairs


def _timestamps(samples: Samples, rate: float | None, error: Callable[[str], FileFormatError]) -> NDArray[np.int64]:
    """Return the timestamps of the file, or those that follow from the sampling rate in Hz."""
    if samples.ns is not None:
        if rate is not None:
            raise error("the file contains timestamps; leave out the sampling rate (rate, --rate)")
        return samples.ns
    if rate is None:
        raise error(
            "the file contains no timestamps; give the sampling rate in Hz (rate, --rate), or name the column of "
            "timestamps t, time or timestamp"
        )
    rate = validate.finite("rate", rate, above=0.0)
    if not SPACING[0] <= 1e9 / rate <= SPACING[1]:
        raise InputError(f"rate must be a gyro's sampling rate from 20 to 8000 Hz, got {rate:g}")
    ns: NDArray[np.int64] = np.rint(np.arange(len(samples.values)) * (1e9 / rate)).astype(np.int64)
    return ns


def _repaired(ns: NDArray[np.int64], samples: Samples) -> tuple[NDArray[np.int64], FloatArray, list[str]]:
    """Return timestamps and values in order and without repetitions, and a note of each repair."""
    values, repairs = samples.values, []
    origin = np.arange(len(ns))
    if (ns[1:] < ns[:-1]).any():
        late = _late(ns, samples.error_at)
        origin = np.argsort(ns, kind="stable")
        ns, values = ns[origin], values[origin]
        repairs.append(f"{late} samples came late and were sorted in")
    (twice,) = np.nonzero(ns[1:] == ns[:-1])
    if twice.size:
        differ = twice[(values[twice] != values[twice + 1]).any(axis=1)]
        if differ.size:
            i = int(origin[differ[0] + 1])
            timestamp = ns[differ[0]]
            raise samples.error_at(f"duplicate timestamp {timestamp} ns with another value; keep one of the samples", i)
        ns, values = np.delete(ns, twice + 1), np.delete(values, twice + 1, axis=0)
        repairs.append(f"{twice.size} repeated samples were dropped")
    return ns, values, repairs


def _late(ns: NDArray[np.int64], error_at: ErrorAt) -> int:
    """Return the number of samples that come after later ones, if they are few and each fills a hole in time."""
    latest = np.maximum.accumulate(ns)
    (late,) = np.nonzero(ns < latest)
    i = int(late[0])
    before = f"timestamp out of order: {ns[i]} ns comes after {ns[i - 1]} ns"
    # In floats, because differences of arbitrary timestamps may overflow.
    interval = float(np.median(np.abs(np.diff(ns.astype(np.float64)))))
    delay = float((latest[late].astype(np.float64) - ns[late]).max())
    # Samples that come late by up to ten intervals, at most one in a hundred, are harmless delays. Anything else is
    # another recording or a broken clock, which sorting would hide.
    if late.size > max(1, 0.01 * len(ns)) or delay > 10 * interval:
        raise error_at(
            f"{before}; the samples are too disordered to sort them safely; they may come from several recordings, or "
            "from a clock that was set back",
            i,
        )
    in_time = ns[ns == latest]
    after = np.searchsorted(in_time, ns[late])
    # Repeated samples fill no hole, whether they come late or not.
    own = (after > 0) & (in_time[after] != ns[late])
    holes, filling = np.unique(after[own], return_counts=True)
    widths = (in_time[holes] - in_time[holes - 1]).astype(np.float64)
    (narrow,) = np.nonzero(widths < (filling + 0.5) * interval)
    if narrow.size:
        i = int(late[own][after[own] == holes[narrow[0]]][0])
        raise error_at(
            f"timestamp out of order: {ns[i]} ns comes after {ns[i - 1]} ns, and no sample is missing at that time; "
            "the clock was set back, or the file contains several recordings; cut the log there",
            i,
        )
    return int(late.size)
