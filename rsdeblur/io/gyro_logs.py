"""Logs of gyros and accelerometers in the formats of common apps and cameras.

To add a format, write its `sniff` and `read` in a file of its own and add it to `FORMATS`; the first whose `sniff`
accepts the content wins. One more app that writes a table is a row of `gyro_tables.APPS`.
"""

import os
from dataclasses import replace
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.io import gyro_binary, gyro_tables, gyroflow
from rsdeblur.io.formats import Format, choose, members_of, mistaken
from rsdeblur.io.samples import ACCELEROMETER, GYRO, AnySensor, GyroFile, Samples, finish
from rsdeblur.io.source import Source, cells_of, is_number, line_error
from rsdeblur.motion.axes import imu_to_camera
from rsdeblur.motion.axes import orientation as orientation_matrix
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.gyro import AccelerationLog, GyroLog

# The formats of each sensor's logs, in the order in which they are tried.
FORMATS: dict[AnySensor, tuple[Format[Samples], ...]] = {
    GYRO: (gyro_binary.JPEG, gyro_binary.VIDEO, gyroflow.GCSV, gyroflow.PROJECT, *gyro_tables.FORMATS[GYRO]),
    ACCELEROMETER: (gyro_binary.VIDEO, gyroflow.GCSV, *gyro_tables.FORMATS[ACCELEROMETER]),
}


def read_gyro(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    unit: str | None = None,
    orientation: str | None = None,
    rate: float | None = None,
    columns: str | None = None,
) -> GyroLog:
    r"""Read a gyro log.

    A zip archive is searched for a gyro log, and refused if it contains several that are equally likely. Units come
    from the header; without one, the samples must show them: the unit of time (s, ms, us or ns) by a date since 2000,
    the sampling rate and the span, degrees by the accelerometer beside the gyro. A unit that stays open is refused.
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
        Sampling rate in Hz, 2 to 10000, of a log without timestamps; its first sample is then at time 0.
    columns : str, optional
        Columns of a table by names or by numbers from 1, perhaps with units: ``"t=time:us,gx=3,gy=4,gz=5"``. Lines
        above the table are skipped. Rates are in the sensor's own axes.

    Returns
    -------
    GyroLog
        The log. `epoch_ns` is the first timestamp; timestamps are exact integers until the first one is subtracted.

    Raises
    ------
    FileFormatError
        If the file is damaged, not in `format` or a known format, contains no gyro samples or several logs, or needs an
        optional package; if a cell, a rate or a timestamp is impossible, with its line; if timestamps are missing
        without `rate`, or present with it.
    InputError
        If `unit`, `orientation`, `rate` or `columns` is not a valid one.

    Warns
    -----
    RsdeblurWarning
        If samples were sorted or dropped, if the rates look like degrees, are slow or saturated, or if the file gives
        reason for caution.

    Examples
    --------
    >>> import rsdeblur
    >>> with open("gyro.csv", "w") as file:
    ...     _ = file.write("t,wx,wy,wz\n0.00,0.1,0,0\n0.01,0.1,0,0\n")
    >>> rsdeblur.read_gyro("gyro.csv")
    GyroLog(t=[0, 0.01], rate=100, span=(0, 0.01), epoch_ns=0)
    """
    return open_gyro(path, format, unit=unit, orientation=orientation, rate=rate, columns=columns).log


def open_gyro(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    unit: str | None = None,
    orientation: str | None = None,
    rate: float | None = None,
    columns: str | None = None,
) -> GyroFile:
    """Read a gyro log, as :func:`read_gyro` does, with the other content of its file.

    Parameters
    ----------
    path, format, unit, orientation, rate, columns
        See :func:`read_gyro`.
    """
    turn = None if orientation is None else orientation_matrix(validate.instance("orientation", orientation, str))
    chosen, source, pauses = _choose(path, GYRO, format, columns)
    samples = chosen.read(source, GYRO)
    # Frees the content, perhaps a gigabyte, before the log is made.
    del source
    if turn is not None:
        facts = {**samples.facts, "orientation": orientation}
        samples = replace(samples, turn=turn, axes="gyroflow", facts=facts, cautions=())
    samples = _with_pauses(samples, pauses)
    log, unit = finish(samples, GYRO, unit, rate)
    return GyroFile(log, chosen.name, samples.axes, samples.time_unit, unit, samples.facts)


def read_acceleration(
    path: str | os.PathLike[str], *, unit: str | None = None, columns: str | None = None
) -> AccelerationLog:
    """Read the log of an accelerometer, from the file of a gyro log or its own.

    The formats are those of :func:`read_gyro`, except Gyroflow's projects; the axes are those in which it reads the
    gyro of the same device.

    Parameters
    ----------
    path : path-like
        The file; that of the gyro log if it contains both sensors.
    unit : {"m/s^2", "g", "mg"}, optional
        Unit of the accelerations, instead of that in the header or, without one, m/s^2.
    columns : str, optional
        Columns of a table, as for :func:`read_gyro`: ``"t=1,ax=5,ay=6,az=7"``.

    Returns
    -------
    AccelerationLog
        The log, in m/s^2.

    Raises
    ------
    FileFormatError
        If the file contains no accelerometer; if its median is not gravity in the unit, as after an app has removed
        gravity; or for the reasons of :func:`read_gyro`.
    InputError
        If `unit` or `columns` is not a valid one.

    Warns
    -----
    RsdeblurWarning
        If samples were sorted or dropped.
    """
    chosen, source, pauses = _choose(path, ACCELEROMETER, None, columns)
    samples = _with_pauses(chosen.read(source, ACCELEROMETER), pauses)
    return finish(samples, ACCELEROMETER, unit, None)[0]


def detect_gyro_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format as which `read_gyro` would read the file."""
    return _choose(path, GYRO)[0].name


def _choose(
    path: str | os.PathLike[str], sensor: AnySensor, format: str | None = None, columns: str | None = None
) -> tuple[Format[Samples], Source, list[tuple[float, float]]]:
    """Return the format, the source of the log (the file or a member of it), and the pauses in a file beside it."""
    if columns is not None and format is not None:
        raise InputError("columns and format exclude each other: columns are of a table")
    known = FORMATS[sensor] if columns is None else (gyro_tables.columns_format(sensor, columns),)
    order = partial(_order, sensor=sensor)
    members = members_of(Source(path, sensor.what), order)
    pauses = _pauses(members)
    tried = [each for each in known if format in (None, each.name)]
    # In their order, so that large files of other sensors are not parsed beside the log.
    for _, group in groupby(members, lambda member: order(member.path.name)):
        fitting = [member for member in group if any(each.fits(member) for each in tried)]
        # Many tables fit these formats; the file of an app comes first.
        apps = [each for each in tried if each.name not in ("plain", "unstamped")]
        likely = [member for member in fitting if any(each.fits(member) for each in apps)] or fitting
        if len(likely) > 1:
            first, second = (each.path.relative_to(path).as_posix() for each in likely[:2])
            raise line_error(
                Path(path),
                f"the archive contains more than one {sensor.what}, {first} and {second}; extract the one of your "
                "photo or video, and give that",
            )
        if likely:
            return choose(known, likely[0], format), likely[0], pauses
    if columns is not None:
        return known[0], members[0], pauses
    if sensor is GYRO and format is None and mistaken(members[0]) is None:
        known = (*known, *gyro_binary.other_logs(members[0]))
    return choose(known, members[0], format, quantity=sensor.quantity), members[0], pauses


def _order(name: str, sensor: AnySensor) -> tuple[bool, bool | str, bool]:
    """Sort key of file names: first a gyro without its bias, or an accelerometer with gravity, last other sensors."""
    stem = Path(name).stem.lower()
    if sensor is GYRO:
        return "gyro" not in stem, gyro_tables.names_other_sensor(stem), "uncalibrated" in stem
    return "totalacc" not in stem, stem if "acc" in stem else "~", False


def _pauses(members: list[Source]) -> list[tuple[float, float]]:
    """Return the pauses in phyphox's `meta/time.csv`: each its time in the experiment and its length, both in s."""
    clocks = (each for each in members if each.path.parts[-2:] == ("meta", "time.csv") and each.looks_like_text)
    rows = [cells_of(line) for clock in clocks for line in clock.lines]
    times = [(row[0], float(row[1]), float(row[2])) for row in rows if [*map(is_number, row[1:3])] == [True] * 2]
    return [
        (at, now - then)
        for (before, at, then), (after, _, now) in pairwise(times)
        if (before, after) == ("PAUSE", "START") and now > then
    ]


def _with_pauses(samples: Samples, pauses: list[tuple[float, float]]) -> Samples:
    """Return samples whose clock, which stood still in pauses, runs on, so that each pause is a gap."""
    if samples.ns is None or not pauses:
        return samples
    ns, cautions = samples.ns.copy(), list(samples.cautions)
    for at, length in pauses:
        ns[samples.ns >= round(at * 1e9)] += round(length * 1e9)
        cautions.append(f"the recording was paused at {at:.6g} s for {length:.3f} s; the log has a gap there")
    return replace(samples, ns=ns, cautions=cautions)


def axes_problems(file: GyroFile, camera: Camera, path: Path) -> list[str]:
    """Return what in a camera contradicts the axes of a log and the shutter of its device, where those are known."""
    problems = []
    if file.axes == "phone" and camera.readout_time == 0:
        problems.append(
            f"the readout time is 0, as of a global shutter, but {path} is the log of a phone, whose shutter rolls; "
            "give --readout-time"
        )
    given = None
    if np.array_equal(camera.imu_to_camera, np.eye(3)):
        given = "the identity"
    elif file.axes == "gyroflow" and np.array_equal(camera.imu_to_camera, imu_to_camera("phone-portrait")):
        given = "that of a phone's axes"
    if given is not None and file.axes != "sensor":
        expected = "phone-portrait or phone-landscape" if file.axes == "phone" else "gyroflow"
        problems.append(f"imu_to_camera is {given}, but {path} is in {file.axes} axes; it should be {expected}")
    return problems
