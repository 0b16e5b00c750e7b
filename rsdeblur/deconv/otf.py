"""Optical transfer functions of tiles: of kernels, or of the paths themselves where a bank has them.

An OTF is the spectrum of the PSF. That of a path is `H(k) = mean_t exp(-2 pi i k . d(t))`, without the error of drawing
the path on pixels, times that of the softness, a Gaussian. It is computed at the cost of an FFT by
:mod:`rsdeblur.kernels.raster`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.deconv.fft import LineTransform, RowTransform, fast_length
from rsdeblur.kernels.raster import OVERSAMPLING, WIDTH, spread, window_spectrum
from rsdeblur.kernels.spectral import columns_around_origin, lowest_frequencies, rows_around_origin
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, Float32Array

# Columns transformed together: 128 KB to 1 MB, within a second-level cache.
COLUMNS = 64


class Gains(NamedTuple):
    """Factors on the frequencies of a bank's OTFs; all threads that compute columns of one OTF use the same ones."""

    down: Float32Array | None  # along y (L,); None for kernels, which have none
    across: Float32Array  # along x (W // 2 + 1,)


class OtfPlanner:
    """Transforms kernels or paths into OTFs, one at a time: first rows, then blocks of columns.

    `size` is that of the largest kernels, within which paths lie, and `lengths` that of the tiles, px along y and x. A
    planner holds the buffers of one thread. Another thread's planner may transform columns of its row spectra.
    """

    def __init__(self, size: tuple[int, int], lengths: tuple[int, int]) -> None:
        self._size, self._lengths = size, lengths
        self._of_kernels: _GridTransform | None = None
        self._of_paths: _PathTransform | None = None

    def gains(self, bank: PsfBank) -> Gains:
        """Return the gains of the OTFs of `bank`."""
        if bank.displacements is None:
            return Gains(None, np.ones(self._lengths[1] // 2 + 1, np.float32))
        return _path_gains(bank.softness, self._size, self._lengths)

    def rows(self, bank: PsfBank, band: int, strip: int) -> ComplexArray:
        """Return the row spectra of a kernel of `bank`, or of its path; the next call overwrites them."""
        if bank.displacements is None:
            return self._kernels().rows(bank.kernels[band, strip])
        path = self._paths()
        # The mean is the brightness of the picture, so it must be exact.
        total = spread(bank.displacements[band, strip], path.pitches, path.grid)
        return path.rows(path.grid, path.mean / total)

    def columns(self, spectrum: ComplexArray, gains: Gains, first: int) -> ComplexArray:
        """Return columns of the OTF from `first` on, shape (COLUMNS, lengths[0]); the next call overwrites them.

        Those beyond the highest frequency are zero.
        """
        if gains.down is None:
            return self._kernels().columns(spectrum, gains.across, first)
        return self._paths().lowest_columns(spectrum, gains.across, first, gains.down)

    def whole(self, bank: PsfBank, band: int, strip: int) -> ComplexArray:
        """Return the OTF at all frequencies, in the order of `numpy.fft.fft2`."""
        height, width = self._lengths
        half = np.empty((width // 2 + 1, height), np.complex64)
        spectrum, gains = self.rows(bank, band, strip), self.gains(bank)
        for first in range(0, len(half), COLUMNS):
            part = half[first : first + COLUMNS]
            part[...] = self.columns(spectrum, gains, first)[: len(part)]
        # The PSF is real: H(-k) is the conjugate of H(k).
        mirrored = np.roll(half[(width - 1) // 2 : 0 : -1, ::-1], 1, axis=1).conj()
        return np.concatenate([half, mirrored]).T

    def _kernels(self) -> _GridTransform:
        if self._of_kernels is None:
            self._of_kernels = _GridTransform(self._size[0], self._lengths, self._lengths)
        return self._of_kernels

    def _paths(self) -> _PathTransform:
        if self._of_paths is None:
            self._of_paths = _PathTransform(self._size, self._lengths)
        return self._of_paths


class _GridTransform:
    """Transform of a grid of at most so many rows around the origin, at the frequencies of a tile.

    The tile has `lengths` px along y and x, and over them lie `points` of the grid.
    """

    def __init__(self, rows: int, lengths: tuple[int, int], points: tuple[int, int]) -> None:
        self._lengths = lengths
        self._rows = RowTransform((1, rows, points[1]))
        self._columns = LineTransform((COLUMNS, points[0]))

    def rows(self, grid: NDArray[np.floating], factor: float = 1.0) -> ComplexArray:
        """Return the row spectra of `grid` times a factor; its centre is the origin."""
        rows_around_origin(grid, factor, self._rows.real[0, : len(grid)])
        self._rows.forward()
        return self._rows.spectra[0, : len(grid), : self._lengths[1] // 2 + 1]

    def columns(self, spectrum: ComplexArray, across: Float32Array, first: int) -> ComplexArray:
        """Return some columns of the transform of the row spectra times gains; the next call overwrites them."""
        columns_around_origin(spectrum, across, first, self._columns.lines)
        self._columns.forward()
        return self._columns.spectra


class _PathTransform(_GridTransform):
    """Transform of a fine grid over which a path was spread by a window."""

    def __init__(self, size: tuple[int, int], lengths: tuple[int, int]) -> None:
        points = _grid_points(size, lengths)
        self.pitches = points[0] / lengths[0], points[1] / lengths[1]
        # Around each position, the window takes points up to half its width away.
        reach = [int(np.ceil(n // 2 * pitch)) + WIDTH // 2 for n, pitch in zip(size, self.pitches, strict=True)]
        self.grid = np.empty((2 * reach[0] + 1, 2 * reach[1] + 1))
        super().__init__(len(self.grid), lengths, points)
        self.mean = float(window_spectrum(np.zeros(1))[0]) ** 2
        self._out = np.empty((COLUMNS, lengths[0]), np.complex64)

    def rows(self, grid: NDArray[np.floating], factor: float = 1.0) -> ComplexArray:
        """Return the row spectra of `grid` times a factor; its centre is the origin."""
        spectrum = super().rows(grid, factor)
        if self._lengths[1] % 2 == 0:
            # The highest frequency has either sign, so that its phase is cos(pi x).
            spectrum.imag[:, -1] = 0
        return spectrum

    def lowest_columns(
        self, spectrum: ComplexArray, across: Float32Array, first: int, down: Float32Array
    ) -> ComplexArray:
        """Return the lowest frequencies of :meth:`columns` times gains; the next call overwrites them."""
        lowest_frequencies(self.columns(spectrum, across, first), down, self._out)
        return self._out


def _path_gains(softness: float, size: tuple[int, int], lengths: tuple[int, int]) -> Gains:
    """Return the spectrum of a softness (px), divided by that of the window that spread the path on the grid."""
    points = _grid_points(size, lengths)
    turns = np.fft.fftfreq(lengths[0]), np.fft.rfftfreq(lengths[1])
    down, across = (
        (np.exp(-2 * np.square(np.pi * softness * f)) / window_spectrum(f * n / m)).astype(np.float32)
        for f, n, m in zip(turns, lengths, points, strict=True)
    )
    return Gains(down, across)


def _grid_points(size: tuple[int, int], lengths: tuple[int, int]) -> tuple[int, int]:
    """Return the points of a fine grid over a tile that holds paths of up to `size` px with the window around them."""
    down, across = (
        fast_length(int(np.ceil(max(OVERSAMPLING, (WIDTH + 3) / (n - kernel + 1)) * n)), excess=0.1)
        for kernel, n in zip(size, lengths, strict=True)
    )
    return down, across
