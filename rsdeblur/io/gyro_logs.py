"""Gyro logs in the formats of common apps and cameras.

To add a format, write its `sniff` and `read` in the module of its family and append a `Format` to the `FORMATS` there;
the first whose `sniff` accepts the content wins.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

from rsdeblur._util import validate
from rsdeblur.io import archives, gyro_binary, gyro_tables, gyroflow
from rsdeblur.io.samples import GyroFile, Samples, finish
from rsdeblur.io.source import Format, Source, choose
from rsdeblur.io.text import line_error
from rsdeblur.motion.axes import orientation as orientation_matrix
from rsdeblur.motion.gyro import GyroLog

WHAT = "gyro log"
FORMATS: tuple[Format[Samples], ...] = (
    *gyro_binary.FORMATS,
    *gyroflow.FORMATS,
    *archives.FORMATS,
    *gyro_tables.FORMATS,
)
# Formats that many tables fit; in an archive, the file of an app comes first.
ANY_TABLE = ("plain", "unstamped")
ADVICE = (
    "; name the columns of a table in its first line, like t,wx,wy,wz, or with units t_ms,wx_deg_s,wy_deg_s,wz_deg_s"
)


def read_gyro(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    unit: str | None = None,
    orientation: str | None = None,
    rate: float | None = None,
) -> GyroLog:
    r"""Read a gyro log.

    ===================== ==================================================================================
    ``gyrodata``          JPEG with a GYRODATA trailer
    ``video``             telemetry of GoPro, DJI, Sony, Insta360 and others (extra ``[telemetry]``)
    ``gcsv``              Gyroflow ``.gcsv``, its `orientation` applied
    ``gyroflow``          Gyroflow project with gyro data in it (extra ``[gyroflow]`` for current versions)
    ``sensorlogger-json`` Sensor Logger, exported as JSON
    ``mars``              MARS logger ``gyro_accel.csv``, Android or iOS
    ``euroc``             EuRoC ``imu0/data.csv``, Kalibr ``imu0.csv``
    ``phyphox``           phyphox ``Gyroscope.csv``
    ``sensorlogger``      Sensor Logger ``Gyroscope.csv``, renamed columns too
    ``deepgyro``          ``type t_ns x y z``; type 4 (or 16) is the gyro, other sensors are skipped
    ``opencamera``        OpenCamera Sensors ``...gyro.csv``: ``x,y,z,t_ns`` without a header
    ``plain``             ``t wx wy wz`` or ``wx wy wz t``, or a header that names these columns in any order
    ``unstamped``         ``wx wy wz``, just three columns, or a header that names them and no timestamps; needs `rate`
    ===================== ==================================================================================

    A zip archive is searched for a gyro log, and refused if it contains several that are equally likely. Columns of
    text may be separated by commas, semicolons, bars, spaces or tabs; blank lines and lines that start with ``#`` are
    skipped. In a table without a header, the one column that always rises contains the timestamps. Units come from the
    header; without one, rates are in rad/s and the unit of time (s, ms, us or ns) follows from the median sample
    spacing, which is unambiguous for a gyro between 20 Hz and 8 kHz.
    Rates of ``gcsv``, ``gyroflow`` and ``video`` are in Gyroflow's frame (x up, y left, z back), those of the others in
    the sensor's own axes.

    Parameters
    ----------
    path : path-like
        The log. Its content decides the format.
    format : str, optional
        Name of the format, from the table above, instead of detection.
    unit : {"rad/s", "deg/s", "mrad/s", "mdeg/s"}, optional
        Unit of the rates, instead of the one that the file states or its format implies.
    orientation : str, optional
        Orientation string of Gyroflow, such as ``"YxZ"``, that turns the file's raw axes into Gyroflow's frame. It
        replaces the file's own.
    rate : float, optional
        Sampling rate in Hz, 20 to 8000, of a log without timestamps; its first sample is then at time 0.

    Returns
    -------
    GyroLog
        The log. `epoch_ns` is the first timestamp; timestamps are exact integers until the first one is subtracted.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is empty, damaged, cut off or of an unknown format, contains no gyro samples or
        those of an accelerometer, or is an archive of several logs; if `format` is not the name of a format, or the
        file is not in it; if an optional package is needed and not installed; or, naming the line, if a cell is
        missing, not a number or not finite, a rate is impossible, a timestamp conflicts with another or is beyond
        int64, or the column of timestamps does not rise; if the log contains no timestamps and `rate` is missing, or
        contains timestamps and `rate` is given.
    InputError
        If `unit`, `orientation` or `rate` is not a valid one.

    Warns
    -----
    RsdeblurWarning
        If samples were sorted or dropped, if the rates look like degrees or the timestamps like another unit, or if the
        file gives reason for caution.

    Examples
    --------
    >>> import rsdeblur
    >>> with open("gyro.csv", "w") as file:
    ...     _ = file.write("t,wx,wy,wz\n0.00,0.1,0,0\n0.01,0.1,0,0\n")
    >>> rsdeblur.read_gyro("gyro.csv")
    GyroLog(t=[0, 0.01], rate=100, span=(0, 0.01), epoch_ns=0)
    """
    return open_gyro(path, format, unit=unit, orientation=orientation, rate=rate).log


def open_gyro(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    unit: str | None = None,
    orientation: str | None = None,
    rate: float | None = None,
) -> GyroFile:
    """Read a gyro log with the other content of its file.

    Parameters
    ----------
    path, format, unit, orientation, rate
        See `read_gyro`.

    Returns
    -------
    GyroFile
        The log, its file's format, axes and units, and facts for reports.

    Raises
    ------
    FileFormatError, InputError
        See `read_gyro`.
    """
    overrides: dict[str, Any] = {}
    if orientation is not None:
        validate.instance("orientation", orientation, str)
        overrides = {"turn": orientation_matrix(orientation), "axes": "gyroflow", "cautions": ()}
    chosen, source, facts = _choose(path, format)
    samples, path = chosen.read(source), source.path
    # Frees the content, perhaps a gigabyte, before the log is made.
    del source
    facts = {**facts, **samples.facts} | ({"orientation": orientation} if orientation else {})
    return finish(replace(samples, facts=facts, **overrides), chosen.name, unit, rate, partial(line_error, path))


def detect_gyro_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format as which `read_gyro` would read the file.

    Parameters
    ----------
    path : path-like
        The file.

    Returns
    -------
    str
        Name of the format.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is of no known format.
    """
    return _choose(path, None)[0].name


def _choose(path: str | os.PathLike[str], format: str | None) -> tuple[Format[Samples], Source, dict[str, Any]]:
    """Return the format, the source of the log (the file or a member of it), and facts from files beside it."""
    members = archives.members_of(Source(path, WHAT))
    facts = archives.facts_beside(members)
    formats = FORMATS if format is None else (choose(FORMATS, members[0], format),)
    # In their order, so that large files of other sensors are not parsed beside the gyro's.
    for _, group in groupby(members, lambda member: archives.gyro_first(member.path.name)[:2]):
        if fitting := [member for member in group if any(each.fits(member) for each in formats)]:
            member = fitting[0] if len(fitting) == 1 else _only(Path(path), fitting)
            return choose(FORMATS, member, format), member, facts
    return choose(FORMATS, members[0], format, advice=ADVICE), members[0], facts


def _only(archive: Path, members: list[Source]) -> Source:
    """Return the only gyro log among members whose names say equally much; raise `FileFormatError` if two may be it."""
    likely = [each for each in members if not gyro_tables.names_other_sensor(each.path.stem)] or members[:1]
    logs = [each for each in likely if choose(FORMATS, each).name not in ANY_TABLE] or likely
    if len(logs) > 1:
        raise archives.several(archive, WHAT, logs)
    return logs[0]
