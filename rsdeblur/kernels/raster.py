"""Paths drawn as PSFs, and spread over a grid by a smooth window.

All integrate a path of unit energy: segments between two samples have the same energy, spread evenly over time. Two
Gauss points integrate each part of a segment under a window, of which there are three. The bilinear one gives the
weights of the four neighbouring pixels. The second interpolates between pixels. The third is for exact spectra: the
spectrum of the grid is that of the path times that of the window, plus aliases that the window keeps small. Divided by
the window's spectrum it is a non-uniform Fourier transform of the path [1]_.

.. [1] A. Dutt and V. Rokhlin, "Fast Fourier transforms for nonequispaced data", SIAM J. Sci. Comput. 14, 1993.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import FloatArray

# Two-point Gauss-Legendre nodes on [0, 1].
GAUSS_LOW = 0.5 - 0.5 / 3.0**0.5
GAUSS_HIGH = 0.5 + 0.5 / 3.0**0.5
# Grid points per px along each axis at least, and grid points that the window covers. With these the aliases are below
# 2e-4 of the OTF's largest value.
OVERSAMPLING, WIDTH = 1.25, 8
# Shape of the Kaiser-Bessel window with the smallest aliases (Beatty et al., IEEE Trans. Med. Imaging 24, 2005).
SHAPE = math.pi * ((WIDTH / OVERSAMPLING) ** 2 * (OVERSAMPLING - 0.5) ** 2 - 0.8) ** 0.5
# Pixels that the interpolating window covers.
SINC_WIDTH = 6
# Entries of the window's table per grid point; linear interpolation between them has an error of at most 1e-6.
STEPS = 512
# Longest part of a segment, in grid points along one axis, that two Gauss points integrate. The error of the highest
# frequency along the axis is below 2e-4. The bilinear window has kinks.
MOST_STEP, BILINEAR_STEP = 0.35, 0.1


def window_spectrum(turns: FloatArray) -> FloatArray:
    """Return the spectrum of the window sampled at grid points; frequencies are in turns per grid point."""
    distance = np.arange(1, WIDTH // 2 + 1)
    spectrum: FloatArray = 1.0 + 2.0 * np.cos(2 * np.pi * np.multiply.outer(turns, distance)) @ _TABLE[distance * STEPS]
    return spectrum


@lru_cache(8)
def _sinc_table(softness: float = 0.0) -> FloatArray:
    """Return the Kaiser-windowed sinc at the same distances, under a Gaussian of up to 1 px."""
    distance = np.arange(STEPS * WIDTH // 2 + 2) / STEPS
    inside = np.clip(1 - (2 * distance / SINC_WIDTH) ** 2, 0, None)
    # With this shape, amplitudes err by 0.1 % at a quarter of the highest frequency and by 1 % at half of it, where
    # linear interpolation errs by 6 and 21 %.
    shape = 5.0
    table: FloatArray = np.sinc(distance) * np.i0(shape * np.sqrt(inside)) / np.i0(shape) * (inside > 0)
    table[STEPS::STEPS] = 0.0  # zeros of the sinc, without rounding
    if softness > 0:
        table = gaussian_filter1d(table, softness * STEPS, mode="mirror")
        table[STEPS * WIDTH // 2 :] = 0.0
    return table


# The window at distances from 0 to half its width, where it is zero, and one step more.
_TABLE = np.append(np.kaiser(STEPS * WIDTH + 1, SHAPE)[STEPS * WIDTH // 2 : -1], [0.0, 0.0])
# The bilinear window, at the same distances.
_HAT = np.clip(1 - np.arange(STEPS + 2) / STEPS, 0, None)


@njit(nogil=True, error_model="numpy", inline="always")
def _weigh(position, table, weights):
    """Fill the weights of the grid points around a position; return the first of them."""
    first = int(position) - len(weights) // 2 + 1
    for i in range(len(weights)):
        place = abs(first + i - position) * STEPS
        n = int(place)
        weights[i] = table[n] + (place - n) * (table[n + 1] - table[n])
    return first


@njit(nogil=True, error_model="numpy")
def _spread(path, down, across, table, most_step, grid):
    centre_y, centre_x = grid.shape[0] // 2, grid.shape[1] // 2
    width = 2 * (len(table) // STEPS)
    in_y, in_x = np.empty(width), np.empty(width)
    segments = path.shape[0] - 1
    for k in range(segments):
        x0, y0 = path[k, 0] * across + centre_x, path[k, 1] * down + centre_y
        vx, vy = path[k + 1, 0] * across + centre_x - x0, path[k + 1, 1] * down + centre_y - y0
        parts = max(int(np.ceil(max(abs(vx), abs(vy)) / most_step)), 1)
        energy = 0.5 / (parts * segments)
        for point in range(2 * parts):
            t = (point // 2 + (GAUSS_HIGH if point % 2 else GAUSS_LOW)) / parts
            first_y, first_x = _weigh(y0 + t * vy, table, in_y), _weigh(x0 + t * vx, table, in_x)
            for i in range(width):
                of_row = energy * in_y[i]
                for j in range(width):
                    grid[first_y + i, first_x + j] += of_row * in_x[j]


@njit(nogil=True, error_model="numpy")
def _draw(first, stop, paths, fits, table, most_step, beyond, kernels):
    for n in range(first, stop):
        kernel = np.zeros((kernels.shape[1] + 2 * beyond, kernels.shape[2] + 2 * beyond))
        if fits[n]:
            _spread(paths[n], 1.0, 1.0, table, most_step, kernel)
        # 0, and so NaN in the kernel, if the path does not fit.
        total = kernel.sum()
        # A loop over cells: an assignment of arrays, with its error message, takes Numba four seconds more to compile.
        for i in range(kernels.shape[1]):
            for j in range(kernels.shape[2]):
                kernels[n, i, j] = kernel[beyond + i, beyond + j] / total


def rasterize(
    paths: NDArray[np.float64], half_height: int, half_width: int, threads: int | None = None
) -> NDArray[np.float32]:
    """Return the kernels (N, 2 half_height + 1, 2 half_width + 1) of paths by the bilinear window; they sum to 1.

    `paths` (N, T, 2), C-contiguous, are displacements (x, y) in px at T >= 2 evenly spaced times, |x| < `half_width`,
    |y| < `half_height`. The kernel of a path that is not within these bounds, or contains NaN, is NaN.
    """
    fits = np.abs(paths) < (half_width, half_height)
    return _drawn(paths, fits, half_height, half_width, (_HAT, BILINEAR_STEP), 1, threads)


def interpolated(
    paths: NDArray[np.float64],
    half_height: int,
    half_width: int,
    softness: float = 0.0,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Return the kernels (N, 2 half_height + 1, 2 half_width + 1) of paths, drawn by the interpolating window.

    Paths are those of :func:`rasterize`, but end 4 px before the border. `softness` is the standard deviation in px,
    from 0 to 1, of a Gaussian around them. Kernels sum to 1 and have some negative values.
    """
    fits = np.abs(paths) <= (half_width - WIDTH // 2, half_height - WIDTH // 2)
    return _drawn(paths, fits, half_height, half_width, (_sinc_table(softness), MOST_STEP), 0, threads)


def _drawn(
    paths: NDArray[np.float64],
    fits: NDArray[np.bool_],
    half_height: int,
    half_width: int,
    window: tuple[FloatArray, float],
    beyond: int,
    threads: int | None,
) -> NDArray[np.float32]:
    """Return the kernels of paths that fit, under a window, which may reach `beyond` px over their borders."""
    kernels = np.empty((len(paths), 2 * half_height + 1, 2 * half_width + 1), dtype=np.float32)
    given = read_only(paths), fits.all(axis=(1, 2)), *window, beyond, kernels
    share_range(lambda first, stop: _draw(first, stop, *given), len(paths), threads)
    return kernels


def spread(path: NDArray[np.float64], pitches: tuple[float, float], grid: FloatArray) -> float:
    """Spread a path (T, 2), px, of unit energy over a grid of odd size around its centre; return the sum of the grid.

    `pitches` are the grid points per px along y and x. The grid becomes NaN if a displacement is less than half a
    window from the border, or is NaN.
    """
    high, wide = ((n - 1 - WIDTH) / 2 / pitch for n, pitch in zip(grid.shape, pitches, strict=True))
    fits = bool((np.abs(path) <= (wide, high)).all())
    grid[...] = 0 if fits else np.nan
    if fits:
        _spread(path, *pitches, _TABLE, MOST_STEP, grid)
    return float(grid.sum())
