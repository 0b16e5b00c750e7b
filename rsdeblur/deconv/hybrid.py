"""The hybrid domain: picture rows are transformed along x, and each row frequency is then a column along y.

The blur of a tile does not change along a row. So rows are transformed once for all bands, and bands differ only in
what happens to columns. There are three stages; each works on blocks that fit a processor's cache, and touches all data
once:

A. A few rows at a time are cut out of the picture and transformed into the spectra of a strip.
B. A few columns of the spectra at a time are transposed into the cache. There all bands are cut, transformed, filtered,
   transformed back and blended, and the columns go to their place.
C. A few rows of the spectra at a time are transformed back into the picture. The same pass does stage A for the next
   strip.

Blocks are independent, so threads share them, and any number of threads gives the same bits.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rsdeblur._util.memory import empty
from rsdeblur._util.threads import ThreadTeam
from rsdeblur.choices import Border
from rsdeblur.deconv.fft import LineTransform, RowTransform
from rsdeblur.deconv.tiling import Tiling, fade
from rsdeblur.kernels import lines, spectral
from rsdeblur.types import ComplexArray, Float32Array

# Columns per block: two cache lines of complex values. A slab holds one band of a block of columns; so many bytes of
# slabs are transformed together.
COLUMNS = 16
SLAB_BYTES = 400_000


# Called as ``filter(thread, block, bands, slabs)`` with the numbers of the calling thread and of the block of columns.
# Changes the slabs (B, C, COLUMNS, L) in place: spectra of these columns in the B bands, zero without a picture.
Filter = Callable[[int, int, slice, ComplexArray], None]


class Hybrid:
    """Transforms of pictures (H, W, C) of one shape under one tiling, with each thread's buffers and plans.

    `blocks` is the number of blocks of columns, and `spectra` the memory for the spectra of all rows of one strip.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        bands: Tiling,
        strips: Tiling,
        *,
        border: Border,
        threads: int,
    ) -> None:
        self.height, _, self.channels = shape
        self.bands, self.strips = bands, strips
        # A value takes 4 bytes, and so does its share of the spectrum. Together, rows of a block fill 800 kB, within a
        # second-level cache of 1 to 2 MB. With more than 64, small pictures have too few blocks for many threads.
        rows = 800_000 // (8 * self.channels * strips.length) // 16 * 16
        self._block = max(16, min(rows, 64))
        self._periodic = border == "periodic"
        self._strip_fade, self._band_fade = fade(strips.taper), fade(bands.taper)
        self.frequencies = strips.length // 2 + 1
        # Columns that fill up the last block are zero.
        self.blocks = -(-self.frequencies // COLUMNS)
        slab_bytes = self.channels * COLUMNS * bands.length * np.dtype(np.complex64).itemsize
        self.together = max(1, min(len(bands.tiles), SLAB_BYTES // slab_bytes))
        firsts = range(0, len(bands.tiles), self.together)
        # Bands that are filtered together.
        self._groups = [slice(first, first + self.together) for first in firsts]
        # Of each band: the first position that it reads; where it contributes, the first position in the picture and in
        # the band, and their number; and its weights there, with zeros that fill up the row.
        self._starts = np.array([tile.start for tile in bands.tiles], np.int32)
        spans = [(tile.first, tile.first - tile.start, len(tile.weights)) for tile in bands.tiles]
        self._spans = np.array(spans, np.int32)
        self._weights = np.zeros((len(spans), self._spans[:, 2].max()), np.float32)
        for row, tile in zip(self._weights, bands.tiles, strict=True):
            row[: len(tile.weights)] = tile.weights
        padded_height = -(-self.height // self._block) * self._block
        # The 8 columns more make the number of cache lines in a row odd: with rows a multiple of 4096 bytes apart, all
        # would share cache sets.
        self.spectra: ComplexArray = empty((self.channels, padded_height, self.blocks * COLUMNS + 8), np.complex64)
        # Rows that fill up the last block are transformed with it. All others are touched first by the threads that
        # fill them, because the system clears new memory then: 0.3 s for 12 megapixels in one thread.
        self.spectra[:, self.height :] = 0
        columns = self.channels, COLUMNS, self.height
        self._workers = [
            _Worker(
                RowTransform((self.channels, self._block, strips.length), self.spectra),
                LineTransform((self.together, self.channels, COLUMNS, bands.length)),
                *(empty(columns, np.complex64) for _ in range(2)),
            )
            for _ in range(threads)
        ]
        self.team = ThreadTeam(threads)

    def filter(
        self,
        picture: Float32Array | None,
        out: Float32Array | None,
        change: Callable[[int], Filter],
        *,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Filter a picture (H, W, C), or zeros if it is None, strip by strip; `change` returns the filter of a strip.

        `out` receives the blend of all tiles, and may be `picture` if there is one strip. If it is None, only the
        filters have effects.
        """
        count = len(self.strips.tiles)
        for strip in range(count):
            self._change_rows(picture, out, strip)
            if progress is not None and strip:
                progress(strip / count)
            self._filter_columns(change(strip), blank=picture is None, write=out is not None)
        self._change_rows(None, out, count)
        if progress is not None:
            progress(1.0)

    def _change_rows(self, picture: Float32Array | None, out: Float32Array | None, strip: int) -> None:
        """Transform the rows of the strip before back into `out`, then those of `strip` into :attr:`spectra`.

        Both in one pass find the spectra in the cache.
        """
        if picture is None and (out is None or strip == 0):
            return

        def block(thread: int, top: int) -> None:
            worker, rows = self._workers[thread].rows, min(self._block, self.height - top)
            if out is not None and strip > 0:
                worker.inverse(top)
                self._blend(worker.real, top, rows, strip - 1, out)
            if picture is not None:
                start = self.strips.tiles[strip].start
                lines.picture_to_lines(picture, top, rows, start, self._strip_fade, self._periodic, worker.real)
                worker.forward(top)

        self.team.share(block, range(0, self.height, self._block))

    def _blend(self, restored: Float32Array, top: int, rows: int, strip: int, out: Float32Array) -> None:
        """Blend a block of restored rows into `out` where a strip contributes.

        Strips come in order: each is added to the one before, and overwrites what lies beyond it.
        """
        before, tile = self.strips.tiles[strip - 1], self.strips.tiles[strip]
        overlap = max(before.first + len(before.weights) - tile.first, 0) if strip else 0
        for part, add in ((slice(overlap), True), (slice(overlap, None), False)):
            weights, first = tile.weights[part], tile.first + (part.start or 0)
            lines.lines_to_picture(restored, rows, first - tile.start, weights, first, add, out, top)

    def _filter_columns(self, change: Filter, *, blank: bool, write: bool) -> None:
        """Filter every band of :attr:`spectra`, or of zeros if it is blank, and write the blend of all bands there."""
        # A single band is extended in place, and nothing is blended.
        single = len(self.bands.tiles) == 1

        def block(thread: int, n: int) -> None:
            worker = self._workers[thread]
            columns, blended = 2 * (worker.slabs.lines[0],) if single else (worker.columns, worker.blended)
            if not blank:
                lines.rows_to_columns(self.spectra, n * COLUMNS, self.height, columns)
            if not single:
                blended.fill(0)
            for bands in self._groups:
                starts = self._starts[bands]
                slabs, spectra = worker.slabs.lines[: len(starts)], worker.slabs.spectra[: len(starts)]
                if blank:
                    spectra.fill(0)
                else:
                    lines.cut_lines(columns, self.height, starts, self._band_fade, self._periodic, slabs)
                    worker.slabs.forward()
                change(thread, n, bands, spectra)
                if write:
                    worker.slabs.inverse()
                    if not single:
                        spectral.blend(blended, slabs, self._weights[bands], self._spans[bands])
            if write:
                lines.columns_to_rows(blended, self.spectra, n * COLUMNS, self.height)

        self.team.share(block, range(self.blocks))


class _Worker(NamedTuple):
    """Buffers of one thread."""

    rows: RowTransform  # a block of rows
    slabs: LineTransform  # a group of bands of a block of columns
    columns: ComplexArray  # a block of columns, before ...
    blended: ComplexArray  # ... and after
