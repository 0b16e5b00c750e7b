"""What a frame of a burst shows of a sharp picture, computed only where that is needed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.pipeline.memory import LONGEST
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage

# Side of the cells that rectangles consist of, px.
CELL = 64
# Share of the picture, with what blur brings in from around the rectangles, from which on everything is blurred.
MOST_SHARE = 0.6

Part = tuple[slice, slice]


def predicted(
    latent: FloatImage, wanted: NDArray[np.bool_], bank: PsfBank, threads: int | None = None
) -> Iterator[tuple[Part, FloatImage]]:
    """Yield disjoint parts of a sharp picture, blurred, that cover where that is `wanted`.

    Parameters
    ----------
    latent : ndarray, shape (H, W, C), float32
        The sharp picture.
    wanted : ndarray, shape (H, W), bool
        Where the blurred picture is wanted.
    bank : PsfBank
        PSFs of the frame on the pixels of the sharp picture.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.

    Yields
    ------
    part : (slice, slice)
        Rows and columns.
    blurred : ndarray, shape (h, w, C), float32
        What the frame shows there.
    """
    parts = list(rectangles(wanted))
    if sum(_area(_around(part, wanted.shape, bank.size)) for part in parts) > MOST_SHARE * wanted.size:
        parts = list(rectangles(np.ones_like(wanted)))
    for part in parts:
        around = _around(part, wanted.shape, bank.size)
        picture, few = np.ascontiguousarray(latent[around]), bank.cut(*around)
        few = replace(few, rows=few.rows - around[0].start, cols=few.cols - around[1].start)
        blurred = TileBlur(few, picture.shape, threads=threads).forward(picture)
        rows, cols = (slice(p.start - a.start, p.stop - a.start) for p, a in zip(part, around, strict=True))
        yield part, blurred[rows, cols]


def rectangles(wanted: NDArray[np.bool_]) -> Iterator[Part]:
    """Yield disjoint rectangles, made of cells, that cover where a mask (H, W) is true."""
    starts = [range(0, n, CELL) for n in wanted.shape]
    cells = np.logical_or.reduceat(np.logical_or.reduceat(wanted, starts[0], axis=0), starts[1], axis=1)
    for top, left in np.argwhere(cells):
        if not cells[top, left]:
            continue
        right, bottom = left, top
        while right < min(left + LONGEST // CELL, cells.shape[1]) and cells[top, right]:
            right += 1
        while bottom < min(top + LONGEST // CELL, cells.shape[0]) and cells[bottom, left:right].all():
            bottom += 1
        cells[top:bottom, left:right] = False
        limits = zip((top, left), (bottom, right), wanted.shape, strict=True)
        rows, cols = (slice(int(first) * CELL, min(int(stop) * CELL, n)) for first, stop, n in limits)
        yield rows, cols


def _around(part: Part, shape: tuple[int, ...], reach: tuple[int, int]) -> Part:
    """Return a part with all that its blur depends on."""
    rows, cols = (
        slice(max(each.start - far, 0), min(each.stop + far, n))
        for each, far, n in zip(part, reach, shape, strict=True)
    )
    return rows, cols


def _area(part: Part) -> int:
    rows, cols = part
    return int((rows.stop - rows.start) * (cols.stop - cols.start))
