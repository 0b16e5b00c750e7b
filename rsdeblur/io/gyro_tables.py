"""Logs of gyros and accelerometers that are text tables, and Sensor Logger's tables in JSON.

Columns are found by name, or by the few layouts without a header. Apps differ only in names, order, units and
separators, so there is one reader. The app that wrote the file decides the axes, and the unit of a column that names
none.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

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
from rsdeblur.io.samples import GRAVITY, GYRO, AnySensor, Axes, Samples, table_samples
from rsdeblur.io.source import Format, Source, text_format
from rsdeblur.io.text import TextFile, cells_of, is_number, read_table, separator_of
from rsdeblur.types import FloatArray

# Android's sensor types: the gyro, the gyro whose bias the phone does not remove, and the accelerometer.
GYRO_TYPE, UNCALIBRATED_TYPE, ACCELEROMETER_TYPE = "4", "16", "1"

# Name of phyphox's second column in the languages of its users.
PHYPHOX = re.compile("g[yi]ros[ck]op[a-z]{,2}x")

# Words in the file names of other sensors, whose tables may have the same columns as a gyro's.
OTHER_SENSORS = re.compile(r"acc|gravity|magn|orientation|compass|barom", re.IGNORECASE)


def _samples(
    text: TextFile, columns: Columns, unit: str, axes: Axes, rows: Sequence[int] | None = None, *, biased: bool = False
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
    time = "none" if t < 0 else columns.time_unit or unit_from_spacing(table)
    return table_samples(
        table,
        None if t < 0 else table.nanoseconds(TIME_UNITS[time]),
        unit=units[0] if units else unit,
        axes=axes,
        time_unit=time,
        facts={"bias": "not removed by the phone"} if biased else {},
    )


def table_format(
    name: str,
    title: str,
    columns_of: Callable[[TextFile], Columns | None],
    expected: str,
    *,
    fits: Callable[[TextFile, Columns], bool] = lambda text, columns: True,
    axes: Axes = "sensor",
    unit: str = "rad/s",
    is_nameless: Callable[[TextFile], bool] = lambda text: False,
) -> Format[Samples]:
    """Return a format of tables with the columns that `columns_of` finds; `expected` says what should be there.

    `fits` returns whether a table with these columns looks like this format, `is_nameless` whether the columns do not
    name the sensor, so that a file that is named after another one is refused. `unit` is that of values without one.
    """

    def sniff(text: TextFile) -> bool:
        columns = columns_of(text)
        return columns is not None and fits(text, columns)

    def read(text: TextFile) -> Samples:
        columns = columns_of(text)
        if columns is None:
            raise text.error(f"expected {expected}", text.rows[0])
        stem = text.path.stem
        if is_nameless(text) and names_other_sensor(stem):
            raise text.error(f"the file is named after another sensor than the gyro ({stem}); give the gyro's file")
        return _samples(text, columns, unit, axes, biased="uncalibrated" in stem.lower())

    return text_format(name, title, sniff, read)


def names_other_sensor(name: str) -> bool:
    """Return whether a file's name is that of another sensor's file."""
    return OTHER_SENSORS.search(name) is not None and "gyr" not in name.lower()


def _sensorlogger_columns(text: TextFile) -> Columns | None:
    # Sensor Logger calls the columns of all its sensors z, y and x, in this order; some users rename them.
    columns = named_columns(text, RATE.bare)
    return replace(columns, time_unit="ns") if columns and {"time", "secondselapsed"} <= set(columns.names) else None


def _is_opencamera(text: TextFile, columns: Columns) -> bool:
    grid = layout_grid(text, 4)
    if grid is None or 3 not in rising(grid):
        return False
    # The first column, a rate, may rise for a while too; but only timestamps in ns are whole numbers that far apart.
    timestamps = grid[:, 3]
    spacing = (timestamps[-1] - timestamps[0]) / (len(text.rows) - 1)
    return bool(SPACING[0] <= spacing <= SPACING[1] and (timestamps == np.rint(timestamps)).all())


def _type_of(line: str) -> str:
    word = cells_of(line)[0].lower()
    return GYRO_TYPE if word.startswith("gyr") else ACCELEROMETER_TYPE if word.startswith("acc") else word


def _is_tagged(text: TextFile) -> bool:
    """Whether the lines read `type t_ns x y z`."""
    cells = cells_of(text.head)
    if len(cells) != 5 or not cells[1].isdecimal() or not all(map(is_number, cells[2:])):
        return False
    if cells[0].isdecimal() and separator_of(text.head) is None:
        return True
    return any(_type_of(text.lines[row]) in (GYRO_TYPE, UNCALIBRATED_TYPE) for row in text.rows)


def _tagged_format(sensor: AnySensor) -> Format[Samples]:
    """Return the format of lines `type t_ns x y z`, of which the first type of the sensor is read."""
    what, kinds = ("a gyro", [GYRO_TYPE, UNCALIBRATED_TYPE]) if sensor is GYRO else ("an accelerometer", ["1"])

    def read(text: TextFile) -> Samples:
        rows: dict[str, list[int]] = {}
        for row in text.rows.tolist():
            kind = _type_of(text.lines[row])
            if not (kind.isdecimal() or (kind.isalpha() and len(kind) > 2)):
                raise text.error(f"{kind[:40]!r} is not a sensor type; lines must read `type t_ns x y z`", row)
            rows.setdefault(kind, []).append(row)
        kind = next((each for each in kinds if each in rows), "")
        if not kind:
            raise text.error(f"the file contains no samples of {what}: no line is of type {' or '.join(kinds)}")
        columns = Columns((1, 2, 3, 4), "ns")
        return _samples(text, columns, sensor.unit, "phone", rows[kind], biased=kind == UNCALIBRATED_TYPE)

    return text_format("deepgyro", "imu.txt with types, `type t_ns x y z`", _is_tagged, read)


def _plain_columns(text: TextFile, sensor: AnySensor = GYRO) -> Columns | None:
    """Return named columns, or those of the sensor in a table of four or seven numbers without a header."""
    named = named_columns(text, sensor.quantity)
    if named is not None:
        return named
    is_own = ("gyr" if sensor is GYRO else "acc") in text.path.stem.lower()
    bare = named_columns(text, sensor.quantity.bare)
    if bare is not None and (any(bare.value_units) or bare.sensors or is_own):
        return bare
    for width in (4, 7):
        grid = layout_grid(text, width)
        if grid is not None:
            own, others = _sensors_beside(grid) if sensor is GYRO else _sensors_beside(grid)[::-1]
            # Four columns of an accelerometer are refused later, with the reason.
            is_only = width == 4 and (sensor is GYRO or is_own)
            return own[0] if len(own) == 1 else others[0] if is_only else None
    return None


def _sensors_beside(grid: FloatArray) -> tuple[list[Columns], list[Columns]]:
    """Return the columns of the gyros and of the accelerometers, which show gravity, beside that of the timestamps."""
    gyros: list[Columns] = []
    accelerometers: list[Columns] = []
    t = time_column(grid)
    others = [k for k in range(grid.shape[1]) if k != t]
    for x, y, z in zip(others[::3], others[1::3], others[2::3], strict=True):
        # Impossible values, whose squares overflow, are refused later.
        with np.errstate(over="ignore"):
            size = float(np.median(np.linalg.norm(grid[:, (x, y, z)], axis=1)))
        (accelerometers if abs(size - GRAVITY) < 2 else gyros).append(Columns((t, x, y, z)))
    return gyros, accelerometers


def _unstamped_columns(text: TextFile) -> Columns | None:
    named = named_columns(text, stamped=False)
    return named if named is not None or layout_grid(text, 3) is None else Columns((-1, 0, 1, 2))


# Sensor Logger's names of the sensors; its "Accelerometer" is without gravity.
SENSORS = {
    "rates": ("Gyroscope", "GyroscopeUncalibrated"),
    "accelerations": ("TotalAcceleration", "AccelerometerUncalibrated", "Accelerometer"),
}
# What reports say of its exports.
FACTS = ("device name", "platform", "appVersion")


def _is_json(source: Source) -> bool:
    # Searching the start for the key avoids parsing large JSON files of other kinds.
    return source.looks_like_json and b'"sensor"' in source.head and isinstance(source.json, list)


def _read_json(source: Source, sensor: AnySensor) -> Samples:
    """Read the likeliest log of the sensor in a JSON export of Sensor Logger."""
    if not isinstance(source.json, list):
        raise source.error("not a Sensor Logger export: expected a list of samples")
    by_sensor: dict[str, list[dict[str, Any]]] = {}
    for entry in source.json:
        if isinstance(entry, dict):
            by_sensor.setdefault(str(entry.get("sensor")), []).append(entry)
    names = SENSORS[sensor.values]
    name = next((each for each in names if each in by_sensor), None)
    if name is None:
        found = ", ".join(sorted(by_sensor))[:200]
        raise source.error(f"the file contains no samples of the {names[0].lower()}, only of {found}")
    with source.parsing(f"a sample of {name} lacks a number"):
        ns = np.array([int(entry["time"]) for entry in by_sensor[name]], dtype=np.int64)
        values = np.array([[float(entry[axis]) for axis in "xyz"] for entry in by_sensor[name]])
    device = next(iter(by_sensor.get("Metadata", [])), {})
    facts = {"sensor": name} | {key: device[key] for key in FACTS if key in device}
    return Samples(
        ns, values, lambda message, i: source.error(f"sample {i} of {name}: {message}"), unit=sensor.unit, facts=facts
    )


NAMED = "a header that names the timestamps and the rates about x, y and z"
GYRO_FORMATS: tuple[Format[Samples], ...] = (
    table_format(
        "mars",
        "MARS logger gyro_accel.csv",
        named_columns,
        NAMED,
        fits=lambda text, columns: columns.names[0] == "timestamp" and "[nanosec]" in text.head.lower(),
        axes="phone",
    ),
    table_format(
        "euroc",
        "EuRoC or Kalibr IMU CSV",
        named_columns,
        NAMED,
        fits=lambda text, columns: "wrssx" in columns.names or {"omegax", "alphax"} <= set(columns.names),
    ),
    table_format(
        "phyphox",
        "phyphox Gyroscope.csv",
        named_columns,
        NAMED,
        fits=lambda text, columns: columns.time_unit == "s" and PHYPHOX.fullmatch(columns.names[1]) is not None,
        axes="phone",
    ),
    table_format(
        "sensorlogger",
        "Sensor Logger Gyroscope.csv",
        _sensorlogger_columns,
        "the header of Sensor Logger: time, seconds_elapsed, z, y, x",
        axes="phone",
        is_nameless=lambda text: named_columns(text) is None,
    ),
    _tagged_format(GYRO),
    table_format(
        "opencamera",
        "OpenCamera Sensors gyro.csv, `x,y,z,t_ns`",
        lambda text: Columns((3, 0, 1, 2)),
        "`x,y,z,t_ns`",
        fits=_is_opencamera,
        axes="phone",
        is_nameless=lambda text: True,
    ),
    table_format(
        "plain",
        "`t wx wy wz` or `wx wy wz t`",
        # If the user names the format, columns called x, y and z are rates, unless the file's name says otherwise.
        lambda text: _plain_columns(text) or named_columns(text, RATE.bare),
        "four numbers `t wx wy wz`, or a header that names them",
        fits=lambda text, columns: _plain_columns(text) is not None,
        is_nameless=lambda text: _plain_columns(text) is None,
    ),
    table_format(
        "unstamped",
        "`wx wy wz` without timestamps, with a sampling rate",
        _unstamped_columns,
        "three numbers `wx wy wz`, or a header that names them and no timestamps",
        is_nameless=lambda text: True,
    ),
)


def formats(sensor: AnySensor) -> tuple[Format[Samples], ...]:
    """Return the formats of a sensor's logs."""
    json = Format("sensorlogger-json", "Sensor Logger JSON export", _is_json, partial(_read_json, sensor=sensor))
    if sensor is GYRO:
        return (json, *GYRO_FORMATS)
    table = table_format(
        "plain",
        "table with named columns, or columns that show gravity",
        lambda text: _plain_columns(text, sensor),
        "columns of timestamps and accelerations",
        unit=sensor.unit,
    )
    return json, table, _tagged_format(sensor)
