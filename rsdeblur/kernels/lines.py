"""Moving data between picture rows and columns of the hybrid domain: Numba kernels and their NumPy twins.

A *line* runs along the axis that is transformed next and is contiguous. A *tile* reads a line from `start` on; beyond
the picture the line is continued, by reflection or, if `periodic`, by repetition, and its last positions fade into what
precedes its start, so that a transform of the tile sees a smooth repetition. Shapes: channels C, picture (H, W, C),
columns (C, K, stride) of which the first H positions count, blocks of R rows and N columns, tile length L.

Arrays are passed whole and C-contiguous, with the block's first index: a view would hide from the compiler that lines
are contiguous. The kernels release the GIL and trust their arguments.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float32]
Complex = NDArray[np.complex64]
Index = NDArray[np.int64]


@numba.njit(cache=True, nogil=True, inline="always")
def _continued(position, n, periodic):
    """Position inside 0 to n - 1 that stands for any position."""
    if periodic:
        return position % n
    folded = position % (2 * n)
    return min(folded, 2 * n - 1 - folded)


@numba.njit(cache=True, nogil=True, inline="always")
def _inside(start, n, length):
    """First and end position of a tile that lie inside the picture."""
    low = min(max(-start, 0), length)
    return low, max(min(n - start, length), low)


@numba.njit(cache=True, nogil=True)
def picture_to_lines(picture, top, rows, start, fade, periodic, lines):
    """Cut the tile at `start` out of `rows` picture rows from `top` on: a line (C, R, L) per channel and row."""
    channels, _, length = lines.shape
    n = picture.shape[1]
    low, high = _inside(start, n, length)
    first = length - len(fade)
    for r in range(rows):
        row = picture[top + r]
        if channels == 3:
            # Spelt out, this becomes vector shuffles.
            red, green, blue = lines[0, r], lines[1, r], lines[2, r]
            for k in range(low, high):
                red[k] = row[start + k, 0]
                green[k] = row[start + k, 1]
                blue[k] = row[start + k, 2]
        else:
            for c in range(channels):
                for k in range(low, high):
                    lines[c, r, k] = row[start + k, c]
        for c in range(channels):
            line = lines[c, r]
            for k in range(low):
                line[k] = row[_continued(start + k, n, periodic), c]
            for k in range(high, length):
                line[k] = row[_continued(start + k, n, periodic), c]
            for i in range(len(fade)):
                before = row[_continued(start + first + i - length, n, periodic), c]
                line[first + i] += fade[i] * (before - line[first + i])


@numba.njit(cache=True, nogil=True)
def cut_slabs(columns, first_column, height, starts, fade, periodic, slabs):
    """Cut a tile at each of `starts` out of N columns from `first_column` on: the first of `slabs` (G, C, N, L)."""
    _, channels, count, length = slabs.shape
    first = length - len(fade)
    for g in range(len(starts)):
        start = starts[g]
        low, high = _inside(start, height, length)
        for c in range(channels):
            for j in range(count):
                line, slab = columns[c, first_column + j], slabs[g, c, j]
                slab[low:high] = line[start + low : start + high]
                for k in range(low):
                    slab[k] = line[_continued(start + k, height, periodic)]
                for k in range(high, length):
                    slab[k] = line[_continued(start + k, height, periodic)]
                for i in range(len(fade)):
                    before = line[_continued(start + first + i - length, height, periodic)]
                    slab[first + i] += fade[i] * (before - slab[first + i])


@numba.njit(cache=True, nogil=True)
def rows_to_columns(spectra, rows, columns, top):
    """Transpose the first `rows` of `spectra` (C, R, K) into positions `top` on of the first K columns."""
    channels, _, frequencies = spectra.shape
    # 8 complex values fill a cache line, so an 8 x 8 block is read and written in whole lines.
    for c in range(channels):
        for j0 in range(0, frequencies, 8):
            for i0 in range(0, rows, 8):
                for i in range(i0, min(i0 + 8, rows)):
                    for j in range(j0, min(j0 + 8, frequencies)):
                        columns[c, j, top + i] = spectra[c, i, j]


@numba.njit(cache=True, nogil=True)
def columns_to_rows(columns, top, spectra, rows):
    """Transpose back: the inverse of :func:`rows_to_columns`."""
    channels, _, frequencies = spectra.shape
    # Every column is elsewhere in memory and no longer in the cache. Walking along 256 of them keeps many reads under
    # way at once (twice as fast as blocks of 8), and their lines stay in the cache for the next rows.
    for c in range(channels):
        for j0 in range(0, frequencies, 256):
            for i in range(rows):
                for j in range(j0, min(j0 + 256, frequencies)):
                    spectra[c, i, j] = columns[c, j, top + i]


@numba.njit(cache=True, nogil=True)
def lines_to_picture(lines, rows, offset, weights, first, add, picture, top):
    """Put the first `rows` of `lines` (C, R, L), weighted, into picture rows from `top` on, or add them if `add`.

    Positions `first` to `first + n - 1` of each row receive positions `offset` on of its line times `weights` (n,).
    """
    channels = lines.shape[0]
    n = len(weights)
    for r in range(rows):
        row = picture[top + r]
        if channels == 3 and not add:
            red, green, blue = lines[0, r], lines[1, r], lines[2, r]
            for i in range(n):
                row[first + i, 0] = weights[i] * red[offset + i]
                row[first + i, 1] = weights[i] * green[offset + i]
                row[first + i, 2] = weights[i] * blue[offset + i]
        else:
            for c in range(channels):
                for i in range(n):
                    value = weights[i] * lines[c, r, offset + i]
                    row[first + i, c] = row[first + i, c] + value if add else value


def _cut_numpy(line: NDArray[Any], start: int, fade: Real, periodic: bool, length: int) -> NDArray[Any]:
    """Tile along the last axis of `line`."""
    n = line.shape[-1]

    def at(positions: Index) -> NDArray[Any]:
        folded = positions % (n if periodic else 2 * n)
        return line[..., np.minimum(folded, 2 * n - 1 - folded)]

    positions = start + np.arange(length)
    tile = at(positions)
    tail = np.s_[..., length - len(fade) :]
    tile[tail] += fade * (at(positions - length)[tail] - tile[tail])
    return tile


def picture_to_lines_numpy(
    picture: Real, top: int, rows: int, start: int, fade: Real, periodic: bool, lines: Real
) -> None:
    """Readable twin of :func:`picture_to_lines`."""
    block = np.moveaxis(picture[top : top + rows], -1, 0)
    lines[:, :rows] = _cut_numpy(block, start, fade, periodic, lines.shape[-1])


def cut_slabs_numpy(
    columns: Complex, first_column: int, height: int, starts: Index, fade: Real, periodic: bool, slabs: Complex
) -> None:
    """Readable twin of :func:`cut_slabs`."""
    block = columns[:, first_column : first_column + slabs.shape[2], :height]
    for slab, start in zip(slabs, starts, strict=False):
        slab[...] = _cut_numpy(block, start, fade, periodic, slabs.shape[-1])


def rows_to_columns_numpy(spectra: Complex, rows: int, columns: Complex, top: int) -> None:
    """Readable twin of :func:`rows_to_columns`."""
    columns[:, : spectra.shape[2], top : top + rows] = np.swapaxes(spectra[:, :rows], 1, 2)


def columns_to_rows_numpy(columns: Complex, top: int, spectra: Complex, rows: int) -> None:
    """Readable twin of :func:`columns_to_rows`."""
    spectra[:, :rows] = np.swapaxes(columns[:, : spectra.shape[2], top : top + rows], 1, 2)


def lines_to_picture_numpy(
    lines: Real, rows: int, offset: int, weights: Real, first: int, add: bool, picture: Real, top: int
) -> None:
    """Readable twin of :func:`lines_to_picture`."""
    part = picture[top : top + rows, first : first + len(weights)]
    values = np.moveaxis(weights * lines[:, :rows, offset : offset + len(weights)], 0, -1)
    part[...] = part + values if add else values
