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
        spread(bank.displacements[band, strip], path.pitches, path.grid)
        # The mean is the brightness of the picture, so it must be exact.
        path.grid /= path.grid.sum() / path.mean
        return path.rows(path.grid)

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
        self._lengths, self._points = lengths, points
        self._rows = RowTransform((rows, points[1]))
        self._columns = LineTransform((COLUMNS, points[0]))

    def rows(self, grid: NDArray[np.floating]) -> ComplexArray:
        """Return the row spectra of `grid`, whose centre is the origin."""
        real, left = self._rows.real[: len(grid)], grid.shape[1] // 2
        real[...] = 0
        real[:, : grid.shape[1] - left] = grid[:, left:]
        real[:, real.shape[1] - left :] = grid[:, :left]
        self._rows.forward()
        return self._rows.spectrum[: len(grid), : self._lengths[1] // 2 + 1]

    def columns(self, spectrum: ComplexArray, first: int) -> ComplexArray:
        """Return some columns of the transform of the row spectra; the next call overwrites them."""
        part, up = spectrum[:, first : first + COLUMNS].T, len(spectrum) // 2
        self._columns.lines[len(part) :] = 0
        columns = self._columns.lines[: len(part)]
        columns[:, : len(spectrum) - up] = part[:, up:]
        columns[:, len(spectrum) - up : self._points[0] - up] = 0
        columns[:, self._points[0] - up :] = part[:, :up]
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
        # Each gain twice, for real and imaginary parts: numpy would multiply complex numbers.
        self._down, self._across = (
            np.repeat((gain / window).astype(np.float32), 2)
            for gain, window in zip((down, across), self._windows, strict=True)
        )

    def rows(self, grid: NDArray[np.floating]) -> ComplexArray:
        """Return the row spectra of `grid`, whose centre is the origin, without that of the window."""
        spectrum = super().rows(grid)
        parts = spectrum.view(np.float32)
        parts *= self._across
        if self._lengths[1] % 2 == 0:
            # The highest frequency has either sign, so that its phase is cos(pi x).
            spectrum[:, -1] = spectrum[:, -1].real
        return spectrum

    def columns(self, spectrum: ComplexArray, first: int) -> ComplexArray:
        """Return some columns of the transform of the row spectra, without that of the window."""
        columns = super().columns(spectrum, first)
        length, points = self._lengths[0], self._points[0]
        half = length // 2
        if length % 2 == 0:
            columns[:, points - half] = (columns[:, points - half] + columns[:, half]) / 2
        parts, out, split = columns.view(np.float32), self._out.view(np.float32), 2 * (length - half)
        np.multiply(parts[:, :split], self._down[:split], out=out[:, :split])
        np.multiply(parts[:, 2 * (points - half) :], self._down[split:], out=out[:, split:])
        return self._out


def _grid_points(kernel: int, length: int) -> int:
    """Return the points of a fine grid over a tile that holds a path of up to `kernel` px with the window around it."""
    room = (WIDTH + 3) / (length - kernel + 1)
    return fast_length(int(np.ceil(max(OVERSAMPLING, room) * length)), excess=EXCESS)
