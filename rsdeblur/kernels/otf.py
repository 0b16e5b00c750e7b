"""What surrounds the two Fourier transforms of an OTF, and the Wiener filter of one.

A transform of a small grid around the origin goes first along the rows, then along the columns, some of them at a time.
Each kernel takes what one transform left to where the next one needs it, in one call: many tiles are planned at once,
and threads that hold Python's lock between short calls would wait for each other.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import ComplexArray, Float32Array

# Complex values in a cache line. So many columns are filled together: the same places of more columns, which are often
# a power of two apart, would not stay in the first-level cache.
LINE = 8


@njit(nogil=True)
def rows_around_origin(grid, factor, rows):
    """Place a grid (n, m) times `factor`, its centre being the origin, at the corners of `rows` (n, M) that repeat.

    M is at least m; all other values become 0.
    """
    left = grid.shape[1] // 2
    right = grid.shape[1] - left
    for i in range(grid.shape[0]):
        rows[i, right : rows.shape[1] - left] = 0
        for j in range(right):
            rows[i, j] = grid[i, left + j] * factor
        for j in range(left):
            rows[i, rows.shape[1] - left + j] = grid[i, j] * factor


# Real and imaginary parts alternate: such loops become SIMD code.
@njit(nogil=True)
def _columns_around_origin(spectrum, gains, first, columns):
    above = spectrum.shape[0] // 2
    below = spectrum.shape[0] - above
    points = columns.shape[1] // 2
    count = min(columns.shape[0], len(gains) - first)
    columns[count:] = 0
    columns[:count, 2 * below : 2 * (points - above)] = 0
    for begin in range(0, count, LINE):
        for i in range(spectrum.shape[0]):
            place = i - above if i >= above else points - above + i
            for k in range(begin, min(begin + LINE, count)):
                gain = gains[first + k]
                columns[k, 2 * place] = spectrum[i, 2 * (first + k)] * gain
                columns[k, 2 * place + 1] = spectrum[i, 2 * (first + k) + 1] * gain


def columns_around_origin(spectrum: ComplexArray, gains: Float32Array, first: int, columns: ComplexArray) -> None:
    """Place columns of row spectra (n, F), times `gains` (F,), in `columns` (K, M) that repeat.

    The columns are the K from `first` on; those beyond F become 0. The middle row of `spectrum` is the origin. M is at
    least n; all other values become 0.
    """
    _columns_around_origin(spectrum.view(np.float32), gains, first, columns.view(np.float32))


@njit(nogil=True)
def _lowest_frequencies(spectra, gains, out):
    length, points = len(gains), spectra.shape[1] // 2
    half = length // 2
    beyond = 2 * (points - length)
    for k in range(len(spectra)):
        source, target = spectra[k], out[k]
        for j in range(length - half):
            target[2 * j] = source[2 * j] * gains[j]
            target[2 * j + 1] = source[2 * j + 1] * gains[j]
        for j in range(length - half, length):
            target[2 * j] = source[beyond + 2 * j] * gains[j]
            target[2 * j + 1] = source[beyond + 2 * j + 1] * gains[j]
        if length % 2 == 0:
            for part in range(2):
                both = source[2 * (points - half) + part] + source[2 * half + part]
                target[2 * half + part] = np.float32(0.5) * both * gains[half]


def lowest_frequencies(spectra: ComplexArray, gains: Float32Array, out: ComplexArray) -> None:
    """Fill `out` (K, L) with the lowest frequencies of `spectra` (K, M), in FFT's order, times `gains` (L,); L <= M.

    The highest of an even number of frequencies has either sign: it becomes the mean of both.
    """
    _lowest_frequencies(spectra.view(np.float32), gains, out.view(np.float32))


@njit(nogil=True)
def put_columns(columns, block, band, out):
    """Copy `columns` (N, L) of a band to where a pass over the blocks of columns reads them.

    `out` has the shape (blocks, B, K, L). The first column goes to `block`; those beyond the last block are ignored.
    """
    together = out.shape[2]
    for n in range(min(len(columns), together * (len(out) - block))):
        # By a loop: with the error message of `target[:] = source`, Numba takes two seconds more to compile.
        source, target = columns[n], out[block + n // together, band, n % together]
        for i in range(len(source)):
            target[i] = source[i]


@njit(nogil=True, error_model="numpy")
def _invert_line(otf, nsr, scale, out):
    for i in range(len(otf) // 2):
        real, imag = otf[2 * i], otf[2 * i + 1]
        gain = scale / (real * real + imag * imag + nsr)
        out[2 * i], out[2 * i + 1] = real * gain, -imag * gain


@njit(nogil=True, error_model="numpy")
def invert(otfs, nsr, scale, block, band, out):
    """Place the Wiener filter `scale conj(H) / (|H|^2 + nsr)` of columns `otfs` (N, L) like :func:`put_columns`.

    `nsr` and `scale` are float32; `nsr` is positive.
    """
    columns = out.shape[2]
    for n in range(min(len(otfs), columns * (len(out) - block))):
        line = out[block + n // columns, band, n % columns]
        _invert_line(otfs[n].view(np.float32), nsr, scale, line.view(np.float32))
