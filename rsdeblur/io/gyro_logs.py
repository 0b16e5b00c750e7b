"""Gyro logs in the formats people have.

To add a format, write its `sniff` and `read` and append a `Format` to `FORMATS`; the first whose `sniff` accepts the
content wins.
"""

from __future__ import annotations

import os
import re
from decimal import Decimal

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.gyro import GyroLog
from rsdeblur.io.formats import Format, choose
from rsdeblur.io.text import NUMBER, Table, TextFile, cells_of, find_columns, is_number, read_table

WHAT = "gyro log"

# Nanoseconds in each unit of time a log may use.
UNITS = {"s": Decimal(10**9), "ms": Decimal(10**6), "us": Decimal(10**3), "ns": Decimal(1)}
# A gyro samples at 20 Hz to 8 kHz. The sample spacings (ns) then lie within a factor of 400, less than the 1000
# between the units, so a spacing fits at most one unit.
SPACING = (125_000, 50_000_000)

# Header cells, lower case: a bare name, or with its unit as in `t_ns`, `wx_rad_s` or `Timestamp[nanosec]`, `gx[rad/s]`.
TIME = re.compile(r"(t|ts|time|timestamp|stamp)(_(ns|us|ms|s)|\s*[\[(](ns|us|ms|s|nanosec)[\])])?")
RATE = r"(w|omega|g|gyr|gyro)_?{axis}(_rad_?s|\s*[\[(]rad/s[\])])?"
COLUMNS = (TIME, *(re.compile(RATE.format(axis=axis)) for axis in "xyz"))
MARS_COLUMNS = (re.compile(r"timestamp\s*\[nanosec\]"), *COLUMNS[1:])


def read_gyro(path: str | os.PathLike[str], format: str | None = None) -> GyroLog:
    """Read a gyro log.

    ============ ==========================================================================================
    ``mars``     MARS logger ``gyro_accel.csv``: ``Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s], ...``
    ``deepgyro`` DeepGyro ``imu.txt``: ``type t_ns x y z``; type 4 is the gyro, other sensors are skipped
    ``gcsv``     Gyroflow ``.gcsv``, scaled by its `tscale` (default 0.001 s) and `gscale` (default 1 rad/s)
    ``plain``    ``t wx wy wz`` in rad/s, parted by commas, semicolons, spaces or tabs; exactly four columns, or a
                 header that names them (``t,wx,wy,wz`` or ``time,gx,gy,gz``, in any order, among others). The unit
                 of ``t`` (s, ms, us or ns) follows from the median sample spacing, which is unambiguous for a gyro
                 between 20 Hz and 8 kHz
    ============ ==========================================================================================

    Blank lines and lines that start with ``#`` are skipped. Rates stay in the axes the file has: the `orientation`
    key of a ``.gcsv`` is not applied, give the relation to the camera as `Camera.imu_to_camera`.

    Parameters
    ----------
    path : path-like
        The log. The format is told from the content, never from the name.
    format : str, optional
        Name of the format, from the table above, instead of detection.

    Returns
    -------
    GyroLog
        `epoch_ns` is the first stamp; stamps are exact integers until the first one is taken off.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is empty, binary, cut off or of an unknown format; or, naming the line, if a cell
        is missing, not a number or not finite, a stamp is a duplicate, out of order or beyond int64.
    """
    text = TextFile.open(path, WHAT)
    return choose(FORMATS, text, WHAT, format).read(text)


def detect_gyro_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format `read_gyro` would read the file as.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is of no known format.
    """
    return choose(FORMATS, TextFile.open(path, WHAT), WHAT).name


def _to_log(table: Table, unit: Decimal, scale: float = 1.0) -> GyroLog:
    """Make the log, `unit` being the nanoseconds in the file's unit of time, `scale` the rad/s in its unit of rate."""
    exact = Table(table.text, table.rows, table.nanoseconds(unit), table.values)
    exact.check_order()
    ns = exact.stamps
    # Ordered int64 differ by at most 2**64 - 1: unsigned, the difference cannot overflow.
    t = (ns.view(np.uint64) - ns[:1].view(np.uint64)).astype(np.float64) * 1e-9
    try:
        return GyroLog(t, table.values * scale, int(ns[0]))
    except InputError as error:
        raise table.text.error(str(error)) from error


def _mars_columns(text: TextFile) -> list[int] | None:
    return find_columns(text.head, MARS_COLUMNS)


def _sniff_mars(text: TextFile) -> bool:
    return _mars_columns(text) is not None


def _read_mars(text: TextFile) -> GyroLog:
    columns = _mars_columns(text)
    if columns is None:
        message = "no MARS logger header: Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s] expected"
        raise text.error(message, text.rows[0])
    return _to_log(read_table(text, text.rows[1:], columns), UNITS["ns"])


def _sniff_deepgyro(text: TextFile) -> bool:
    cells = text.head.split()
    return len(cells) == 5 and all(map(is_number, cells)) and cells[0].isdecimal() and cells[1].isdecimal()


def _read_deepgyro(text: TextFile) -> GyroLog:
    rows = []
    for row in text.rows:
        kind = text.lines[row].split(maxsplit=1)[0]
        if kind == "4":
            rows.append(row)
        elif not kind.isdecimal():
            raise text.error(f"{kind[:40]!r} is not a sensor type; lines must read `type t_ns x y z`", row)
    if not rows:
        raise text.error("the file holds no gyro samples: no line is of type 4")
    return _to_log(read_table(text, rows, (1, 2, 3, 4)), UNITS["ns"])


def _sniff_gcsv(text: TextFile) -> bool:
    return text.lines[0].strip() in ("GYROFLOW IMU LOG", "CAMERA IMU LOG")


def _read_gcsv(text: TextFile) -> GyroLog:
    scales = {"tscale": Decimal("0.001"), "gscale": Decimal(1)}
    for i, row in enumerate(text.rows):
        line = text.lines[row]
        if len(cells_of(line)) >= 4 and cells_of(line)[0].lower() in ("t", "time"):
            table = read_table(text, text.rows[i + 1 :], (0, 1, 2, 3))
            return _to_log(table, scales["tscale"] * UNITS["s"], float(scales["gscale"]))
        key, *value = (part.strip() for part in re.split("[,:]", line, maxsplit=1))
        if key in scales and value:
            if not NUMBER.fullmatch(value[0]) or not Decimal(value[0]) > 0:
                raise text.error(f"{key} must be a positive number, got {value[0]!r}", row)
            scales[key] = Decimal(value[0])
    raise text.error("no line `t,gx,gy,gz` that starts the samples of a Gyroflow log")


def _plain_layout(text: TextFile) -> tuple[list[int], list[int]] | None:
    """Return the sample rows and the columns of t, wx, wy and wz; None if the first line tells neither."""
    columns = find_columns(text.head, COLUMNS)
    if columns is not None:
        return text.rows[1:], columns
    cells = cells_of(text.head)
    return (text.rows, [0, 1, 2, 3]) if len(cells) == 4 and all(map(is_number, cells)) else None


def _read_plain(text: TextFile) -> GyroLog:
    layout = _plain_layout(text)
    if layout is None:
        raise text.error("neither four numbers `t wx wy wz` nor a header that names them", text.rows[0])
    table = read_table(text, *layout)
    table.check_order()
    # In no unit may they be larger than in nanoseconds, and differences of what fits are safe to take.
    table.check_range(UNITS["ns"])
    if len(table.rows) < 2:
        raise text.error("a gyro log needs at least 2 samples, got 1", table.rows[0])
    spacing = float(np.median(np.diff(table.stamps).astype(np.float64)))
    for unit in UNITS.values():
        if SPACING[0] <= spacing * float(unit) <= SPACING[1]:
            return _to_log(table, unit)
    raise text.error(
        f"cannot tell the unit of time: the median sample spacing is {spacing:g}, which is no gyro rate between 20 Hz "
        "and 8 kHz in s, ms, us or ns; check the first column"
    )


FORMATS = (
    Format("mars", "MARS logger gyro_accel.csv", _sniff_mars, _read_mars),
    Format("deepgyro", "DeepGyro imu.txt, `type t_ns x y z`", _sniff_deepgyro, _read_deepgyro),
    Format("gcsv", "Gyroflow .gcsv", _sniff_gcsv, _read_gcsv),
    Format("plain", "`t wx wy wz` in rad/s", lambda text: _plain_layout(text) is not None, _read_plain),
)
