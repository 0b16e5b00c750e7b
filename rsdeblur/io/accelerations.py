"""Logs of accelerometers, from the files of gyro logs or beside them."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np

from rsdeblur.errors import FileFormatError
from rsdeblur.io.archives import is_sensorlogger_json, members_of, read_sensorlogger_json, several
from rsdeblur.io.columns import ACCELERATION, Columns, layout_grid, named_columns, time_column
from rsdeblur.io.gyro_binary import is_video, telemetry_of
from rsdeblur.io.gyro_tables import ACCELEROMETER_TYPE, is_tagged, read_tagged, sensors_beside, table_format
from rsdeblur.io.gyroflow import is_gcsv, read_gcsv
from rsdeblur.io.samples import Samples, finish_acceleration, nanoseconds
from rsdeblur.io.source import Format, Source, choose, text_format
from rsdeblur.io.text import TextFile, line_error
from rsdeblur.motion.acceleration import AccelerationLog

WHAT = "log of an accelerometer"
# Sensor Logger's names; its "Accelerometer" is without gravity.
SENSORS = ("TotalAcceleration", "AccelerometerUncalibrated", "Accelerometer")


def read_acceleration(path: str | os.PathLike[str], *, unit: str | None = None) -> AccelerationLog:
    """Read the log of an accelerometer.

    Reads MARS logger's ``gyro_accel.csv``, EuRoC's and Kalibr's IMU tables, phyphox's ``Accelerometer.csv``, Sensor
    Logger's ``TotalAcceleration.csv`` and JSON export, OpenCamera Sensors' ``...accel.csv``, DeepGyro's ``imu.txt``
    (lines of type 1), Gyroflow's ``.gcsv``, tables of time, gyro and accelerometer, other tables whose header names the
    columns, zip archives of these, and the telemetry of videos. The axes are those in which :func:`read_gyro` reads the
    gyro of the same device.

    Parameters
    ----------
    path : path-like
        The file; that of the gyro log if it contains both sensors.
    unit : {"m/s^2", "g", "mg"}, optional
        Unit of the accelerations, instead of that in the header or, without one, m/s^2.

    Returns
    -------
    AccelerationLog
        The log, in m/s^2.

    Raises
    ------
    FileFormatError
        If the file cannot be read or contains no accelerometer; if its median is not gravity in the unit, as after an
        app has removed gravity; if it is an archive of several recordings; or for the reasons of :func:`read_gyro`.
    InputError
        If `unit` is not a valid one.

    Warns
    -----
    RsdeblurWarning
        If samples were sorted or dropped.
    """
    source = _only(Path(path), members_of(Source(path, WHAT), _order))
    return finish_acceleration(choose(FORMATS, source).read(source), unit, partial(line_error, source.path))


def _only(path: Path, members: list[Source]) -> Source:
    """Return the first member that is such a log; raise `FileFormatError` if a file of the same name is one, too."""
    logs = [member for member in members if any(each.fits(member) for each in FORMATS)] or members[:1]
    again = [member for member in logs[1:] if member.path.name == logs[0].path.name]
    if again:
        raise several(path, WHAT, [logs[0], again[0]])
    return logs[0]


def _order(name: str) -> tuple[bool, bool, str]:
    """Sort key of file names: with gravity first, then other accelerometers."""
    stem = Path(name).stem.lower()
    return "totalacc" not in stem, "acc" not in stem, name


def _named(text: TextFile) -> Columns | None:
    columns = named_columns(text, ACCELERATION)
    if columns is not None or "acc" not in text.path.stem.lower():
        return columns
    return named_columns(text, ACCELERATION.bare)


def _unnamed(text: TextFile) -> Columns | None:
    """Return the only columns that show gravity in a table of four or seven columns without a header."""
    for width in (4, 7):
        grid = layout_grid(text, width)
        if grid is not None:
            gyros, accelerometers = sensors_beside(grid, time_column(grid))
            if "acc" in text.path.stem.lower() and width == 4:
                return (accelerometers or gyros)[0]
            return accelerometers[0] if len(accelerometers) == 1 else None
    return None


def _read_video(source: Source) -> Samples:
    telemetry = telemetry_of(source)
    times = [sample["timestamp_ms"] for sample in telemetry.samples if sample.get("gyro") is not None]
    values = [sample["accl"] for sample in telemetry.samples if sample.get("accl") is not None]
    if not values or len(times) < 2:
        raise source.error(f"the video of this {telemetry.camera} has no samples of an accelerometer")
    # telemetry-parser puts both sensors' samples side by side by their number, whatever their rates; they span the
    # same time.
    timestamps = np.linspace(times[0], times[-1], len(values))

    def error_at(message: str, i: int) -> FileFormatError:
        return source.error(f"accelerometer sample {i}: {message}")

    return Samples(nanoseconds(timestamps, error_at), np.array(values, dtype=np.float64), error_at, unit="m/s^2")


FORMATS: tuple[Format[Samples], ...] = (
    Format("video", "video with a telemetry track", is_video, _read_video),
    Format(
        "sensorlogger-json",
        "Sensor Logger JSON export",
        is_sensorlogger_json,
        lambda source: read_sensorlogger_json(source, SENSORS, "m/s^2"),
    ),
    text_format("gcsv", "Gyroflow .gcsv", is_gcsv, lambda text: read_gcsv(text, "a", "g")),
    table_format(
        "named", "table with named columns", _named, "a header that names timestamps and accelerations", unit="m/s^2"
    ),
    text_format(
        "deepgyro",
        "imu.txt with types, `type t_ns x y z`",
        is_tagged,
        lambda text: read_tagged(text, (ACCELEROMETER_TYPE,), "an accelerometer", "m/s^2"),
    ),
    table_format(
        "plain", "table that shows gravity", _unnamed, "timestamps and three columns that show gravity", unit="m/s^2"
    ),
)
