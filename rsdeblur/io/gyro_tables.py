"""Gyro logs that are text tables: columns are found by name, or by the few layouts without a header.

Apps differ only in names, order, units and separators, so there is one reader. The app that wrote the file decides the
axes, and the unit of a column that names none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np

from rsdeblur.io.formats import Format, text_format
from rsdeblur.io.samples import Axes, Samples, table_samples
from rsdeblur.io.text import Table, TextFile, cells_of, is_number, read_table, separator_of
from rsdeblur.types import FloatArray

# Nanoseconds in each unit of time that a log may use.
TIME_UNITS = {"s": Decimal(10**9), "ms": Decimal(10**6), "us": Decimal(10**3), "ns": Decimal(1)}
# A gyro samples at 20 Hz to 8 kHz. The sample spacings (ns) then lie within a factor of 400, less than the 1000
# between the units, so a spacing fits at most one unit.
SPACING = (125_000, 50_000_000)

# Spellings of units, without spaces and in lower case.
TIME_SPELLINGS = {
    "s": "s sec secs second seconds",
    "ms": "ms msec millisec milliseconds",
    "us": "us µs μs usec microsec microseconds",
    "ns": "ns nsec nanosec nanoseconds",
}
RATE_SPELLINGS = {
    "rad/s": "rad/s rads rads^-1 rads-1 rad*s^-1 rad/sec radians/s radians/sec radianspersecond rad_s",
    "deg/s": "deg/s degs^-1 degs-1 deg/sec °/s º/s °/sec dps degrees/s degrees/sec degreespersecond deg_s",
    "mrad/s": "mrad/s",
    "mdeg/s": "mdeg/s mdps",
}
UNIT_OF = {
    spelling: unit
    for spellings in (TIME_SPELLINGS, RATE_SPELLINGS)
    for unit, words in spellings.items()
    for spelling in words.split()
}

# Names of columns, in lower case and reduced to letters.
TIME = re.compile(
    "(sensor|event|sampling|elapsed|gyro)?(t|ts|time|timestamp|stamp)(sincereboot)?|zeit|temps|tiempo|tempo"
)
# Sensor Logger's second clock, for tables without another.
ELAPSED = re.compile("(seconds|time)elapsed|elapsed(seconds|time)?")
GYRO = (
    "w|omega|g|gyr|gyro|gyroscope|gyroskop|giroscopio|gyrorotation|(motion)?rotationrate"
    "|(field)?angular(velocity|rate)|angvel|wrss"
)
RATES = tuple(re.compile(rf"({GYRO}){axis}(axis)?|{axis}({GYRO})") for axis in "xyz")

# Android's sensor types: the gyro, and the gyro whose bias the phone does not remove.
GYRO_TYPE, UNCALIBRATED_TYPE = "4", "16"

# Longest cell that may be a name: the patterns take time in proportion to the square of the length.
CELL_WIDTH = 100

BIASED = {"bias": "not removed by the phone"}

# Rows that decide the layout of a table without a header.
LAYOUT_ROWS = 50

# Words in the file names of other sensors, whose tables may have the same columns as a gyro's.
OTHER_SENSORS = re.compile(r"acc|gravity|magn|orientation|compass|barom", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Columns:
    """Places of stamps and rates (about x, y, z) among the columns of a table, and their units where it names them.

    `start` is the place of the first sample among the rows; `names` are the names of all columns.
    """

    places: tuple[int, int, int, int]
    time_unit: str | None = None
    rate_unit: str | None = None
    start: int = 0
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Cell:
    """A cell of a header, such as `t_ns`, `gx[rad/s]`, `Gyroscope x (rad/s)`."""

    name: str
    unit: str | None
    unknown: bool

    @classmethod
    def of(cls, text: str) -> _Cell:
        if len(text) > CELL_WIDTH:
            return cls("", None, True)
        text = text.lower()
        match = re.fullmatch(r"(.*?)\s*[\[(](.*?)[\])]", text)
        if match is None:
            match = re.fullmatch(r"(.*?)_(ns|us|ms|s|rad_?s|deg_?s|dps)", text)
        name, unit = match.groups() if match else (text, "")
        known = UNIT_OF.get(re.sub(r"\s", "", unit))
        return cls(re.sub(r"[^a-z]", "", name), known, bool(unit) and known is None)


def named_columns(text: TextFile, rates: Sequence[re.Pattern[str]] = RATES) -> Columns | None:
    """Return the columns named by a header; None if no line names stamps and a gyro's rates."""
    for line, start in text.headers:
        cells = [_Cell.of(cell) for cell in cells_of(line)]

        def place(pattern: re.Pattern[str], units: dict[str, str], cells: Sequence[_Cell] = cells) -> int:
            fits = (
                k
                for k, cell in enumerate(cells)
                if pattern.fullmatch(cell.name) and not cell.unknown and (cell.unit is None or cell.unit in units)
            )
            return next(fits, -1)

        t = place(TIME, TIME_SPELLINGS)
        t = t if t >= 0 else place(ELAPSED, TIME_SPELLINGS)
        x, y, z = (place(rate, RATE_SPELLINGS) for rate in rates)
        if min(t, x, y, z) >= 0:
            return Columns((t, x, y, z), cells[t].unit, cells[x].unit, start, tuple(cell.name for cell in cells))
    return None


def read_columns(text: TextFile, columns: Columns, axes: Axes, rows: Sequence[int] | None = None) -> Samples:
    """Read the table, or only `rows` of it; a missing unit of time follows from the sample spacing.

    Raises
    ------
    FileFormatError
        If a row cannot be read, or the sample spacing fits no unit.
    """
    table = read_table(text, text.rows[columns.start :] if rows is None else rows, columns.places)
    unit = columns.time_unit or _unit_from_spacing(table)
    rate_unit = columns.rate_unit or "rad/s"
    return table_samples(table, table.nanoseconds(TIME_UNITS[unit]), rate_unit=rate_unit, axes=axes, time_unit=unit)


def _unit_from_spacing(table: Table) -> str:
    # Stamps that fit as nanoseconds fit in every unit, and their differences do not overflow.
    table.check_range(TIME_UNITS["ns"])
    if len(table.rows) < 2:
        raise table.text.error("a gyro log needs at least 2 samples, got 1", table.rows[0])
    spacing = float(np.median(np.abs(np.diff(table.stamps).astype(np.float64))))
    for name, unit in TIME_UNITS.items():
        if SPACING[0] <= spacing * float(unit) <= SPACING[1]:
            return name
    raise table.text.error(
        f"cannot determine the unit of time: the median sample spacing is {spacing:g}, which is no gyro rate between "
        "20 Hz and 8 kHz in s, ms, us or ns; check the column of stamps"
    )


def _read_named(axes: Axes) -> Callable[[TextFile], Samples]:
    def read(text: TextFile) -> Samples:
        columns = named_columns(text)
        if columns is None:
            raise text.error(
                "the file has no header that names the stamps and the rates about x, y and z", text.rows[0]
            )
        return read_columns(text, columns, axes)

    return read


def _sniff_mars(text: TextFile) -> bool:
    columns = named_columns(text)
    return columns is not None and columns.names[0] == "timestamp" and "[nanosec]" in text.head.lower()


def _sniff_euroc(text: TextFile) -> bool:
    columns = named_columns(text)
    return columns is not None and ("wrssx" in columns.names or {"omegax", "alphax"} <= set(columns.names))


def _sniff_phyphox(text: TextFile) -> bool:
    columns = named_columns(text)
    return columns is not None and columns.names[:2] == ("time", "gyroscopex") and columns.time_unit == "s"


# Sensor Logger calls the columns of all its sensors z, y and x, in this order; some users rename them.
BARE_AXES = tuple(re.compile(rf"{axis}|{pattern.pattern}") for axis, pattern in zip("xyz", RATES, strict=True))


def _sensorlogger_columns(text: TextFile) -> Columns | None:
    columns = named_columns(text, BARE_AXES)
    return columns if columns and {"time", "secondselapsed"} <= set(columns.names) else None


def _read_sensorlogger(text: TextFile) -> Samples:
    columns = _sensorlogger_columns(text)
    if columns is None:
        raise text.error("not a Sensor Logger header: expected time, seconds_elapsed, z, y, x", text.rows[0])
    if named_columns(text) is None:
        refuse_other_sensor(text)
    samples = read_columns(text, replace(columns, time_unit="ns"), "phone")
    return replace(samples, facts=BIASED) if "uncalibrated" in text.path.stem.lower() else samples


def refuse_other_sensor(text: TextFile) -> None:
    """Raise `FileFormatError` if a file whose columns do not name the sensor is named after another one."""
    name = text.path.stem
    if OTHER_SENSORS.search(name) and "gyr" not in name.lower():
        raise text.error(f"the file is named after another sensor than the gyro ({name}); give the gyro's file")


def _grid(text: TextFile, columns: int) -> FloatArray | None:
    """Return the first rows of a table; None unless each consists of `columns` numbers."""
    cells = [cells_of(text.lines[row]) for row in text.rows[:LAYOUT_ROWS]]
    # The last row does not count. It may be cut off, and then the format's reader names the line, whereas this
    # function could only report an unknown format.
    if not all(len(row) == columns and all(map(is_number, row)) for row in cells[: max(len(cells) - 1, 1)]):
        return None
    return np.array([row for row in cells if len(row) == columns and all(map(is_number, row))], dtype=np.float64)


def _increasing(values: FloatArray) -> bool:
    return bool(np.mean(np.diff(values) > 0) > 0.9) if len(values) > 1 else False


def _sniff_opencamera(text: TextFile) -> bool:
    grid = _grid(text, 4)
    if grid is None or len(grid) < 2:
        return False
    # The first column, a rate, may rise for a while too; but only stamps in ns are whole numbers that far apart.
    stamps = grid[:, 3]
    spaced = SPACING[0] <= np.median(np.diff(stamps)) <= SPACING[1]
    return _increasing(stamps) and bool(spaced and (stamps == np.rint(stamps)).all())


def _read_opencamera(text: TextFile) -> Samples:
    refuse_other_sensor(text)
    return read_columns(text, Columns((3, 0, 1, 2)), "phone")


def _type_of(line: str) -> str:
    word = cells_of(line)[0].lower()
    return GYRO_TYPE if word.startswith("gyr") else word


def _sniff_tagged(text: TextFile) -> bool:
    cells = cells_of(text.head)
    if len(cells) != 5 or not cells[1].isdecimal() or not all(map(is_number, cells[2:])):
        return False
    if cells[0].isdecimal() and separator_of(text.head) is None:
        return True
    return any(_type_of(line) in (GYRO_TYPE, UNCALIBRATED_TYPE) for line in text.filled())


def _read_tagged(text: TextFile) -> Samples:
    rows: dict[str, list[int]] = {}
    for row, line in zip(text.rows.tolist(), text.filled(), strict=True):
        kind = _type_of(line)
        if not (kind.isdecimal() or (kind.isalpha() and len(kind) > 2)):
            raise text.error(f"{kind[:40]!r} is not a sensor type; lines must read `type t_ns x y z`", row)
        rows.setdefault(kind, []).append(row)
    kind = GYRO_TYPE if GYRO_TYPE in rows else UNCALIBRATED_TYPE
    if kind not in rows:
        raise text.error("the file contains no gyro samples: no line is of type 4 or 16")
    samples = read_columns(text, Columns((1, 2, 3, 4), "ns"), "phone", rows[kind])
    return samples if kind == GYRO_TYPE else replace(samples, facts=BIASED)


def _plain_columns(text: TextFile) -> Columns | None:
    named = named_columns(text)
    if named is not None:
        return named
    bare = named_columns(text, BARE_AXES)
    if bare is not None and (bare.rate_unit or "gyr" in text.path.stem.lower()):
        return bare
    if all(map(is_number, cells_of(text.head))):
        if len(cells_of(text.head)) == 4:
            return Columns((0, 1, 2, 3))
        grid = _grid(text, 7)
        if grid is not None:
            return _without_gravity(grid)
    return None


def _without_gravity(grid: FloatArray) -> Columns | None:
    """Return the gyro's columns of `t x y z x y z`; the others, an accelerometer's, show 9.8 m/s^2."""
    first, second = (abs(np.median(np.linalg.norm(grid[:, k : k + 3], axis=1)) - 9.8) < 2 for k in (1, 4))
    if first == second:
        return None
    return Columns((0, 4, 5, 6)) if first else Columns((0, 1, 2, 3))


def _read_plain(text: TextFile) -> Samples:
    columns = _plain_columns(text)
    if columns is None:
        raise text.error("expected four numbers `t wx wy wz`, or a header that names them", text.rows[0])
    return read_columns(text, columns, "sensor")


FORMATS: tuple[Format[Samples], ...] = (
    text_format("mars", "MARS logger gyro_accel.csv", _sniff_mars, _read_named("phone")),
    text_format("euroc", "EuRoC or Kalibr IMU CSV", _sniff_euroc, _read_named("sensor")),
    text_format("phyphox", "phyphox Gyroscope.csv", _sniff_phyphox, _read_named("phone")),
    text_format(
        "sensorlogger",
        "Sensor Logger Gyroscope.csv",
        lambda text: _sensorlogger_columns(text) is not None,
        _read_sensorlogger,
    ),
    text_format("deepgyro", "imu.txt with types, `type t_ns x y z`", _sniff_tagged, _read_tagged),
    text_format("opencamera", "OpenCamera Sensors gyro.csv, `x,y,z,t_ns`", _sniff_opencamera, _read_opencamera),
    text_format("plain", "`t wx wy wz`", lambda text: _plain_columns(text) is not None, _read_plain),
)
