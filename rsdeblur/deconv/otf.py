"""Optical transfer functions of tiles: of kernels, or of the paths themselves where a bank has them.

An OTF is the spectrum of the PSF. That of a path is `H(k) = mean_t exp(-2 pi i k . d(t))`, without the error of drawing
the path on pixels, times that of the softness, a Gaussian. It is computed at the cost of an FFT by
:mod:`rsdeblur.kernels.raster`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.deconv.fft import LineTransform, RowTransform, fast_length
from rsdeblur.kernels.raster import OVERSAMPLING, WIDTH, spread, window_spectrum
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, Float32Array

# Columns transformed together: 128 KB to 1 MB, within a second-level cache.
COLUMNS = 64


# Factors on the frequencies of OTFs of paths along y (2 L,) and x (2 (W // 2 + 1),), which threads share. Each is there
# twice, for real and imaginary parts: NumPy would make complex numbers of them for complex ones. The highest frequency
# of an even number has either sign, so its factor along y is half.
Gains = tuple[Float32Array, Float32Array]


class OtfPlanner:
    """Transforms kernels or paths into OTFs, one at a time: first rows, then blocks of columns.

    `size` is that of the largest kernels, within which paths lie, and `lengths` that of the tiles, px along y and x. A
    planner holds the buffers of one thread. Another thread's planner may transform columns of its row spectra.
    """

    def __init__(self, size: tuple[int, int], lengths: tuple[int, int]) -> None:
        self._size, self._lengths = size, lengths
        self._points = _grid_points(size, lengths)
        # Grid points per px.
        self._pitches = self._points[0] / lengths[0], self._points[1] / lengths[1]
        # Buffers for kernels, and for paths.
        self._transforms: dict[bool, tuple[RowTransform, LineTransform]] = {}
        self._lowest: ComplexArray = np.empty((COLUMNS, lengths[0]), np.complex64)

    def gains(self, bank: PsfBank) -> Gains | None:
        """Return the gains of the OTFs of paths, which undo the window; None for a bank of kernels, which need none."""
        if bank.displacements is None:
            return None
        turns: tuple[Any, ...] = np.fft.fftfreq(self._lengths[0]), np.fft.rfftfreq(self._lengths[1])
        down, across = (
            (np.exp(-2 * np.square(np.pi * bank.softness * f)) / window_spectrum(f / pitch)).astype(np.float32)
            for f, pitch in zip(turns, self._pitches, strict=True)
        )
        if len(down) % 2 == 0:
            down[len(down) // 2] /= 2
        return np.repeat(down, 2), np.repeat(across, 2)

    def rows(self, bank: PsfBank, gains: Gains | None, band: int, strip: int) -> ComplexArray:
        """Return the row spectra of a kernel of `bank`, or of its path; the next call overwrites them."""
        if bank.displacements is None or gains is None:
            return self._row_spectra(bank.kernels[band, strip], 1.0, drawn=True)
        # Around each position, the window takes points up to half its width away.
        down, across = (
            int(np.ceil(n // 2 * pitch)) + WIDTH // 2 for n, pitch in zip(self._size, self._pitches, strict=True)
        )
        grid = np.empty((2 * down + 1, 2 * across + 1))
        total = spread(bank.displacements[band, strip], self._pitches, grid)
        # The mean is the brightness of the picture, so it must be exact.
        spectrum = self._row_spectra(grid, float(window_spectrum(np.zeros(1))[0]) ** 2 / total, drawn=False)
        if self._lengths[1] % 2 == 0:
            # The highest frequency has either sign, so that its phase is cos(pi x).
            spectrum.imag[:, -1] = 0
        parts = spectrum.view(np.float32)
        parts *= gains[1]
        return spectrum

    def _row_spectra(self, grid: NDArray[np.floating], factor: float, *, drawn: bool) -> ComplexArray:
        """Return the row spectra of a grid times a factor, its centre being the origin, at the tile's frequencies."""
        (height, width), transform = grid.shape, self._buffers(drawn, len(grid))[0]
        left, real = width // 2, transform.real[0, :height]
        real[:, width - left : real.shape[1] - left] = 0
        real[:, : width - left] = grid[:, left:] * factor
        real[:, real.shape[1] - left :] = grid[:, :left] * factor
        transform.forward()
        return transform.spectra[0, :height, : self._lengths[1] // 2 + 1]

    def columns(self, spectrum: ComplexArray, gains: Gains | None, first: int) -> ComplexArray:
        """Return columns of the OTF from `first` on, shape (COLUMNS, lengths[0]); the next call overwrites them.

        Those beyond the highest frequency are zero.
        """
        transform = self._buffers(gains is None, len(spectrum))[1]
        lines, above = transform.lines, len(spectrum) // 2
        columns, below, start = spectrum[:, first : first + COLUMNS].T, len(spectrum) - above, lines.shape[1] - above
        count = len(columns)
        # The middle row is the origin.
        lines[:count, :below], lines[:count, start:] = columns[:, above:], columns[:, :above]
        # As floats: NumPy fills with complex numbers at half the speed.
        lines[:count, below:start].view(np.float32)[...] = 0
        lines[count:] = 0
        transform.forward()
        return transform.spectra if gains is None else self._lowest_frequencies(transform.spectra, gains)

    def _lowest_frequencies(self, spectra: ComplexArray, gains: Gains) -> ComplexArray:
        """Return the frequencies of a tile of columns of a finer grid, in FFT's order, times their gains."""
        lowest, half = self._lowest, self._lengths[0] // 2
        split = self._lengths[0] - half
        lowest[:, :split], lowest[:, split:] = spectra[:, :split], spectra[:, spectra.shape[1] - half :]
        if split == half:
            lowest[:, half] += spectra[:, half]
        parts = lowest.view(np.float32)
        parts *= gains[0]
        return lowest

    def whole(self, bank: PsfBank, band: int, strip: int) -> ComplexArray:
        """Return the OTF at all frequencies, in the order of `numpy.fft.fft2`."""
        height, width = self._lengths
        half = np.empty((width // 2 + 1, height), np.complex64)
        gains = self.gains(bank)
        spectrum = self.rows(bank, gains, band, strip)
        for first in range(0, len(half), COLUMNS):
            part = half[first : first + COLUMNS]
            part[...] = self.columns(spectrum, gains, first)[: len(part)]
        # The PSF is real: H(-k) is the conjugate of H(k).
        mirrored = np.roll(half[(width - 1) // 2 : 0 : -1, ::-1], 1, axis=1).conj()
        return np.concatenate([half, mirrored]).T

    def _buffers(self, drawn: bool, rows: int) -> tuple[RowTransform, LineTransform]:
        """Return the transforms of kernels, which are drawn on the pixels of the tile, or of finer grids of paths."""
        if drawn not in self._transforms:
            points, most = (self._lengths, self._size[0]) if drawn else (self._points, rows)
            self._transforms[drawn] = RowTransform((1, most, points[1])), LineTransform((COLUMNS, points[0]))
        return self._transforms[drawn]


def _grid_points(size: tuple[int, int], lengths: tuple[int, int]) -> tuple[int, int]:
    """Return the points of a fine grid over a tile that holds paths of up to `size` px with the window around them."""
    down, across = (
        fast_length(int(np.ceil(max(OVERSAMPLING, (WIDTH + 3) / (n - kernel + 1)) * n)), excess=0.1)
        for kernel, n in zip(size, lengths, strict=True)
    )
    return down, across
