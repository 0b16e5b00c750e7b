"""Timestamps and exposure times of pictures, from the files that loggers write beside them."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.io.columns import TIME_UNITS, Cell, named_columns
from rsdeblur.io.exif import Exif
from rsdeblur.io.gyro_binary import trailer_of
from rsdeblur.io.pictures import read_header
from rsdeblur.io.source import Format, Source, choose, text_format
from rsdeblur.io.text import Rows, Table, TextFile, cells_of, find_columns, is_number, read_table
from rsdeblur.motion.exposure import Exposure

WHAT = "capture file"
TIMESTAMP, EXPOSURE = re.compile("(frame)?timestamp"), re.compile("exposure(time|duration)?")
# A picture's name beside its timestamp.
PICTURE = re.compile(r".+\.[a-z]\w{2,3}", re.IGNORECASE)
# s between frames, from 2000 to 2 per second.
FRAME_SPACING = (0.0005, 0.5)


@dataclass(frozen=True, slots=True)
class CaptureFile:
    """The captures listed in a file."""

    format: str
    """Name of the file's format."""
    timestamps: list[int]
    """Exact timestamps in ns."""
    durations: Sequence[float | None]
    """Exposure times in s; None where the file does not contain one."""


def read_captures(path: str | os.PathLike[str], *, duration: float | None = None) -> list[Exposure]:
    """Read the exposures of a recording, in the order of the file.

    Reads MARS logger ``movie_metadata.csv``, DeepGyro ``images.txt``, GyroDeblurNet ``image_info.txt``, timestamps
    alone or beside the names of pictures (EuRoC ``cam0/data.csv``), and JPEG files with a GYRODATA trailer. The content
    decides the format. Timestamps with fractions are in s, and so are the exposure times beside them, if the frames are
    then 0.5 to 500 ms apart; others are refused.

    Parameters
    ----------
    path : path-like
        The file.
    duration : float, optional
        Exposure time in s of captures for which the file does not contain one.

    Returns
    -------
    list of Exposure
        Each with `start` 0 and the capture's exact timestamp as `epoch_ns`. The camera's `timestamp_marks` decides
        which moment the timestamp marks: by default the start of exposure of the first row, as Android documents.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is empty, binary, cut off or of an unknown format; if it lacks an exposure time and
        `duration` is not given; or, naming the line, if a timestamp or an exposure time is missing or not a number, a
        timestamp is beyond int64 or not later than the one before, its unit is unknown, or an exposure time is not
        positive.
    InputError
        If `duration` is needed and not positive.
    """
    file = open_captures(path)
    if duration is None and None in file.durations:
        raise Source(path, WHAT).error(
            "the file contains timestamps without exposure times; give the exposure time: duration (--duration)"
        )
    times = [duration if known is None else known for known in file.durations]
    return [Exposure(0.0, t, stamp) for stamp, t in zip(file.timestamps, times, strict=True) if t is not None]


def open_captures(path: str | os.PathLike[str]) -> CaptureFile:
    """Read the captures listed in a file, with or without exposure times; errors as for `read_captures`."""
    source = Source(path, WHAT)
    return choose(FORMATS, source).read(source)


def _captures(
    format: str,
    text: TextFile,
    rows: Rows,
    columns: Sequence[int],
    unit: str | None = None,
    exposure_unit: str | None = None,
) -> CaptureFile:
    """Read timestamps and, if there is a second column, exposure times, in `unit` or what the timestamps look like.

    `exposure_unit` is that of exposure times in another unit.
    """
    table = read_table(text, rows, columns[:1])
    unit = unit or _unit_of_timestamps(table)
    timestamps = table.nanoseconds(TIME_UNITS[unit]).tolist()
    for row, before, timestamp in zip(rows[1:], timestamps, timestamps[1:], strict=False):
        if timestamp <= before:
            problem = f"comes after {before} ns" if timestamp < before else "occurs twice"
            raise text.error(f"captures must be in the order of time: timestamp {timestamp} ns {problem}", row)
    if len(columns) == 1:
        return CaptureFile(format, timestamps, [None] * len(timestamps))
    # Phones that do not report exposure times write `null`.
    timed = [row for row in rows if cells_of(text.lines[row])[columns[1] :][:1] != ["null"]]
    values = read_table(text, timed, columns).values[:, 0] if timed else ()
    unit = exposure_unit or unit
    per_second = 1e9 / float(TIME_UNITS[unit])
    durations = {row: float(value) / per_second for row, value in zip(timed, values, strict=True)}
    for row, duration in durations.items():
        # The fastest electronic shutters of cameras take ten times as long.
        if 0 < duration < 1e-6:
            raise text.error(
                f"an exposure time of {1e9 * duration:g} ns is shorter than that of any camera; write it in {unit}", row
            )
        try:
            Exposure(0.0, duration)
        except InputError as error:
            raise text.error(f"impossible exposure time of {1e9 * duration:g} ns: {error}", row) from error
    return CaptureFile(format, timestamps, [durations.get(row) for row in rows])


def _unit_of_timestamps(table: Table) -> str:
    """Return ns for whole numbers, and s for others if they are then the timestamps of 2 to 2000 frames per second.

    In that range the same numbers fit no other unit.
    """
    if (table.timestamps == np.rint(table.timestamps)).all():
        return "ns"
    spacing = np.median(np.diff(table.timestamps)) if len(table.timestamps) > 1 else 0.0
    if FRAME_SPACING[0] <= spacing < FRAME_SPACING[1]:
        return "s"
    raise table.text.error(
        "the timestamps have fractions, so they are not in ns, and their spacing does not show that they are in s; "
        "write them in ns, or name the unit in a header, like timestamp[s]",
        table.rows[0],
    )


def _mars_columns(text: TextFile) -> list[int] | None:
    # Android writes `Exposure time[nanosec]`, iOS `exposure duration[nanosec]`.
    return find_columns(text.head, (r"timestamp\s*\[nanosec\]", r"exposure (time|duration)\s*\[nanosec\]"))


def _read_mars(text: TextFile) -> CaptureFile:
    return _captures("mars", text, text.rows[1:], _mars_columns(text) or [], "ns")


def _has_numbers(text: TextFile, count: int) -> bool:
    cells = cells_of(text.head)
    return len(cells) == count and all(map(is_number, cells))


def _sniff_image_info(text: TextFile) -> bool:
    # `t_ns ISO exposure_ns fx fy cx cy s`. A pose has eight numbers too, but a quaternion has none beyond 1, and no
    # camera has a focal length below 1 px.
    return _has_numbers(text, 8) and float(cells_of(text.head)[4]) > 1


def _names_pictures(text: TextFile) -> bool:
    cells = cells_of(text.head)
    return len(cells) == 2 and is_number(cells[0]) and PICTURE.fullmatch(cells[1]) is not None


def _timestamp_header(text: TextFile) -> list[Cell] | None:
    """Return the cells of a header `timestamp` or `timestamp[unit], ...`; None for that of a gyro log."""
    return None if named_columns(text) is not None else _timestamp_cells(text.head)


def _timestamp_cells(line: str) -> list[Cell] | None:
    cells = [Cell.of(cell.strip('" ')) for cell in re.split(r"[,;|\t]", line)]
    known = cells[0].unit in TIME_UNITS or (len(cells) == 1 and not cells[0].unknown)
    return cells if known and TIMESTAMP.fullmatch(cells[0].name) else None


def _read_timestamps(text: TextFile) -> CaptureFile:
    cells = _timestamp_header(text) or []
    exposures = [k for k, cell in enumerate(cells) if EXPOSURE.fullmatch(cell.name) and cell.unit in TIME_UNITS][:1]
    units = [cells[k].unit for k in (0, *exposures)] if cells else []
    return _timestamps("timestamps", text, text.rows[1:] if cells else text.rows, [0, *exposures], units)


def _read_pictures(text: TextFile) -> CaptureFile:
    above = [line.lstrip().removeprefix("#") for line in text.lines[: text.rows[0]] if line.strip()]
    cells = _timestamp_cells(above[-1]) if above else None
    return _timestamps("euroc", text, text.rows, [0], [cells[0].unit] if cells else [])


def _timestamps(
    format: str, text: TextFile, rows: Rows, columns: Sequence[int], units: Sequence[str | None]
) -> CaptureFile:
    """Read timestamps and perhaps exposure times; refuse timestamps without a unit that are too close for ns."""
    file = _captures(format, text, rows, columns, *units)
    spacing = float(np.median(np.diff(file.timestamps))) if len(file.timestamps) > 1 else np.inf
    if not any(units) and spacing < 1e9 * FRAME_SPACING[0]:
        raise text.error(
            f"whole numbers are taken as ns, but then the captures are {spacing:g} ns apart; name the unit in a "
            "header, like timestamp[ms]",
            rows[0],
        )
    return file


def _read_trailer(source: Source) -> CaptureFile:
    trailer = trailer_of(source)
    if trailer is None:
        raise source.error("not a JPEG with a GYRODATA trailer")
    exposure = Exif(read_header(source.path)[2]).exposure
    return CaptureFile("gyrodata", [trailer.capture_ns], [None] if exposure is None else [exposure])


def _plain(name: str, title: str, sniff: Callable[[TextFile], bool], columns: tuple[int, int]) -> Format[CaptureFile]:
    """Return a format of numbers without a header, of which the timestamp and the exposure time are read."""
    return text_format(name, title, sniff, lambda text: _captures(name, text, text.rows, columns))


FORMATS: tuple[Format[CaptureFile], ...] = (
    Format("gyrodata", "JPEG with a GYRODATA trailer", lambda source: trailer_of(source) is not None, _read_trailer),
    text_format("mars", "MARS logger movie_metadata.csv", lambda text: _mars_columns(text) is not None, _read_mars),
    _plain("deepgyro", "DeepGyro images.txt, `t_ns exposure_ns`", lambda text: _has_numbers(text, 2), (0, 1)),
    _plain("image-info", "GyroDeblurNet image_info.txt", _sniff_image_info, (0, 2)),
    text_format("euroc", "EuRoC cam0/data.csv, `t_ns,filename`", _names_pictures, _read_pictures),
    text_format(
        "timestamps",
        "one timestamp in ns a line",
        lambda text: _has_numbers(text, 1) or _timestamp_header(text) is not None,
        _read_timestamps,
    ),
)
