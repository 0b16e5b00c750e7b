"""What surrounds the two Fourier transforms of an OTF.

A transform of a small grid around the origin goes first along the rows, then along the columns, some of them at a time.
Each kernel takes what one transform left to where the next one needs it, in one call: many tiles are planned at once,
and threads that hold Python's lock between short calls would wait for each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit
from rsdeblur.types import ComplexArray, Float32Array

# Complex values in a cache line. So many columns are filled together: the same places of more columns, which are often
# a power of two apart, would not stay in the first-level cache.
LINE = 8


@njit(nogil=True)
def _rows_around_origin(grid, factor, rows):
    left = grid.shape[1] // 2
    right = grid.shape[1] - left
    for i in range(grid.shape[0]):
        rows[i, right : rows.shape[1] - left] = 0
        for j in range(right):
            rows[i, j] = grid[i, left + j] * factor
        for j in range(left):
            rows[i, rows.shape[1] - left + j] = grid[i, j] * factor


def rows_around_origin(grid: NDArray[np.floating], factor: float, rows: Float32Array) -> None:
    """Place a grid, whose centre is the origin, at the corners of rows that repeat.

    Parameters
    ----------
    grid : ndarray, shape (n, m), float
        The grid.
    factor : float
        Factor on its values.
    rows : ndarray, shape (n, M), float32
        Receives the values, M >= m; the others become 0.
    """
    _rows_around_origin(grid, factor, rows)


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
    """Place columns of row spectra, of which the middle row is the origin, in columns that repeat.

    Parameters
    ----------
    spectrum : ndarray, shape (n, F), complex64
        Spectra of the rows.
    gains : ndarray, shape (F,), float32
        Factor on each column.
    first : int
        The first column.
    columns : ndarray, shape (K, M), complex64
        Receives K columns, M >= n; those beyond F and all other values become 0.
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
    """Take the lowest frequencies of spectra, in FFT's order, times a gain.

    The highest of an even number of frequencies has either sign: it becomes the mean of both.

    Parameters
    ----------
    spectra : ndarray, shape (K, M), complex64
        Spectra.
    gains : ndarray, shape (L,), float32
        Gains, L <= M.
    out : ndarray, shape (K, L), complex64
        Receives them.
    """
    _lowest_frequencies(spectra.view(np.float32), gains, out.view(np.float32))


@njit(nogil=True)
def _put_columns(columns, block, band, out):
    together = out.shape[2]
    for n in range(min(len(columns), together * (len(out) - block))):
        # By a loop: with the error message of `target[:] = source`, Numba takes two seconds more to compile.
        source, target = columns[n], out[block + n // together, band, n % together]
        for i in range(len(source)):
            target[i] = source[i]


def put_columns(columns: ComplexArray, block: int, band: int, out: ComplexArray) -> None:
    """Copy columns of a band to where a pass over the blocks of columns reads them.

    Parameters
    ----------
    columns : ndarray, shape (N, L), complex64
        The columns; those beyond the last block are ignored.
    block, band : int
        Block that receives the first ones, and the band.
    out : ndarray, shape (blocks, B, K, L), complex64
        Blocks of K columns.
    """
    _put_columns(columns, block, band, out)
