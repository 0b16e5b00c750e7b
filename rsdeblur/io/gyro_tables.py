"""Logs of gyros and accelerometers that are text tables, and Sensor Logger's tables in JSON.

Columns are those that the user chose, or found by name, or by the few layouts without a header. Apps differ only in
names, order, units and separators, so there is one reader. The app that wrote the file decides the axes.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from rsdeblur.io.columns import (
    RATE,
    SENSOR,
    TIME_UNITS,
    Columns,
    check_layout,
    choices_of,
    chosen_columns,
    layout_grid,
    named_columns,
    rising,
    time_column,
    unit_of_time,
)
from rsdeblur.io.formats import Format
from rsdeblur.io.samples import ACCELEROMETER, GRAVITY, GYRO, AnySensor, Axes, Samples
from rsdeblur.io.source import Source, cells_of, is_number, read_table, separator_of
from rsdeblur.motion.units import FASTEST, SLOWEST

# Android's sensor types: the gyro, the gyro whose bias the phone does not remove, and the accelerometer.
GYRO_TYPE, UNCALIBRATED_TYPE, ACCELEROMETER_TYPE = "4", "16", "1"

# Words in the file names of other sensors, whose tables may have the same columns as a gyro's.
OTHER_SENSORS = re.compile(r"acc|gravity|magn|orientation|compass|barom", re.IGNORECASE)

# Apps known by their headers, in lower case and without quotes, and the axes of their rates, which are in rad/s.
# phyphox names the gyro in the languages of its users, or not at all.
APPS: dict[str, tuple[str, str, Axes]] = {
    "mars": ("MARS logger gyro_accel.csv", r"timestamp\[nanosec\], ?gx", "phone"),
    "euroc": ("EuRoC or Kalibr IMU CSV", r".*(w_rs_s_x|omega_x.*alpha_x)", "sensor"),
    "phyphox": ("phyphox Gyroscope.csv", r"\S+ \(s\)[,;\t] *(g[yi]ros[ck]op\w* )?x \(rad/s\)", "phone"),
    "sensorlogger": ("Sensor Logger Gyroscope.csv", r"time[,;\t] *seconds_elapsed", "phone"),
}


def _read(
    source: Source,
    columns: Columns,
    sensor: AnySensor,
    axes: Axes = "sensor",
    unit: str | None = None,
    *,
    forces: Columns | None = None,
    rows: Sequence[int] | None = None,
) -> Samples:
    """Read a table, or `rows` of it; `unit` is that of values without one, `forces` the accelerometer's columns."""
    if not columns.is_named and sensor is GYRO and names_other_sensor(stem := source.path.stem):
        raise source.error(f"the file is named after another sensor than the gyro ({stem}); give the gyro's file")
    lines = np.asarray(source.rows[columns.start :] if rows is None else rows, dtype=np.intp)
    t, x, y, z = columns.places
    table = read_table(source, lines, (x if t < 0 else t, x, y, z))
    check_layout(source, lines, columns)
    units = sorted({each for each in columns.units[1:] if each})
    if len(units) > 1:
        raise source.error(f"the values are in {' and '.join(units)}; they must all have one unit")
    unit = units[0] if units else unit
    time = "none" if t < 0 else columns.units[0] or unit_of_time(table, columns, sensor.quantity)
    return Samples(
        source.path,
        None if t < 0 else table.nanoseconds(TIME_UNITS[time]),
        table.values,
        table.rows,
        unit=unit,
        axes=axes,
        time_unit=time,
        forces=read_table(source, lines, forces.places).values if forces and unit is None else None,
    )


def names_other_sensor(name: str) -> bool:
    """Whether a file's name is that of another sensor's file."""
    return OTHER_SENSORS.search(name) is not None and "gyr" not in name.lower()


def _table(
    name: str,
    title: str,
    columns_of: Callable[[Source], Columns | None],
    axes: Axes = "sensor",
    unit: str | None = None,
    forces_of: Callable[[Source], Columns | None] = lambda source: _plain_columns(source, ACCELEROMETER),
) -> Format[Samples]:
    """Return the format of the tables in which `columns_of` finds columns; see `_read`."""

    def read(source: Source, sensor: AnySensor) -> Samples:
        columns = cast("Columns", columns_of(source))
        forces = forces_of(source) if sensor is GYRO else None
        is_beside = forces is not None and set(columns.places[1:]).isdisjoint(forces.places[1:])
        return _read(source, columns, sensor, axes, unit, forces=forces if is_beside else None)

    return Format(name, title, columns_of, read)


def columns_format(sensor: AnySensor, columns: str) -> Format[Samples]:
    """Return the format of tables whose columns the user chose."""
    chosen = choices_of(columns).get("gyro log", {})

    def columns_of(source: Source, sensor: AnySensor = sensor) -> Columns:
        return chosen_columns(source, columns, "gyro log", sensor.quantity, stamped=False)

    forces_of = partial(columns_of, sensor=ACCELEROMETER) if "ax" in chosen else lambda source: None
    return _table("columns", "table whose columns are given", columns_of, forces_of=forces_of)


def _app_columns(source: Source, header: str) -> Columns | None:
    columns = named_columns(source) or named_columns(source, RATE.bare)
    if columns is None or not re.match(header, columns.header.lower().replace('"', "").lstrip()):
        return None
    # Sensor Logger calls the columns of all its sensors z, y and x, in this order; some users rename them.
    return replace(columns, is_named=any(columns.units[1:]) or named_columns(source) is not None)


def _opencamera_columns(source: Source) -> Columns | None:
    grid = layout_grid(source, 4)
    if grid is None or 3 not in rising(grid):
        return None
    # The first column, a rate, may rise for a while too; but only timestamps in ns are whole numbers that far apart.
    timestamps = grid[:, 3]
    rate = 1e9 * (len(source.rows) - 1) / (timestamps[-1] - timestamps[0])
    return Columns((3, 0, 1, 2)) if SLOWEST <= rate <= FASTEST and (timestamps == np.rint(timestamps)).all() else None


def _type_of(line: str) -> str:
    word = cells_of(line)[0].lower()
    return GYRO_TYPE if word.startswith("gyr") else ACCELEROMETER_TYPE if word.startswith("acc") else word


def _is_tagged(source: Source) -> bool:
    """Whether the lines read `type t x y z`."""
    cells = cells_of(source.first_line)
    if len(cells) != 5 or not cells[1].isdecimal() or not all(map(is_number, cells[2:])):
        return False
    if cells[0].isdecimal() and separator_of(source.first_line) is None:
        return True
    return any(_type_of(source.lines[row]) in (GYRO_TYPE, UNCALIBRATED_TYPE) for row in source.rows)


def _read_tagged(source: Source, sensor: AnySensor) -> Samples:
    """Read the lines `type t x y z` of the first type of the sensor."""
    what, kinds = ("a gyro", [GYRO_TYPE, UNCALIBRATED_TYPE]) if sensor is GYRO else ("an accelerometer", ["1"])
    rows: dict[str, list[int]] = {}
    for row in source.rows.tolist():
        kind = _type_of(source.lines[row])
        if not (kind.isdecimal() or (kind.isalpha() and len(kind) > 2)):
            raise source.error(f"{kind[:40]!r} is not a sensor type; lines must read `type t_ns x y z`", row)
        rows.setdefault(kind, []).append(row)
    kind = next((each for each in kinds if each in rows), "")
    if not kind:
        raise source.error(f"the file contains no samples of {what}: no line is of type {' or '.join(kinds)}")
    samples = _read(source, Columns((1, 2, 3, 4), is_named=True), sensor, "phone", rows=rows[kind])
    # Without ns it is not DeepGyro's, but another program's unit of rates and axes.
    return replace(samples, unit=sensor.unit) if samples.time_unit == "ns" else replace(samples, axes="sensor")


def _plain_columns(source: Source, sensor: AnySensor = GYRO) -> Columns | None:
    """Return named columns, or those of the sensor in a table of four or seven numbers without a header."""
    named = named_columns(source, sensor.quantity)
    if named is not None:
        return named
    is_own = ("gyr" if sensor is GYRO else "acc") in source.path.stem.lower()
    bare = named_columns(source, sensor.quantity.bare)
    if bare is not None and (any(bare.units[1:]) or any(map(SENSOR.fullmatch, bare.names)) or is_own):
        return bare
    grid = next((grid for width in (4, 7) if (grid := layout_grid(source, width)) is not None), None)
    if grid is None:
        return None
    t = time_column(grid)
    others = [k for k in range(grid.shape[1]) if k != t]
    triples = [others[:3], others[3:]][: len(others) // 3]
    # Impossible values, whose squares overflow, are refused later.
    with np.errstate(over="ignore"):
        sizes = [float(np.median(np.linalg.norm(grid[:, triple], axis=1))) for triple in triples]
    own = [triple for triple, size in zip(triples, sizes, strict=True) if (abs(size - GRAVITY) < 2) != (sensor is GYRO)]
    # A single sensor that is another one is refused later, with the reason.
    is_only = len(triples) == 1 and (sensor is GYRO or is_own)
    fits = own if len(own) == 1 else triples * is_only
    return Columns((t, *fits[0]), is_named=len(triples) > 1) if fits else None


def _unstamped_columns(source: Source) -> Columns | None:
    named = named_columns(source, stamped=False)
    return named if named is not None or layout_grid(source, 3) is None else Columns((-1, 0, 1, 2))


# Sensor Logger's names of the sensors; its "Accelerometer" is without gravity.
SENSORS = {
    "rates": ("Gyroscope", "GyroscopeUncalibrated"),
    "accelerations": ("TotalAcceleration", "AccelerometerUncalibrated", "Accelerometer"),
}


def _is_json(source: Source) -> bool:
    # Searching the start for the key avoids parsing large JSON files of other kinds.
    return source.looks_like_json and b'"sensor"' in source.head and isinstance(source.json, list)


def _read_json(source: Source, sensor: AnySensor) -> Samples:
    """Read the likeliest log of the sensor in a JSON export of Sensor Logger."""
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
    return Samples(source.path, ns, values, unit=sensor.unit, facts={"sensor": name})


_JSON = Format("sensorlogger-json", "Sensor Logger JSON export", _is_json, _read_json)
_TAGGED = Format("deepgyro", "imu.txt with types, `type t_ns x y z`", _is_tagged, _read_tagged)
FORMATS: dict[AnySensor, tuple[Format[Samples], ...]] = {
    GYRO: (
        _JSON,
        *(
            _table(name, title, partial(_app_columns, header=header), axes, "rad/s")
            for name, (title, header, axes) in APPS.items()
        ),
        _TAGGED,
        _table("opencamera", "OpenCamera Sensors gyro.csv, `x,y,z,t_ns`", _opencamera_columns, "phone", "rad/s"),
        _table("plain", "`t wx wy wz` or `wx wy wz t`, or a header that names them", _plain_columns),
        _table("unstamped", "`wx wy wz` without timestamps, with a sampling rate", _unstamped_columns),
    ),
    ACCELEROMETER: (
        _JSON,
        _table(
            "plain",
            "table with named columns, or columns that show gravity",
            partial(_plain_columns, sensor=ACCELEROMETER),
            unit=ACCELEROMETER.unit,
        ),
        _TAGGED,
    ),
}
