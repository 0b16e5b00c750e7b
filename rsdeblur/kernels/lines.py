"""Moving data between picture rows and columns of the hybrid domain: the C kernels and their NumPy twins.

A *line* is contiguous and runs along the axis that is transformed next. A *tile* reads a line from `start` on. Beyond
the picture, the line continues by reflection or, if `periodic`, by repetition. The last positions of a tile fade into
the values before its start, so that the tile is smooth when repeated, as a transform requires.

Shapes: channels C, picture (H, W, C), spectra of rows (C, R, K), N of their columns (C, N, M), B tiles of length L. All
arrays are C-contiguous, float32, complex64 or int32.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels import native
from rsdeblur.types import ComplexArray, Float32Array, Int32Array


def continued(positions: NDArray[np.int_], n: int, *, periodic: bool = False) -> NDArray[np.int_]:
    """Return the positions from 0 to n - 1 whose values continue a line of n values at any `positions`."""
    folded = positions % (n if periodic else 2 * n)
    within: NDArray[np.int_] = np.minimum(folded, 2 * n - 1 - folded)
    return within


def _cut(line: NDArray[Any], start: int, fade: Float32Array, periodic: bool, length: int) -> NDArray[Any]:
    """Return the tile at `start` of `line`, along its last axis."""
    positions = start + np.arange(length)
    tile, before = (
        line[..., continued(some, line.shape[-1], periodic=periodic)] for some in (positions, positions - length)
    )
    tail = np.s_[..., length - len(fade) :]
    tile[tail] += fade * (before[tail] - tile[tail])
    return tile


def picture_to_lines_numpy(
    picture: Float32Array, top: int, rows: int, start: int, fade: Float32Array, periodic: bool, lines: Float32Array
) -> bool:
    """Copy the tile at `start` of some picture rows into `lines` (C, R, L); return whether all its values are finite.

    The rows are `rows` ones from `top` on; so many lines of each channel are written. `start` may lie beyond the
    picture. `fade` (taper,) has the weights, at the last positions of the tile, of the values before its start.
    """
    block = np.moveaxis(picture[top : top + rows], -1, 0)
    lines[:, :rows] = _cut(block, start, fade, periodic, lines.shape[-1])
    return bool(np.isfinite(lines[:, :rows]).all())


def lines_to_picture_numpy(
    lines: Float32Array,
    rows: int,
    offset: int,
    weights: Float32Array,
    first: int,
    add: bool,
    picture: Float32Array,
    top: int,
) -> None:
    """Write weighted lines into picture rows, or add them if `add`.

    The first `rows` of `lines` (C, R, L) belong to the picture rows from `top` on. In each row, the n positions from
    `first` on receive `weights` (n,) times the positions from `offset` on of its line.
    """
    part = picture[top : top + rows, first : first + len(weights)]
    values = np.moveaxis(weights * lines[:, :rows, offset : offset + len(weights)], 0, -1)
    part[...] = part + values if add else values


def rows_to_columns_numpy(rows: ComplexArray, first: int, height: int, columns: ComplexArray) -> None:
    """Transpose columns of `rows` (C, R, K), from `first` on, into `columns` (C, N, M), `height` values each."""
    count = columns.shape[1]
    columns[..., :height] = np.swapaxes(rows[:, :height, first : first + count], 1, 2)


def columns_to_rows_numpy(columns: ComplexArray, rows: ComplexArray, first: int, height: int) -> None:
    """Transpose `columns` back into `rows`, the inverse of :func:`rows_to_columns_numpy`."""
    count = columns.shape[1]
    rows[:, :height, first : first + count] = np.swapaxes(columns[..., :height], 1, 2)


def cut_lines_numpy(
    columns: ComplexArray, height: int, starts: Int32Array, fade: Float32Array, periodic: bool, slabs: ComplexArray
) -> None:
    """Copy the tiles at `starts` (B,) of `columns` (C, N, M) into `slabs` (B, C, N, L).

    Only the first `height` values of a column are read. A single slab that starts at 0 and fades only values from
    `height` on may be `columns` itself, which is then extended in place.
    """
    for start, slab in zip(starts, slabs, strict=True):
        slab[...] = _cut(columns[..., :height], int(start), fade, periodic, slab.shape[-1])


picture_to_lines: Callable[..., bool] = native.picture_to_lines if native else picture_to_lines_numpy
lines_to_picture: Callable[..., None] = native.lines_to_picture if native else lines_to_picture_numpy
rows_to_columns: Callable[..., None] = native.rows_to_columns if native else rows_to_columns_numpy
columns_to_rows: Callable[..., None] = native.columns_to_rows if native else columns_to_rows_numpy
cut_lines: Callable[..., None] = native.cut_lines if native else cut_lines_numpy
