"""Trajectories: tables of time, position and quaternion."""

import os
import re
from dataclasses import replace
from typing import cast

from rsdeblur.errors import InputError
from rsdeblur.io.columns import (
    TIME_UNITS,
    Columns,
    Quantity,
    check_layout,
    chosen_columns,
    layout_grid,
    named_columns,
    unit_of_time,
)
from rsdeblur.io.formats import Format, choose
from rsdeblur.io.samples import Samples, ordered
from rsdeblur.io.source import Source, read_table
from rsdeblur.motion.translation import Trajectory
from rsdeblur.motion.units import LENGTH_SPELLINGS, dated_unit

WHAT = "trajectory"
POSITION = Quantity.of("", "t|p|pos|position|translation|prsr|prs", LENGTH_SPELLINGS, "pos|trans|loc|^[tp]?x").bare
POSE = replace(
    POSITION,
    names=(*POSITION.names, "qx", "qy", "qz", "qw"),
    patterns=(
        *POSITION.patterns,
        *(re.compile(rf"(q|quat|quaternion|qrs|rotation|rot|orientation){axis}") for axis in "xyzw"),
    ),
    optional=4,
)
# Hz, of visual-inertial odometry and motion capture.
POSE_RATES = (1.0, 1000.0)


def read_trajectory(path: str | os.PathLike[str], *, columns: str | None = None) -> Trajectory:
    """Read positions, and perhaps orientations, that another program found.

    Reads tables without a header in the TUM format (``t tx ty tz qx qy qz qw``) or without quaternions (``t x y z``),
    and tables whose header names the columns, as EuRoC's ground truth. Without a unit in the header, a date since 2000
    shows that of time, or the spacing, of 1 ms to 1 s.

    Parameters
    ----------
    path : path-like
        The file, as exported from visual-inertial odometry, ARKit, ARCore or motion capture.
    columns : str, optional
        Columns of a table by names or by numbers from 1, perhaps with units: ``"t=1:ms,x=2,y=3,z=4"``, and ``qx``,
        ``qy``, ``qz``, ``qw``. Lines above the table are skipped.

    Returns
    -------
    Trajectory
        The poses, in the axes of the file.

    Raises
    ------
    FileFormatError
        If the file is not such a table or contains fewer than two poses; or, with its line, if a value is impossible.
    InputError
        If `columns` is not valid.
    """
    source = Source(path, WHAT)
    if columns is not None:
        return _read(source, chosen_columns(source, columns, WHAT, POSE))
    return choose(FORMATS, source, quantity=POSE).read(source)


def _read(source: Source, columns: Columns) -> Trajectory:
    rows = source.rows[columns.start :]
    check_layout(source, rows, columns)
    table = read_table(source, rows, columns.places)
    # Keyframes are many seconds apart.
    dated = dated_unit(table.timestamps)
    unit = columns.units[0] or (dated if dated == "s" else unit_of_time(table, columns, POSE, POSE_RATES))
    ns = table.nanoseconds(TIME_UNITS[unit])
    t, values, epoch, _ = ordered(ns, Samples(source.path, ns, table.values, table.rows))
    try:
        return Trajectory(t, values[:, :3], values[:, 3:] if len(columns.places) == 8 else None, epoch)
    except InputError as reason:
        raise source.error(str(reason)) from reason


def _columns(source: Source) -> Columns | None:
    """Return the columns of times and positions, and of quaternions if there are any."""
    count = next((count for count in (8, 4) if layout_grid(source, count) is not None), 0)
    return named_columns(source, POSE) or (Columns(tuple(range(count))) if count else None)


TITLE = "`t tx ty tz qx qy qz qw`, `t x y z`, or a header of these"
FORMATS = (Format("poses", TITLE, _columns, lambda source: _read(source, cast("Columns", _columns(source)))),)
