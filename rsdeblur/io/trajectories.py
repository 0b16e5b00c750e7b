"""Trajectories: tables of time, position and quaternion."""

from __future__ import annotations

import os
import re

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.io.columns import (
    LENGTH_SPELLINGS,
    TIME_UNITS,
    Columns,
    Quantity,
    check_layout,
    layout_grid,
    named_columns,
)
from rsdeblur.io.samples import ordered, table_samples
from rsdeblur.io.source import Format, Source, choose, text_format
from rsdeblur.io.text import Table, TextFile, line_error, read_table
from rsdeblur.motion.trajectory import Trajectory

WHAT = "trajectory"
POSITION = Quantity.of("t|p|pos|position|translation|prsr|prs", LENGTH_SPELLINGS).bare
QUATERNION = [re.compile(rf"(q|quat|quaternion|qrs|rotation|rot|orientation){axis}") for axis in "xyzw"]


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Read positions, and perhaps orientations, that another program found.

    Reads tables without a header in the TUM format (``t tx ty tz qx qy qz qw``) or without quaternions (``t x y z``),
    and tables whose header names the columns, as EuRoC's ground truth. Without a unit in the header, times are in s or
    in ns, which the spacing shows.

    Parameters
    ----------
    path : path-like
        The file, as exported from visual-inertial odometry, ARKit, ARCore or motion capture.

    Returns
    -------
    Trajectory
        The poses, in the axes of the file.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is not such a table or contains fewer than two poses; or, naming the line, if a
        cell is not a finite number, a timestamp conflicts with another, or a quaternion's norm is not 1.
    """
    source = Source(path, WHAT)
    return choose(FORMATS, source).read(source)


def _read(text: TextFile) -> Trajectory:
    columns, quaternion = _columns(text)
    rows = text.rows[columns.start :]
    check_layout(text, rows, columns)
    table = read_table(text, rows, (*columns.places, *quaternion))
    unit = columns.time_unit or _unit_of(table)
    samples = table_samples(table, None, unit="m", axes="sensor", time_unit=unit)
    t, values, epoch, _ = ordered(table.nanoseconds(TIME_UNITS[unit]), samples)
    try:
        return Trajectory(t, values[:, :3], values[:, 3:] if quaternion else None, epoch)
    except InputError as reason:
        raise line_error(text.path, str(reason)) from reason


def _columns(text: TextFile) -> tuple[Columns, list[int]]:
    """Return the columns of times and positions, and the places of the quaternion's x, y, z and w, if there are any."""
    named = named_columns(text, POSITION)
    if named is not None:
        places = [next((k for k, name in enumerate(named.names) if each.fullmatch(name)), -1) for each in QUATERNION]
        return named, [] if -1 in places else places
    if layout_grid(text, 8) is not None:
        return Columns((0, 1, 2, 3)), [4, 5, 6, 7]
    if layout_grid(text, 4) is not None:
        return Columns((0, 1, 2, 3)), []
    raise text.error("no poses: expected `t tx ty tz qx qy qz qw`, or a header that names these columns", text.rows[0])


def _sniff(text: TextFile) -> bool:
    # Raises `FileFormatError`, which means no.
    _columns(text)
    return True


def _unit_of(table: Table) -> str:
    # Poses are 1 ms to hours apart. In that range a spacing in s is below this number, one in ns above it.
    steps = np.diff(table.timestamps).astype(np.float64)
    return "ns" if len(steps) and np.median(np.abs(steps)) > 1e5 else "s"


FORMATS: tuple[Format[Trajectory], ...] = (
    text_format("poses", "`t tx ty tz qx qy qz qw`, `t x y z`, or a header that names these columns", _sniff, _read),
)
