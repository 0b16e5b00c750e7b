"""Gyro logs that are text tables: columns are found by name, or by the few layouts without a header.

Apps differ only in names, order, units and separators, so there is one reader. The app that wrote the file decides the
axes, and the unit of a column that names none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rsdeblur.io.columns import (
    RATE,
    SPACING,
    TIME_UNITS,
    Columns,
    check_layout,
    layout_grid,
    named_columns,
    rising,
    time_column,
    unit_from_spacing,
)
from rsdeblur.io.samples import GRAVITY, Axes, Samples, table_samples
from rsdeblur.io.source import Format, text_format
from rsdeblur.io.text import TextFile, cells_of, is_number, read_table, separator_of
from rsdeblur.types import FloatArray

# Android's sensor types: the gyro, the gyro whose bias the phone does not remove, and the accelerometer.
GYRO_TYPE, UNCALIBRATED_TYPE, ACCELEROMETER_TYPE = "4", "16", "1"

# Columns of `type t_ns x y z`.
TAGGED = Columns((1, 2, 3, 4), "ns")

# Name of phyphox's second column in the languages of its users.
PHYPHOX = re.compile("g[yi]ros[ck]op[a-z]{,2}x")

BIASED = {"bias": "not removed by the phone"}

# Words in the file names of other sensors, whose tables may have the same columns as a gyro's.
OTHER_SENSORS = re.compile(r"acc|gravity|magn|orientation|compass|barom", re.IGNORECASE)


def read_columns(
    text: TextFile, columns: Columns, axes: Axes, rows: Sequence[int] | None = None, *, unit: str = "rad/s"
) -> Samples:
    """Read the table, or only `rows` of it; `unit` is that of values without one.

    A missing unit of time follows from the sample spacing.
    """
    lines = np.asarray(text.rows[columns.start :] if rows is None else rows, dtype=np.intp)
    t, x, y, z = columns.places
    table = read_table(text, lines, (x if t < 0 else t, x, y, z))
    check_layout(text, lines, columns)
    units = sorted({unit for unit in columns.value_units if unit})
    if len(units) > 1:
        raise text.error(f"the values are in {' and '.join(units)}; they must all have one unit")
    unit = units[0] if units else unit
    if t < 0:
        return table_samples(table, None, unit=unit, axes=axes, time_unit="none")
    time = columns.time_unit or unit_from_spacing(table)
    return table_samples(table, table.nanoseconds(TIME_UNITS[time]), unit=unit, axes=axes, time_unit=time)


def table_format(
    name: str,
    title: str,
    columns_of: Callable[[TextFile], Columns | None],
    expected: str,
    *,
    unit: str = "rad/s",
    refuse: Callable[[TextFile], None] = lambda text: None,
) -> Format[Samples]:
    """Return a format of tables in the sensor's axes: those in which `columns_of` finds columns."""

    def read(text: TextFile) -> Samples:
        columns = columns_of(text)
        if columns is None:
            raise text.error(f"expected {expected}", text.rows[0])
        refuse(text)
        return read_columns(text, columns, "sensor", unit=unit)

    return text_format(name, title, lambda text: columns_of(text) is not None, read)


def _read_named(axes: Axes) -> Callable[[TextFile], Samples]:
    def read(text: TextFile) -> Samples:
        columns = named_columns(text)
        if columns is None:
            raise text.error(
                "the file has no header that names the timestamps and the rates about x, y and z", text.rows[0]
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
    return columns is not None and columns.time_unit == "s" and PHYPHOX.fullmatch(columns.names[1]) is not None


def _sensorlogger_columns(text: TextFile) -> Columns | None:
    # Sensor Logger calls the columns of all its sensors z, y and x, in this order; some users rename them.
    columns = named_columns(text, RATE.bare)
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
    if names_other_sensor(name):
        raise text.error(f"the file is named after another sensor than the gyro ({name}); give the gyro's file")


def names_other_sensor(name: str) -> bool:
    """Return whether a file's name is that of another sensor's file."""
    return OTHER_SENSORS.search(name) is not None and "gyr" not in name.lower()


def _sniff_opencamera(text: TextFile) -> bool:
    grid = layout_grid(text, 4)
    if grid is None or 3 not in rising(grid):
        return False
    # The first column, a rate, may rise for a while too; but only timestamps in ns are whole numbers that far apart.
    timestamps = grid[:, 3]
    spacing = (timestamps[-1] - timestamps[0]) / (len(text.rows) - 1)
    return bool(SPACING[0] <= spacing <= SPACING[1] and (timestamps == np.rint(timestamps)).all())


def _read_opencamera(text: TextFile) -> Samples:
    refuse_other_sensor(text)
    return read_columns(text, Columns((3, 0, 1, 2)), "phone")


def _type_of(line: str) -> str:
    word = cells_of(line)[0].lower()
    return GYRO_TYPE if word.startswith("gyr") else ACCELEROMETER_TYPE if word.startswith("acc") else word


def is_tagged(text: TextFile) -> bool:
    """Whether the lines read `type t_ns x y z`."""
    cells = cells_of(text.head)
    if len(cells) != 5 or not cells[1].isdecimal() or not all(map(is_number, cells[2:])):
        return False
    if cells[0].isdecimal() and separator_of(text.head) is None:
        return True
    return any(_type_of(line) in (GYRO_TYPE, UNCALIBRATED_TYPE) for line in text.filled())


def _tagged_rows(text: TextFile) -> dict[str, list[int]]:
    """Return the rows of each type of sensor."""
    rows: dict[str, list[int]] = {}
    for row, line in zip(text.rows.tolist(), text.filled(), strict=True):
        kind = _type_of(line)
        if not (kind.isdecimal() or (kind.isalpha() and len(kind) > 2)):
            raise text.error(f"{kind[:40]!r} is not a sensor type; lines must read `type t_ns x y z`", row)
        rows.setdefault(kind, []).append(row)
    return rows


def read_tagged(text: TextFile, kinds: Sequence[str], what: str, unit: str = "rad/s") -> Samples:
    """Read the first of these types of sensor that the file contains."""
    rows = _tagged_rows(text)
    kind = next((each for each in kinds if each in rows), None)
    if kind is None:
        raise text.error(f"the file contains no samples of {what}: no line is of type {' or '.join(kinds)}")
    samples = read_columns(text, TAGGED, "phone", rows[kind], unit=unit)
    return replace(samples, facts=BIASED) if kind == UNCALIBRATED_TYPE else samples


def _plain_columns(text: TextFile) -> Columns | None:
    named = named_columns(text)
    if named is not None:
        return named
    bare = named_columns(text, RATE.bare)
    if bare is not None and (any(bare.value_units) or bare.sensors or "gyr" in text.path.stem.lower()):
        return bare
    for width in (4, 7):
        grid = layout_grid(text, width)
        if grid is not None:
            gyros, accelerometers = sensors_beside(grid, time_column(grid))
            # Four columns of an accelerometer are refused later, with the reason.
            return gyros[0] if len(gyros) == 1 else accelerometers[0] if width == 4 else None
    return None


def sensors_beside(grid: FloatArray, t: int) -> tuple[list[Columns], list[Columns]]:
    """Return the columns of the gyros and of the accelerometers, which show gravity, beside that of the timestamps."""
    gyros: list[Columns] = []
    accelerometers: list[Columns] = []
    others = [k for k in range(grid.shape[1]) if k != t]
    for x, y, z in zip(others[::3], others[1::3], others[2::3], strict=True):
        # Impossible values, whose squares overflow, are refused later.
        with np.errstate(over="ignore"):
            size = float(np.median(np.linalg.norm(grid[:, (x, y, z)], axis=1)))
        (accelerometers if abs(size - GRAVITY) < 2 else gyros).append(Columns((t, x, y, z)))
    return gyros, accelerometers


def _read_plain(text: TextFile) -> Samples:
    columns = _plain_columns(text)
    if columns is None:
        # The user named the format, so columns called x, y and z are rates, unless the file's name says otherwise.
        refuse_other_sensor(text)
        columns = named_columns(text, RATE.bare)
    if columns is None:
        raise text.error("expected four numbers `t wx wy wz`, or a header that names them", text.rows[0])
    return read_columns(text, columns, "sensor")


def _unstamped_columns(text: TextFile) -> Columns | None:
    named = named_columns(text, stamped=False)
    if named is not None or layout_grid(text, 3) is None:
        return named
    return Columns((-1, 0, 1, 2))


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
    text_format(
        "deepgyro",
        "imu.txt with types, `type t_ns x y z`",
        is_tagged,
        lambda text: read_tagged(text, (GYRO_TYPE, UNCALIBRATED_TYPE), "a gyro"),
    ),
    text_format("opencamera", "OpenCamera Sensors gyro.csv, `x,y,z,t_ns`", _sniff_opencamera, _read_opencamera),
    text_format("plain", "`t wx wy wz` or `wx wy wz t`", lambda text: _plain_columns(text) is not None, _read_plain),
    table_format(
        "unstamped",
        "`wx wy wz` without timestamps, with a sampling rate",
        _unstamped_columns,
        "three numbers `wx wy wz`, or a header that names them and no timestamps",
        refuse=refuse_other_sensor,
    ),
)
