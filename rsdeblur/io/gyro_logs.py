"""Logs of gyros and accelerometers in the formats of common apps and cameras.

To add a format, write its `sniff` and `read` in a file of its own and add its `formats` to `FAMILIES`; the first whose
`sniff` accepts the content wins. One more table of text is a row of `gyro_tables.GYRO_FORMATS`, before `plain`.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any

from rsdeblur._util import validate
from rsdeblur.io import gyro_binary, gyro_tables, gyroflow
from rsdeblur.io.gyro_tables import FACTS
from rsdeblur.io.samples import ACCELEROMETER, GYRO, AnySensor, GyroFile, Samples, finish
from rsdeblur.io.source import Format, Source, choose, members_of
from rsdeblur.io.text import line_error
from rsdeblur.motion.acceleration import AccelerationLog
from rsdeblur.motion.axes import orientation as orientation_matrix
from rsdeblur.motion.gyro import GyroLog

FAMILIES = (gyro_binary.formats, gyroflow.formats, gyro_tables.formats)


@cache
def formats(sensor: AnySensor) -> tuple[Format[Samples], ...]:
    """Return the formats of a sensor's logs, in the order in which they are tried."""
    return tuple(each for family in FAMILIES for each in family(sensor))


def read_gyro(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    unit: str | None = None,
    orientation: str | None = None,
    rate: float | None = None,
) -> GyroLog:
    r"""Read a gyro log.

    A zip archive is searched for a gyro log, and refused if it contains several that are equally likely. Units come
    from the header; without one, rates are in rad/s and the unit of time (s, ms, us or ns) follows from the median
    sample spacing, which is unambiguous for a gyro between 20 Hz and 8 kHz.
    Rates of ``gcsv``, ``gyroflow`` and ``video`` are in Gyroflow's frame (x up, y left, z back), those of the others in
    the sensor's own axes.

    Parameters
    ----------
    path : path-like
        The log. Its content decides the format.
    format : str, optional
        Name of the format instead of detection: ``gcsv``, ``plain``, ... The page on files describes each.
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
    """Read a gyro log, as :func:`read_gyro` does, with the other content of its file.

    Parameters
    ----------
    path, format, unit, orientation, rate
        See :func:`read_gyro`.
    """
    overrides: dict[str, Any] = {}
    if orientation is not None:
        validate.instance("orientation", orientation, str)
        overrides = {"turn": orientation_matrix(orientation), "axes": "gyroflow", "cautions": ()}
    chosen, source, facts = _choose(path, GYRO, format)
    samples, path = chosen.read(source), source.path
    # Frees the content, perhaps a gigabyte, before the log is made.
    del source
    samples = replace(samples, **overrides)
    facts = {**facts, **samples.facts} | ({"orientation": orientation} if orientation else {})
    log = finish(samples, GYRO, unit, rate, partial(line_error, path))
    return GyroFile(log, chosen.name, samples.axes, samples.time_unit, unit or samples.unit, facts)


def read_acceleration(path: str | os.PathLike[str], *, unit: str | None = None) -> AccelerationLog:
    """Read the log of an accelerometer, from the file of a gyro log or its own.

    The formats are those of :func:`read_gyro`, except Gyroflow's projects; the axes are those in which it reads the
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
    chosen, source, _ = _choose(path, ACCELEROMETER, None)
    return finish(chosen.read(source), ACCELEROMETER, unit, None, partial(line_error, source.path))


def detect_gyro_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format as which `read_gyro` would read the file.

    Parameters
    ----------
    path : path-like
        The file.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is of no known format.
    """
    return _choose(path, GYRO, None)[0].name


def _choose(
    path: str | os.PathLike[str], sensor: AnySensor, format: str | None
) -> tuple[Format[Samples], Source, dict[str, Any]]:
    """Return the format, the source of the log (the file or a member of it), and facts from files beside it."""
    known = formats(sensor)
    order = partial(_order, sensor=sensor)
    members = members_of(Source(path, sensor.what), order)
    facts = _facts_beside(members)
    tried = known if format is None else (choose(known, members[0], format),)
    # In their order, so that large files of other sensors are not parsed beside the log.
    for _, group in groupby(members, lambda member: order(member.path.name)[:2]):
        if fitting := [member for member in group if any(each.fits(member) for each in tried)]:
            member = fitting[0] if len(fitting) == 1 else _only(Path(path), fitting, sensor)
            return choose(known, member, format), member, facts
    advice = (
        "; name the columns of a table in its first line, like t,wx,wy,wz, or with units t_ms,wx_deg_s,wy_deg_s,..."
    )
    return choose(known, members[0], format, advice=advice * (sensor is GYRO)), members[0], facts


def _order(name: str, sensor: AnySensor) -> tuple[bool, bool, str]:
    """Sort key of file names: first a gyro without its bias, or an accelerometer with gravity, last other sensors."""
    stem = Path(name).stem.lower()
    if sensor is GYRO:
        return "gyro" not in stem, "uncalibrated" in stem, name
    return "totalacc" not in stem, "acc" not in stem, name


def _facts_beside(members: list[Source]) -> dict[str, Any]:
    """Return device and app from Sensor Logger's `Metadata.csv`; empty if it is not among the files."""
    for member in members:
        if member.path.name.lower() == "metadata.csv" and member.looks_like_text and len(member.text.lines) > 1:
            names, values = (line.strip().split(",") for line in member.text.lines[:2])
            return {name: value for name, value in zip(names, values, strict=False) if name in FACTS and value}
    return {}


def _only(archive: Path, members: list[Source], sensor: AnySensor) -> Source:
    """Return the only log among members whose names say equally much; raise `FileFormatError` if two may be it."""
    if sensor is GYRO:
        likely = [each for each in members if not gyro_tables.names_other_sensor(each.path.stem)] or members[:1]
        # Many tables fit these formats; the file of an app comes first.
        logs = [each for each in likely if choose(formats(GYRO), each).name not in ("plain", "unstamped")] or likely
    else:
        logs = [each for each in members if each.path.name == members[0].path.name]
    if len(logs) > 1:
        first, second = (each.path.relative_to(archive).as_posix() for each in logs[:2])
        raise line_error(
            archive,
            f"the archive contains more than one {sensor.what}, {first} and {second}; extract the one of your photo or "
            "video, and give that",
        )
    return logs[0]
