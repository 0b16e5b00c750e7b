"""The hybrid domain: picture rows are transformed along x, and each row frequency is then a column along y.

The blur of a tile does not change along a row. So rows are transformed once for all bands, and bands differ only in
what happens to columns. There are three stages; each works on blocks that fit a processor's cache, and touches all data
once:

1. A few rows at a time are cut out of the picture and transformed into the spectra.
2. A few columns of the spectra at a time are transposed into the cache. There all bands are cut, transformed, filtered,
   transformed back and blended, and the columns go back to their place.
3. A few rows of the spectra at a time are transformed back into the picture.

Blocks are independent, so threads share them, and any number of threads gives the same bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import ThreadTeam
from rsdeblur.choices import Border, Planning
from rsdeblur.deconv.border import fade
from rsdeblur.deconv.fft import LineTransform, RowTransform, empty
from rsdeblur.deconv.tiling import Tile, Tiling
from rsdeblur.kernels import lines, spectral
from rsdeblur.types import ComplexArray, Float32Array

# Picture rows per block. 16 rows of 2048 RGB pixels and their spectrum are 0.8 MB, within a second-level cache of 1 to
# 2 MB.
ROWS = 16
# Columns per block: two cache lines of complex values. A slab holds one band of a block of columns; so many bytes of
# slabs are transformed together.
COLUMNS = 16
SLAB_BYTES = 400_000


class Hybrid:
    """Transforms of pictures of one shape under one tiling, with the spectra and each thread's buffers and plans.

    Parameters
    ----------
    shape : (H, W, C)
        Shape of the pictures.
    bands, strips : Tiling
        Tiles along y and along x.
    border : {"blend", "periodic"}
        How tiles continue beyond the picture.
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
        # Whole blocks of columns; those that fill up the last block stay zero. The 8 columns more in `_spectra` make
        # the number of cache lines in a row odd: with rows a multiple of 4096 bytes apart, all would share cache sets.
        self.padded_frequencies = -(-self.frequencies // COLUMNS) * COLUMNS
        padded_height = -(-self.height // ROWS) * ROWS
        self._spectra: ComplexArray = empty((channels, padded_height, self.padded_frequencies + 8), np.complex64)
        slab_bytes = channels * COLUMNS * bands.length * self._spectra.itemsize
        together = max(1, min(len(bands.tiles), SLAB_BYTES // slab_bytes))
        self._groups = [bands.tiles[g : g + together] for g in range(0, len(bands.tiles), together)]
        self._workers = [
            _Worker(self._rows(0), self.height, bands.length, strips.length, together, planning) for _ in range(threads)
        ]
        self._spectra[...] = 0
        self.team = ThreadTeam(threads)

    def transform_rows(self, picture: Float32Array, strip: Tile) -> bool:
        """Cut `strip` out of `picture` (H, W, C) and transform its rows.

        Return whether all values that were read are finite. To check it here costs no further pass over the picture.
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

    def filter_columns(self, filters: ComplexArray) -> None:
        """Filter every band with `filters` (B, padded frequencies, L) and blend the bands, in place."""
        single = len(self.bands.tiles) == 1
        taper = fade(self.bands.taper)

        def block(thread: int, first: int) -> None:
            worker = self._workers[thread]
            # A single tile is extended in place; several are cut out, and their sum is collected elsewhere.
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

    def restore_rows(self, out: Float32Array, strip: Tile, *, add: bool) -> None:
        """Transform rows back; write them to `out` (H, W, C), or add them, where `strip` contributes."""

        def block(thread: int, top: int) -> None:
            worker = self._workers[thread]
            rows, offset = min(ROWS, self.height - top), strip.first - strip.start
            worker.rows.move(self._rows(top))
            worker.rows.inverse()
            lines.lines_to_picture(worker.rows.real, rows, offset, strip.weights, strip.first, add, out, top)

        self.team.share(block, range(0, self.height, ROWS))

    def _rows(self, top: int) -> ComplexArray:
        """Return a view of the spectra of a block of rows."""
        return self._spectra[:, top : top + ROWS, : self.frequencies]


class _Worker:
    """Buffers of one thread: a block of rows and a group of slabs, with their transforms."""

    def __init__(
        self, spectrum: ComplexArray, height: int, slab_length: int, row_length: int, slabs: int, planning: Planning
    ) -> None:
        channels = spectrum.shape[0]
        self.rows = RowTransform((channels, ROWS, row_length), planning, spectrum)
        self.slabs = LineTransform((slabs, channels, COLUMNS, slab_length), planning)
        self.columns: NDArray[np.complex64] = empty((channels, COLUMNS, height), np.complex64)
        self.blended: NDArray[np.complex64] = empty((channels, COLUMNS, height), np.complex64)
