"""Optical transfer functions of tiles: of kernels, or of the paths themselves where a bank has them.

An OTF is the spectrum of the PSF. That of a path is `H(k) = mean_t exp(-2 pi i k . d(t))`, without the error of drawing
the path on pixels, times that of the softness, a Gaussian. It is computed at the cost of an FFT by
:mod:`rsdeblur.kernels.spread`.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rsdeblur.deconv.fft import LineTransform, RowTransform, fast_length
from rsdeblur.kernels.otf import columns_around_origin, lowest_frequencies, rows_around_origin
from rsdeblur.kernels.spread import OVERSAMPLING, WIDTH, spread, window_spectrum
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray

# Columns transformed together: 128 KB to 1 MB, within a second-level cache.
COLUMNS = 64
# Share by which the transform of a fine grid may be longer than needed, so that FFTW is fast.
EXCESS = 0.1


class OtfPlanner:
    """Transforms kernels or paths into OTFs, one at a time: first rows, then blocks of columns.

    Parameters
    ----------
    size : (int, int)
        Height and width of the largest kernels, px; paths lie within them.
    lengths : (int, int)
        Length of the tiles along y and x, px.
    """

    def __init__(self, size: tuple[int, int], lengths: tuple[int, int]) -> None:
        self._size, self._lengths = size, lengths

    def rows(self, bank: PsfBank, band: int, strip: int) -> ComplexArray:
        """Return the row spectra of a kernel of `bank`, or of its path; the next call overwrites them."""
        if bank.displacements is None:
            return self._of_kernels.rows(bank.kernels[band, strip])
        path = self._of_paths
        path.soften(bank.softness)
        # The mean is the brightness of the picture, so it must be exact.
        total = spread(bank.displacements[band, strip], path.pitches, path.grid)
        return path.rows(path.grid, path.mean / total)

    def columns(self, bank: PsfBank, spectrum: ComplexArray, first: int) -> ComplexArray:
        """Return columns of the OTF from `first` on, shape (COLUMNS, lengths[0]); the next call overwrites them.

        Those beyond the highest frequency are zero.
        """
        transform = self._of_kernels if bank.displacements is None else self._of_paths
        return transform.columns(spectrum, first)

    def whole(self, bank: PsfBank, band: int, strip: int) -> ComplexArray:
        """Return the OTF at all frequencies, in the order of `numpy.fft.fft2`."""
        height, width = self._lengths
        half = np.empty((width // 2 + 1, height), np.complex64)
        spectrum = self.rows(bank, band, strip)
        for first in range(0, len(half), COLUMNS):
            part = half[first : first + COLUMNS]
            part[...] = self.columns(bank, spectrum, first)[: len(part)]
        # The PSF is real: H(-k) is the conjugate of H(k).
        mirrored = np.roll(half[(width - 1) // 2 : 0 : -1, ::-1], 1, axis=1).conj()
        return np.concatenate([half, mirrored]).T

    @cached_property
    def _of_kernels(self) -> _GridTransform:
        return _GridTransform(self._size[0], self._lengths, self._lengths)

    @cached_property
    def _of_paths(self) -> _PathTransform:
        return _PathTransform(self._size, self._lengths)


class _GridTransform:
    """Transform of a small grid around the origin, at the frequencies of a tile.

    Parameters
    ----------
    rows : int
        Most rows of the grid.
    lengths : (int, int)
        Length of the tile along y and x, px.
    points : (int, int)
        Grid points over these lengths.
    """

    def __init__(self, rows: int, lengths: tuple[int, int], points: tuple[int, int]) -> None:
        self._lengths = lengths
        self._rows = RowTransform((1, rows, points[1]))
        self._columns = LineTransform((COLUMNS, points[0]))
        # Gains of the frequencies along y and x.
        self._down, self._across = (np.ones(n, np.float32) for n in (lengths[0], lengths[1] // 2 + 1))

    def rows(self, grid: NDArray[np.floating], factor: float = 1.0) -> ComplexArray:
        """Return the row spectra of `grid` times a factor; its centre is the origin."""
        rows_around_origin(grid, factor, self._rows.real[0, : len(grid)])
        self._rows.forward()
        return self._rows.spectra[0, : len(grid), : self._lengths[1] // 2 + 1]

    def columns(self, spectrum: ComplexArray, first: int) -> ComplexArray:
        """Return some columns of the transform of the row spectra; the next call overwrites them."""
        columns_around_origin(spectrum, self._across, first, self._columns.lines)
        self._columns.forward()
        return self._columns.spectra


class _PathTransform(_GridTransform):
    """Transform of a fine grid over which a path was spread by a window."""

    def __init__(self, size: tuple[int, int], lengths: tuple[int, int]) -> None:
        points = [_grid_points(*axis) for axis in zip(size, lengths, strict=True)]
        self.pitches = points[0] / lengths[0], points[1] / lengths[1]
        # Around each position, the window takes points up to half its width away.
        reach = [int(np.ceil(n // 2 * pitch)) + WIDTH // 2 for n, pitch in zip(size, self.pitches, strict=True)]
        self.grid = np.empty((2 * reach[0] + 1, 2 * reach[1] + 1))
        super().__init__(len(self.grid), lengths, (points[0], points[1]))
        down, across = (np.fft.fftfreq(n) * n / m for n, m in zip(lengths, points, strict=True))
        self.mean = float(window_spectrum(np.zeros(1))[0]) ** 2
        self._out = np.empty((COLUMNS, lengths[0]), np.complex64)
        self._windows = [window_spectrum(turns) for turns in (down, across[: lengths[1] // 2 + 1])]
        self._softness = -1.0
        self.soften(0.0)

    def soften(self, softness: float) -> None:
        """Let later paths have a softness, px."""
        if softness == self._softness:
            return
        self._softness = softness
        down, across = (
            np.exp(-2 * np.square(np.pi * softness * frequencies))
            for frequencies in (np.fft.fftfreq(self._lengths[0]), np.fft.rfftfreq(self._lengths[1]))
        )
        # The spectrum of the grid is that of the path times that of the window.
        self._down, self._across = (
            (gain / window).astype(np.float32) for gain, window in zip((down, across), self._windows, strict=True)
        )

    def rows(self, grid: NDArray[np.floating], factor: float = 1.0) -> ComplexArray:
        """Return the row spectra of `grid` times a factor; its centre is the origin."""
        spectrum = super().rows(grid, factor)
        if self._lengths[1] % 2 == 0:
            # The highest frequency has either sign, so that its phase is cos(pi x).
            spectrum.imag[:, -1] = 0
        return spectrum

    def columns(self, spectrum: ComplexArray, first: int) -> ComplexArray:
        """Return some columns of the transform of the row spectra; the next call overwrites them."""
        lowest_frequencies(super().columns(spectrum, first), self._down, self._out)
        return self._out


def _grid_points(kernel: int, length: int) -> int:
    """Return the points of a fine grid over a tile that holds a path of up to `kernel` px with the window around it."""
    room = (WIDTH + 3) / (length - kernel + 1)
    return fast_length(int(np.ceil(max(OVERSAMPLING, room) * length)), excess=EXCESS)
