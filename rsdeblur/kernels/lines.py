"""Moving data between picture rows and columns of the hybrid domain: the C kernels and their NumPy twins.

A *line* runs along the axis that is transformed next and is contiguous. A *tile* reads a line from `start` on; beyond
the picture the line is continued, by reflection or, if `periodic`, by repetition, and its last positions fade into what
precedes its start, so that a transform of the tile sees a smooth repetition. Shapes: channels C, picture (H, W, C),
spectra of rows (C, R, K), N of their columns (C, N, M), tile length L; all arrays are C-contiguous, float32 or
complex64.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels import native

Real = NDArray[np.float32]
Complex = NDArray[np.complex64]


def _cut(line: NDArray[Any], start: int, fade: Real, periodic: bool, length: int) -> NDArray[Any]:
    """Tile along the last axis of `line`."""
    n = line.shape[-1]

    def at(positions: NDArray[np.int_]) -> NDArray[Any]:
        folded = positions % (n if periodic else 2 * n)
        return line[..., np.minimum(folded, 2 * n - 1 - folded)]

    positions = start + np.arange(length)
    tile = at(positions)
    tail = np.s_[..., length - len(fade) :]
    tile[tail] += fade * (at(positions - length)[tail] - tile[tail])
    return tile


def picture_to_lines_numpy(
    picture: Real, top: int, rows: int, start: int, fade: Real, periodic: bool, lines: Real
) -> bool:
    """Cut the tile at `start` out of `rows` picture rows from `top` on: a line per channel and row.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32
    top, rows, start : int
        `start` may lie beyond the picture.
    fade : ndarray, shape (taper,), float32
        Share of what precedes the tile at its last positions.
    periodic : bool
        How rows go on beyond the picture.
    lines : ndarray, shape (C, R, L), float32
        Receives the lines, in its first `rows`.

    Returns
    -------
    bool
        Whether all that was read is finite.
    """
    block = np.moveaxis(picture[top : top + rows], -1, 0)
    lines[:, :rows] = _cut(block, start, fade, periodic, lines.shape[-1])
    return bool(np.isfinite(lines[:, :rows]).all())


def lines_to_picture_numpy(
    lines: Real, rows: int, offset: int, weights: Real, first: int, add: bool, picture: Real, top: int
) -> None:
    """Put the first `rows` of `lines` (C, R, L), weighted, into picture rows from `top` on, or add them if `add`.

    Positions `first` to `first + n - 1` of each row receive positions `offset` on of its line times `weights` (n,).
    """
    part = picture[top : top + rows, first : first + len(weights)]
    values = np.moveaxis(weights * lines[:, :rows, offset : offset + len(weights)], 0, -1)
    part[...] = part + values if add else values


def rows_to_columns_numpy(rows: Complex, first: int, height: int, columns: Complex) -> None:
    """Transpose the columns of `rows` (C, R, K) from `first` on into `columns` (C, N, M), `height` values each."""
    count = columns.shape[1]
    columns[..., :height] = np.swapaxes(rows[:, :height, first : first + count], 1, 2)


def columns_to_rows_numpy(columns: Complex, rows: Complex, first: int, height: int) -> None:
    """Transpose back: the inverse of :func:`rows_to_columns_numpy`."""
    count = columns.shape[1]
    rows[:, :height, first : first + count] = np.swapaxes(columns[..., :height], 1, 2)


def cut_lines_numpy(columns: Complex, height: int, start: int, fade: Real, periodic: bool, slab: Complex) -> None:
    """Cut the tile at `start` out of `columns` (C, N, M), of which `height` values count, into `slab` (C, N, L).

    `slab` may be `columns` itself where `start` is 0: the columns are then extended in place.
    """
    slab[...] = _cut(columns[..., :height], start, fade, periodic, slab.shape[-1])


picture_to_lines: Callable[..., bool] = native.picture_to_lines if native else picture_to_lines_numpy
lines_to_picture: Callable[..., None] = native.lines_to_picture if native else lines_to_picture_numpy
rows_to_columns: Callable[..., None] = native.rows_to_columns if native else rows_to_columns_numpy
columns_to_rows: Callable[..., None] = native.columns_to_rows if native else columns_to_rows_numpy
cut_lines: Callable[..., None] = native.cut_lines if native else cut_lines_numpy
