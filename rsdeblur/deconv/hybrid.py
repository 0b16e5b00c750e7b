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

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rsdeblur._util.memory import empty
from rsdeblur._util.threads import ThreadTeam
from rsdeblur.choices import Border, Planning
from rsdeblur.deconv.fft import LineTransform, RowTransform
from rsdeblur.deconv.tiling import Tile, Tiling, fade
from rsdeblur.kernels import lines, spectral
from rsdeblur.types import ComplexArray, Float32Array, Int32Array

# Columns per block: two cache lines of complex values. A slab holds one band of a block of columns; so many bytes of
# slabs are transformed together.
COLUMNS = 16
SLAB_BYTES = 400_000


# Called as ``filter(thread, block, bands, slabs)`` with the numbers of the calling thread and of the block of columns.
# Changes the slabs (B, C, COLUMNS, L) in place: spectra of these columns in the B bands, zero without a picture.
Filter = Callable[[int, int, slice, ComplexArray], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Some bands that are filtered together, as the kernels need them."""

    bands: slice  # the B bands
    starts: Int32Array  # first position that each band reads (B,)
    weights: Float32Array  # of each band where it contributes (B, W); those that fill up a row are zero
    spans: Int32Array  # first of these positions in the picture, first one in the band, and their number (B, 3)

    @classmethod
    def of(cls, first: int, tiles: Sequence[Tile]) -> _Group:
        """Return the group of `tiles`, the bands from `first` on."""
        weights = np.zeros((len(tiles), max(len(tile.weights) for tile in tiles)), np.float32)
        for row, tile in zip(weights, tiles, strict=True):
            row[: len(tile.weights)] = tile.weights
        starts = np.array([tile.start for tile in tiles], np.int32)
        spans = np.array([(tile.first, tile.first - tile.start, len(tile.weights)) for tile in tiles], np.int32)
        return cls(slice(first, first + len(tiles)), starts, weights, spans)


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
        planning: Planning,
        threads: int,
    ) -> None:
        self.height, _, self.channels = shape
        self.bands, self.strips = bands, strips
        self._block = _rows_per_block(self.channels * strips.length)
        self._periodic = border == "periodic"
        self._strip_fade, self._band_fade = fade(strips.taper), fade(bands.taper)
        self.frequencies = strips.length // 2 + 1
        # Columns that fill up the last block are zero.
        self.blocks = -(-self.frequencies // COLUMNS)
        slab_bytes = self.channels * COLUMNS * bands.length * np.dtype(np.complex64).itemsize
        self.together = max(1, min(len(bands.tiles), SLAB_BYTES // slab_bytes))
        firsts = range(0, len(bands.tiles), self.together)
        self._groups = [_Group.of(first, bands.tiles[first : first + self.together]) for first in firsts]
        self.spectra = self._new_spectra()
        self._workers = [
            _Worker(self.spectra, self.height, (self._block, strips.length), (self.together, bands.length), planning)
            for _ in range(threads)
        ]
        self.team = ThreadTeam(threads)

    def _new_spectra(self) -> ComplexArray:
        """Return memory for the spectra of all rows of one strip, not initialised."""
        padded_height = -(-self.height // self._block) * self._block
        # The 8 columns more make the number of cache lines in a row odd: with rows a multiple of 4096 bytes apart, all
        # would share cache sets.
        spectra: ComplexArray = empty((self.channels, padded_height, self.blocks * COLUMNS + 8), np.complex64)
        # Rows that fill up the last block are transformed with it. All others are touched first by the threads that
        # fill them, because the system clears new memory then: 0.3 s for 12 megapixels in one thread.
        spectra[:, self.height :] = 0
        return spectra

    def filter(
        self,
        picture: Float32Array | None,
        out: Float32Array | None,
        change: Callable[[int], Filter],
        *,
        progress: Callable[[float], None] | None = None,
    ) -> bool:
        """Filter a picture (H, W, C), or zeros if it is None, strip by strip; `change` returns the filter of a strip.

        `out` receives the blend of all tiles, and may be `picture` if there is one strip. If it is None, only the
        filters have effects. Return False if the picture is not finite; `out` is then unfinished. To check it here
        costs no further pass over it.
        """
        count = len(self.strips.tiles)
        for strip in range(count):
            if not self._change_rows(picture, out, strip):
                return False
            if progress is not None and strip:
                progress(strip / count)
            self._filter_columns(change(strip), blank=picture is None, write=out is not None)
        self._change_rows(None, out, count)
        if progress is not None:
            progress(1.0)
        return True

    def _change_rows(self, picture: Float32Array | None, out: Float32Array | None, strip: int) -> bool:
        """Transform the rows of the strip before back into `out`, then those of `strip` into :attr:`spectra`.

        Return whether all values that were read are finite. Both in one pass find the spectra in the cache.
        """
        reads, writes, finite = picture is not None, out is not None and strip > 0, [True]
        if not (reads or writes):
            return True

        def block(thread: int, top: int) -> None:
            rows = min(self._block, self.height - top)
            if out is not None and strip > 0:
                self._restore(thread, top, rows, strip - 1, out)
            if picture is not None and not self._transform(thread, top, rows, strip, picture):
                finite[0] = False

        self.team.share(block, range(0, self.height, self._block))
        return finite[0]

    def _transform(self, thread: int, top: int, rows: int, strip: int, picture: Float32Array) -> bool:
        """Cut a strip out of a block of rows and transform them; return whether they are finite."""
        worker, start = self._workers[thread], self.strips.tiles[strip].start
        finite = lines.picture_to_lines(picture, top, rows, start, self._strip_fade, self._periodic, worker.rows.real)
        worker.rows.forward(top)
        return finite

    def _restore(self, thread: int, top: int, rows: int, strip: int, out: Float32Array) -> None:
        """Transform a block of rows back, and blend them into `out` where a strip contributes.

        Strips come in order: each is added to the one before, and overwrites what lies beyond it.
        """
        before, tile = self.strips.tiles[strip - 1], self.strips.tiles[strip]
        overlap = max(before.first + len(before.weights) - tile.first, 0) if strip else 0
        worker = self._workers[thread]
        worker.rows.inverse(top)
        for part, add in ((slice(overlap), True), (slice(overlap, None), False)):
            weights, first = tile.weights[part], tile.first + (part.start or 0)
            lines.lines_to_picture(worker.rows.real, rows, first - tile.start, weights, first, add, out, top)

    def _filter_columns(self, change: Filter, *, blank: bool, write: bool) -> None:
        """Filter every band of :attr:`spectra`, or of zeros if it is blank, and write the blend of all bands there."""
        filter_block = self._filter_single if len(self.bands.tiles) == 1 else self._filter_bands

        def share(thread: int, block: int) -> None:
            filter_block(thread, block, change, blank, write)

        self.team.share(share, range(self.blocks))

    def _filter_single(self, thread: int, block: int, change: Filter, blank: bool, write: bool) -> None:
        """Filter a block of columns of a single tile, which is extended in place."""
        slabs, (group,) = self._workers[thread].slabs, self._groups
        if blank:
            slabs.spectra.fill(0)
        else:
            columns = slabs.lines[0]
            lines.rows_to_columns(self.spectra, block * COLUMNS, self.height, columns)
            lines.cut_lines(columns, self.height, group.starts, self._band_fade, self._periodic, slabs.lines)
            slabs.forward()
        change(thread, block, group.bands, slabs.spectra)
        if write:
            slabs.inverse()
            lines.columns_to_rows(slabs.lines[0], self.spectra, block * COLUMNS, self.height)

    def _filter_bands(self, thread: int, block: int, change: Filter, blank: bool, write: bool) -> None:
        """Filter a block of columns of several bands, which are cut out; their sum is collected elsewhere."""
        worker = self._workers[thread]
        if not blank:
            lines.rows_to_columns(self.spectra, block * COLUMNS, self.height, worker.columns)
        worker.blended.fill(0)
        for group in self._groups:
            slabs, spectra = worker.slabs.lines[: len(group.starts)], worker.slabs.spectra[: len(group.starts)]
            if blank:
                spectra.fill(0)
            else:
                lines.cut_lines(worker.columns, self.height, group.starts, self._band_fade, self._periodic, slabs)
                worker.slabs.forward()
            change(thread, block, group.bands, spectra)
            if write:
                worker.slabs.inverse()
                spectral.blend(worker.blended, slabs, group.weights, group.spans)
        if write:
            lines.columns_to_rows(worker.blended, self.spectra, block * COLUMNS, self.height)


class _Worker:
    """Buffers of one thread: a block of rows and a group of slabs, with their transforms."""

    def __init__(
        self, spectra: ComplexArray, height: int, rows: tuple[int, int], slabs: tuple[int, int], planning: Planning
    ) -> None:
        channels, (count, length) = len(spectra), slabs
        self.rows = RowTransform((channels, *rows), planning, spectra)
        self.slabs = LineTransform((count, channels, COLUMNS, length), planning)
        self.columns, self.blended = (empty((channels, COLUMNS, height), np.complex64) for _ in range(2))


def _rows_per_block(values: int) -> int:
    """Return the rows per block if a row has so many values, of all channels."""
    # A value takes 4 bytes, and so does its share of the spectrum. Together they fill 800 kB, within a second-level
    # cache of 1 to 2 MB. With more than 64 rows, small pictures have too few blocks for many threads.
    rows = 800_000 // (8 * values) // 16 * 16
    return max(16, min(rows, 64))
