"""The hybrid domain: picture rows transformed along x, every row frequency then a column along y.

The blur of a tile does not change along a row, so rows are transformed once for all bands, and what differs from band
to band happens on columns. Every stage works on blocks that fit a processor's cache: a few picture rows are cut and
transformed into their place among the spectra; then a few columns at a time are transposed into the cache, where all
bands are cut, transformed, filtered, transformed back and blended, and go back to their place; then rows come back as
they went. Nothing as large as the picture is touched more than once per stage. Blocks are independent, so threads share
them, and any number of threads gives the same bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import ThreadTeam
from rsdeblur.deconv.border import Border, fade
from rsdeblur.deconv.fft import Complex, LineTransform, Planning, Real, RowTransform, empty
from rsdeblur.deconv.tiling import Tile, Tiling
from rsdeblur.kernels import lines, spectral

# Picture rows per block. 16 rows of 2048 RGB pixels and their spectrum are 0.8 MB, within a second-level cache of 1 to
# 2 MB.
ROWS = 16
# Columns per block, two cache lines of complex values, and bytes of slabs worked on at a time within it.
COLUMNS = 16
SLAB_BYTES = 400_000


class Hybrid:
    """Transforms of pictures of one shape under one tiling; owns the spectra and each thread's buffers and plans.

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
        # Whole blocks; the columns that fill up the last one stay zero. One cache line more makes their number in a row
        # odd: with rows a multiple of 4096 bytes apart, all rows would share cache sets.
        self.padded_frequencies = -(-self.frequencies // COLUMNS) * COLUMNS
        padded_height = -(-self.height // ROWS) * ROWS
        self._spectra: Complex = empty((channels, padded_height, self.padded_frequencies + 8), np.complex64)
        slab_bytes = channels * COLUMNS * bands.length * self._spectra.itemsize
        together = max(1, min(len(bands.tiles), SLAB_BYTES // slab_bytes))
        self._groups = [bands.tiles[g : g + together] for g in range(0, len(bands.tiles), together)]
        self._workers = [
            _Worker(self._rows(0), self.height, bands.length, strips.length, together, planning) for _ in range(threads)
        ]
        self._spectra[...] = 0
        self.team = ThreadTeam(threads)

    def transform_rows(self, picture: Real, strip: Tile) -> bool:
        """Cut `strip` out of `picture` (H, W, C) and transform its rows.

        Returns whether all that was read is finite: looked at here, it costs no pass over the picture.
        """
        taper = fade(self.strips.taper)
        finite = [True]

        def block(thread: int, top: int) -> None:
            worker = self._workers[thread]
            rows = min(ROWS, self.height - top)
            if not lines.picture_to_lines(picture, top, rows, strip.start, taper, self._periodic, worker.rows.real):
                finite[0] = False
            worker.rows.move(self._rows(top))
            worker.rows.forward()

        self.team.share(block, range(0, self.height, ROWS))
        return finite[0]

    def filter_columns(self, filters: Complex) -> None:
        """Filter every band with `filters` (B, padded frequencies, L) and blend the bands, in place."""
        single = len(self.bands.tiles) == 1
        taper = fade(self.bands.taper)

        def block(thread: int, first: int) -> None:
            worker = self._workers[thread]
            # A single tile is extended where it stands; several are cut out and added up elsewhere.
            columns = worker.slabs.data[0] if single else worker.columns
            lines.rows_to_columns(self._spectra, first, self.height, columns)
            if not single:
                worker.blended.fill(0)
            band = 0
            for group in self._groups:
                slabs = worker.slabs.data[: len(group)]
                for slab, tile in zip(slabs, group, strict=True):
                    lines.cut_lines(columns, self.height, tile.start, taper, self._periodic, slab)
                worker.slabs.forward()
                for slab in slabs:
                    spectral.multiply(slab, filters[band, first : first + COLUMNS])
                    band += 1
                worker.slabs.inverse()
                if not single:
                    for slab, tile in zip(slabs, group, strict=True):
                        spectral.blend(worker.blended, slab, tile.weights, tile.first, tile.first - tile.start)
            lines.columns_to_rows(columns if single else worker.blended, self._spectra, first, self.height)

        self.team.share(block, range(0, self.padded_frequencies, COLUMNS))

    def restore_rows(self, out: Real, strip: Tile, *, add: bool) -> None:
        """Transform rows back and put them, or add them, to `out` (H, W, C) where `strip` counts."""

        def block(thread: int, top: int) -> None:
            worker = self._workers[thread]
            rows, offset = min(ROWS, self.height - top), strip.first - strip.start
            worker.rows.move(self._rows(top))
            worker.rows.inverse()
            lines.lines_to_picture(worker.rows.real, rows, offset, strip.weights, strip.first, add, out, top)

        self.team.share(block, range(0, self.height, ROWS))

    def _rows(self, top: int) -> Complex:
        """Where the spectra of a block of rows stand."""
        return self._spectra[:, top : top + ROWS, : self.frequencies]


class _Worker:
    """What one thread works on: a block of rows and a group of slabs, with their transforms."""

    def __init__(
        self, spectrum: Complex, height: int, slab_length: int, row_length: int, slabs: int, planning: Planning
    ) -> None:
        channels = spectrum.shape[0]
        self.rows = RowTransform((channels, ROWS, row_length), planning, spectrum)
        self.slabs = LineTransform((slabs, channels, COLUMNS, slab_length), planning)
        self.columns: NDArray[np.complex64] = empty((channels, COLUMNS, height), np.complex64)
        self.blended: NDArray[np.complex64] = empty((channels, COLUMNS, height), np.complex64)
