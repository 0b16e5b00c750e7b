"""The hybrid domain: picture rows transformed along x, every row frequency then a column along y.

The blur of a tile does not change along a row, so rows are transformed once for all bands, and what differs from band
to band happens on columns. Both stages work on blocks that fit a processor's cache: a few picture rows are cut,
transformed and transposed into columns; then for a few columns at a time all bands are cut, transformed, filtered,
transformed back and blended; then rows come back the same way. Nothing as large as the picture is touched more than
once per stage. Blocks are independent, so threads share them, and any number of threads gives the same bits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from rsdeblur.border import Border, fade
from rsdeblur.fft import Complex, LineTransform, Planning, Real, RowTransform, empty
from rsdeblur.kernels import lines, spectral
from rsdeblur.tiling import Tile, Tiling

# Picture rows per block. 16 rows of 2048 RGB pixels and their spectrum are 0.8 MB, within a second-level cache of 1 to
# 2 MB; transposed, 16 complex values are two cache lines.
ROWS = 16
# Columns per block, and bytes of slabs worked on at a time within it.
COLUMNS = 16
SLAB_BYTES = 400_000


class Hybrid:
    """Transforms of pictures of one shape under one tiling; owns the columns and each thread's buffers and plans.

    Parameters
    ----------
    shape : (H, W, C)
        Shape of the pictures.
    bands, strips : Tiling
        Tiles along y and along x.
    border : {"blend", "periodic"}
        How tiles go on beyond the picture.
    planning : {"estimate", "measure"}
        How FFTW plans.
    threads : int
        Number of threads.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        bands: Tiling,
        strips: Tiling,
        *,
        border: Border,
        planning: Planning,
        threads: int,
    ) -> None:
        self.height, _, channels = shape
        self.bands, self.strips = bands, strips
        self._periodic = border == "periodic"
        self.frequencies = strips.length // 2 + 1
        # Whole blocks; the columns that fill up the last one stay zero.
        self.padded_frequencies = -(-self.frequencies // COLUMNS) * COLUMNS
        # An odd number of cache lines per column: with a multiple of 4096 bytes all columns would share cache sets.
        stride = ((self.height + 7) // 8 | 1) * 8
        self._columns: Complex = empty((channels, self.padded_frequencies, stride), np.complex64)
        self._columns[...] = 0
        slab_bytes = channels * COLUMNS * bands.length * self._columns.itemsize
        together = max(1, min(len(bands.tiles), SLAB_BYTES // slab_bytes))
        self._starts = np.array([tile.start for tile in bands.tiles], dtype=np.int64)
        self._groups = [slice(g, g + together) for g in range(0, len(bands.tiles), together)]
        self._workers = [
            _Worker((channels, self.height), bands.length, strips.length, together, planning) for _ in range(threads)
        ]
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="rsdeblur") if threads > 1 else None

    def to_columns(self, picture: Real, strip: Tile) -> bool:
        """Cut `strip` out of `picture` (H, W, C) and transform its rows into the columns.

        Returns whether all that was read is finite: looked at here, it costs no pass over the picture.
        """
        taper = fade(self.strips.taper)
        finite = [True]

        def block(worker: _Worker, top: int) -> None:
            rows, buffers = min(ROWS, self.height - top), worker.rows
            lines.picture_to_lines(picture, top, rows, strip.start, taper, self._periodic, buffers.real)
            if not np.isfinite(buffers.real[:, :rows]).all():
                finite[0] = False
            buffers.forward()
            lines.rows_to_columns(buffers.spectrum, rows, self._columns, top)

        self._share(block, range(0, self.height, ROWS))
        return finite[0]

    def filter(self, filters: Complex) -> None:
        """Filter every band of the columns with `filters` (B, padded frequencies, L) and blend the bands in place."""
        taper = fade(self.bands.taper)

        def block(worker: _Worker, first: int) -> None:
            worker.blended.fill(0)
            for group in self._groups:
                lines.cut_slabs(
                    self._columns, first, self.height, self._starts[group], taper, self._periodic, worker.slabs.data
                )
                worker.slabs.forward()
                tiles = self.bands.tiles[group]
                for slab, transfer in zip(worker.slabs.data, filters[group], strict=False):
                    spectral.multiply(slab, transfer[first : first + COLUMNS])
                worker.slabs.inverse()
                for slab, tile in zip(worker.slabs.data, tiles, strict=False):
                    spectral.blend(
                        worker.blended,
                        slab,
                        tile.weights,
                        to_position=tile.first,
                        from_position=tile.first - tile.start,
                    )
            self._columns[:, first : first + COLUMNS, : self.height] = worker.blended

        self._share(block, range(0, self.padded_frequencies, COLUMNS))

    def to_picture(self, out: Real, strip: Tile, *, add: bool) -> None:
        """Transform the columns back into rows and put them, or add them, to `out` (H, W, C) where `strip` counts."""

        def block(worker: _Worker, top: int) -> None:
            rows, buffers = min(ROWS, self.height - top), worker.rows
            lines.columns_to_rows(self._columns, top, buffers.spectrum, rows)
            buffers.inverse()
            offset = strip.first - strip.start
            lines.lines_to_picture(buffers.real, rows, offset, strip.weights, strip.first, add, out, top)

        self._share(block, range(0, self.height, ROWS))

    def _share(self, block: Callable[[_Worker, int], None], tasks: Iterable[int]) -> None:
        """Run `block` on every task, each thread taking the next one that is left."""
        if self._pool is None:
            for task in tasks:
                block(self._workers[0], task)
            return
        left, lock = iter(tasks), threading.Lock()

        def work(worker: _Worker) -> None:
            while True:
                with lock:
                    task = next(left, None)
                if task is None:
                    return
                block(worker, task)

        for done in [self._pool.submit(work, worker) for worker in self._workers]:
            done.result()


class _Worker:
    """What one thread works on: a block of rows and a group of slabs, with their transforms."""

    def __init__(
        self, planes: tuple[int, int], slab_length: int, row_length: int, slabs: int, planning: Planning
    ) -> None:
        channels, height = planes
        self.rows = RowTransform((channels, ROWS, row_length), planning)
        self.slabs = LineTransform((slabs, channels, COLUMNS, slab_length), planning)
        self.blended: NDArray[np.complex64] = empty((channels, COLUMNS, height), np.complex64)
