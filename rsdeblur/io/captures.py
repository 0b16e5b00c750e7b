"""Timestamps, exposure times and clocks of pictures, from the files that loggers write beside them."""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np

from rsdeblur._util.validate import MOST_SECONDS
from rsdeblur.io.columns import TIME_UNITS, Cell, Columns, Quantity, chosen_columns, named_columns
from rsdeblur.io.formats import Format, choose
from rsdeblur.io.gyro_binary import trailer_of
from rsdeblur.io.metadata import Exif
from rsdeblur.io.pictures import read_header
from rsdeblur.io.source import Rows, Source, Table, cells_of, is_number, read_table
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.units import TIME_SPELLINGS, dated_unit

WHAT = "capture file"
EXPOSURE = Quantity(
    ("exposure",),
    (re.compile("exposure(time|duration)?"),),
    TIME_SPELLINGS,
    "exp|shutter",
    optional=1,
    times=(re.compile("(frame)?timestamp"),),
)
# A picture's name beside its timestamp.
PICTURE = re.compile(r".+\.[a-z]\w{2,3}", re.IGNORECASE)
# s between frames, from 2000 to 2 per second.
FRAME_SPACING = (0.0005, 0.5)


@dataclass(frozen=True, slots=True)
class CaptureFile:
    """The captures listed in a file."""

    format: str  # name of the file's format
    timestamps: list[int]  # exact timestamps in ns
    durations: Sequence[float | None]  # exposure times in s; None where the file does not contain one


def read_captures(
    path: str | os.PathLike[str], *, duration: float | None = None, columns: str | None = None
) -> list[Exposure]:
    """Read the exposures of a recording, in the order of the file.

    Reads MARS logger ``movie_metadata.csv``, DeepGyro ``images.txt``, GyroDeblurNet ``image_info.txt``, timestamps
    alone or beside the names of pictures (EuRoC ``cam0/data.csv``), and JPEG files with a GYRODATA trailer. The content
    decides the format. Timestamps without a unit show it by a date since 2000; else whole numbers are in ns, and others
    in s if the frames are then 0.5 to 500 ms apart. Exposure times without a unit have that of the timestamps.

    Parameters
    ----------
    path : path-like
        The file.
    duration : float, optional
        Exposure time in s of captures for which the file does not contain one.
    columns : str, optional
        Columns of a table by names or by numbers from 1, perhaps with units: ``"t=frame_time:s,exposure=3:ms"``. Lines
        above the table are skipped.

    Returns
    -------
    list of Exposure
        Each with `start` 0 and the capture's exact timestamp as `epoch_ns`. The camera's `timestamp_marks` decides
        which moment the timestamp marks: by default the start of exposure of the first row, as Android documents.

    Raises
    ------
    FileFormatError
        If the file is damaged or of an unknown format; if it lacks an exposure time and `duration` is not given; or,
        with its line, if a timestamp or an exposure time is impossible, not in the order of time or of unknown unit.
    InputError
        If `duration` is needed and not positive, or `columns` is not valid.
    """
    file = open_captures(path, columns)
    if duration is None and None in file.durations:
        raise Source(path, WHAT).error(
            "the file contains timestamps without exposure times; give the exposure time: duration (--duration)"
        )
    times = [duration if known is None else known for known in file.durations]
    return [Exposure(0.0, t, stamp) for stamp, t in zip(file.timestamps, times, strict=True) if t is not None]


def open_captures(path: str | os.PathLike[str], columns: str | None = None) -> CaptureFile:
    """Read the captures listed in a file, with or without exposure times; errors as for `read_captures`."""
    source = Source(path, WHAT)
    if columns is not None:
        return _read("columns", source, chosen_columns(source, columns, WHAT, EXPOSURE))
    return choose(FORMATS, source, quantity=EXPOSURE).read(source)


def _read(format: str, source: Source, columns: Columns) -> CaptureFile:
    """Read timestamps and, if there is a second column, exposure times, in their unit or that of the timestamps."""
    rows = source.rows[columns.start :]
    table = read_table(source, rows, columns.places[:1])
    stamps = table.timestamps.tolist()
    for row, before, stamp in zip(rows[1:], stamps, stamps[1:], strict=False):
        if stamp <= before:
            problem = f"comes after {before}" if stamp < before else "occurs twice"
            raise source.error(f"captures must be in the order of time: timestamp {stamp} {problem}", row)
    unit = columns.units[0] or _unit_of_timestamps(table, columns)
    durations = _durations(source, rows, columns, unit) if len(columns.places) > 1 else {}
    return CaptureFile(format, table.nanoseconds(TIME_UNITS[unit]).tolist(), [durations.get(row) for row in rows])


def _durations(source: Source, rows: Rows, columns: Columns, unit: str) -> dict[int, float]:
    """Return exposure times in s by row; phones that do not report them write `null`."""
    place, unit = columns.places[1], columns.units[1] or unit
    timed = [row for row in rows if cells_of(source.lines[row])[place:][:1] != ["null"]]
    if not timed:
        return {}
    values = read_table(source, timed, columns.places).values[:, 0] / (1e9 / TIME_UNITS[unit])
    # The fastest electronic shutters of cameras take ten times as long.
    (bad,) = np.nonzero(~((values >= 1e-6) & (values < MOST_SECONDS)))
    if bad.size:
        raise source.error(f"impossible exposure time of {1e9 * values[bad[0]]:g} ns; is it in {unit}?", timed[bad[0]])
    return dict(zip(timed, values.tolist(), strict=True))


def _unit_of_timestamps(table: Table, columns: Columns) -> str:
    """Return the unit of dates since 2000; else ns of whole numbers and s of others, if frames may be that close."""
    if (unit := dated_unit(table.timestamps)) is not None:
        return unit
    is_whole = (table.timestamps == np.rint(table.timestamps)).all()
    spacing = float(np.median(np.diff(table.timestamps))) if len(table.timestamps) > 1 else np.inf
    if is_whole and spacing >= 1e9 * FRAME_SPACING[0]:
        return "ns"
    if not is_whole and FRAME_SPACING[0] <= spacing < FRAME_SPACING[1]:
        return "s"
    raise table.source.error(
        f"captures {spacing:g} apart are neither whole ns nor fractions of s; give the unit of time: "
        f"{columns.option(EXPOSURE, 'ms')}",
        table.rows[0],
    )


def _named(source: Source) -> Columns | None:
    """Return the columns that the header names; None for that of a gyro log, or of a table that has a timestamp too."""
    columns = named_columns(source, EXPOSURE) if named_columns(source) is None else None
    if columns is None:
        return None
    if len(cells_of(source.lines[source.rows[-1]])) == 1:
        return replace(columns, places=(0,), units=columns.units[:1])
    if len(columns.places) > 1 and columns.units[1] is None:
        columns = replace(columns, places=columns.places[:1], units=columns.units[:1])
    is_own = columns.places[0] == 0 or len(columns.places) > 1
    return columns if columns.units[0] and is_own else None


def _numbered(source: Source, count: int) -> Columns | None:
    """Return the columns of lines of one, two or eight numbers, see `FORMATS`."""
    cells = cells_of(source.first_line)
    numbers = [float(cell) for cell in cells] if all(map(is_number, cells)) else []
    pair = [abs(number) for number in numbers] if len(numbers) == 2 and 0 not in numbers else [1.0, 5.0]
    # The same time in two units, as DSO writes it, is no exposure time; that in the finer unit is exact.
    if any(abs(max(pair) / min(pair) / scale - 1) < 1e-6 for scale in (1e3, 1e6, 1e9)):
        return Columns((pair.index(max(pair)),)) if count == 1 else None
    # A pose has eight numbers too, but a quaternion has none beyond 1, and no camera has a focal length below 1 px.
    is_own = len(numbers) == count and (count < 8 or numbers[4] > 1)
    return Columns({1: (0,), 2: (0, 1), 8: (0, 2)}[count]) if is_own else None


def _beside_pictures(source: Source) -> Columns | None:
    cells = cells_of(source.first_line)
    if len(cells) != 2 or not is_number(cells[0]) or not PICTURE.fullmatch(cells[1]):
        return None
    above = [line.lstrip().removeprefix("#") for line in source.lines[: source.rows[0]] if line.strip()]
    return Columns((0,), (Cell.of(re.split(r"[,;|\t]", above[-1])[0]).unit if above else None,))


def _read_trailer(source: Source) -> CaptureFile:
    exposure = Exif(read_header(source.path)[2]).exposure
    return CaptureFile("gyrodata", [int(trailer_of(source)["capture_ns"])], [exposure])


def _table(name: str, title: str, columns_of: Callable[[Source], Columns | None]) -> Format[CaptureFile]:
    return Format(name, title, columns_of, lambda source: _read(name, source, cast("Columns", columns_of(source))))


FORMATS: tuple[Format[CaptureFile], ...] = (
    Format("gyrodata", "JPEG with a GYRODATA trailer", lambda source: trailer_of(source) is not None, _read_trailer),
    _table("named", "MARS logger movie_metadata.csv, or another header `timestamp[unit], exposure[unit]`", _named),
    _table("deepgyro", "DeepGyro images.txt, `t_ns exposure_ns`", partial(_numbered, count=2)),
    _table(
        "image-info", "GyroDeblurNet image_info.txt, `t_ns ISO exposure_ns fx fy cx cy s`", partial(_numbered, count=8)
    ),
    _table("euroc", "EuRoC cam0/data.csv, `t_ns,filename`", _beside_pictures),
    _table("timestamps", "one timestamp a line", partial(_numbered, count=1)),
)


CLOCK_SOURCE = re.compile(r"SENSOR_INFO_TIMESTAMP_SOURCE is (?:SENSOR_INFO_TIMESTAMP_SOURCE_)?(REALTIME|UNKNOWN)")


def clock_facts(source: Source) -> dict[str, Any] | None:
    """Return the clocks of a MARS logger session from its `edge_epochs.txt`; None for other files."""
    match = CLOCK_SOURCE.search(source.head.decode("latin-1"))
    if match is None:
        return None
    with source.parsing("both clocks and their difference in ns"):
        clocks = [list(map(int, cells_of(source.lines[row]))) for row in source.rows]
        differences = [boot - nano for boot, nano, _ in clocks]
    # CLOCK_MONOTONIC and CLOCK_BOOTTIME differ by the time that a phone slept; the rest is a drift below 1 ms.
    if max(differences) - min(differences) > 1_000_000:
        raise source.error("the clocks drift apart during the session: the phone slept, so no single offset fits")
    # Camera time minus gyro time: 0 for one clock, else as if the camera's clock were `nanoTime()`.
    offset = 0.0 if match[1] == "REALTIME" else 0.0 - sum(differences) / len(differences) / 1e9
    return {"kind": "clocks of a session", "camera_clock": match[1], "time_offset_s": offset}
