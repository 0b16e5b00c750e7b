"""Rasterising displacement paths into PSFs.

Both integrate a path of unit energy exactly. All segments between two samples have the same energy, spread evenly over
time. Each point of the path contributes to its four neighbouring pixels with bilinear weights. Along a segment, inside
one pixel cell, those weights are quadratic in time, so two Gauss points integrate them without error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit, read_only

# Two-point Gauss-Legendre nodes on [0, 1].
GAUSS_LOW = 0.5 - 0.5 / 3.0**0.5
GAUSS_HIGH = 0.5 + 0.5 / 3.0**0.5


@njit(nogil=True, error_model="numpy", inline="always")
def _cell(position, cells):
    """Return the cell, 0 to `cells` - 1, that contains a position, or the nearest one; 0 for NaN."""
    if position >= cells:
        return cells - 1
    return int(position) if position > 0.0 else 0


@njit(nogil=True, error_model="numpy", inline="always")
def _splat(kernel, x, y, weight):
    # Rounding may lead a path just beyond the last cell.
    i, j = _cell(y, kernel.shape[0] - 1), _cell(x, kernel.shape[1] - 1)
    fy, fx = y - i, x - j
    kernel[i, j] += weight * (1.0 - fy) * (1.0 - fx)
    kernel[i, j + 1] += weight * (1.0 - fy) * fx
    kernel[i + 1, j] += weight * fy * (1.0 - fx)
    kernel[i + 1, j + 1] += weight * fy * fx


@njit(nogil=True, error_model="numpy", inline="always")
def _next_crossing(position, velocity):
    """Return the time until a coordinate reaches the next integer; infinity where it does not move."""
    if velocity > 0.0:
        return (np.floor(position) + 1.0 - position) / velocity
    if velocity < 0.0:
        return (np.ceil(position) - 1.0 - position) / velocity
    return np.inf


@njit(nogil=True, error_model="numpy")
def _trace(kernel, path, centre_x, centre_y):
    segments = path.shape[0] - 1
    for k in range(segments):
        x0, y0 = path[k, 0] + centre_x, path[k, 1] + centre_y
        vx, vy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        t = 0.0
        while t < 1.0:
            x, y = x0 + t * vx, y0 + t * vy
            step = min(_next_crossing(x, vx), _next_crossing(y, vy), 1.0 - t)
            # Rounding may leave t just before a grid line; this keeps the step above 0.
            step = max(step, 1e-9)
            weight = 0.5 * step / segments
            for gauss in (GAUSS_LOW, GAUSS_HIGH):
                _splat(kernel, x + gauss * step * vx, y + gauss * step * vy, weight)
            t += step


@njit(nogil=True, error_model="numpy")
def _fits(path, half_width, half_height):
    fits = True
    for k in range(path.shape[0]):
        fits = fits and abs(path[k, 0]) < half_width and abs(path[k, 1]) < half_height
    return fits


@njit(nogil=True, error_model="numpy")
def _rasterize(first, stop, paths, kernels):
    half_height, half_width = kernels.shape[1] // 2, kernels.shape[2] // 2
    for n in range(first, stop):
        kernel = np.zeros(kernels.shape[1:], dtype=np.float64)
        if _fits(paths[n], half_width, half_height):
            _trace(kernel, paths[n], half_width, half_height)
        else:
            kernel[0, 0] = np.nan
        total = kernel.sum()
        # A loop over cells: an assignment of arrays, with its error message, takes Numba four seconds more to compile.
        for i in range(kernel.shape[0]):
            for j in range(kernel.shape[1]):
                kernels[n, i, j] = kernel[i, j] / total


def rasterize(
    paths: NDArray[np.float64], half_height: int, half_width: int, threads: int | None = None
) -> NDArray[np.float32]:
    """Return the kernels (N, 2 half_height + 1, 2 half_width + 1) of paths; they sum to 1.

    `paths` (N, T, 2), C-contiguous, are displacements (x, y) in px at T >= 2 evenly spaced times, |x| < `half_width`,
    |y| < `half_height`. The kernel of a path that is not within these bounds, or contains NaN, is NaN.
    """
    kernels = np.empty((len(paths), 2 * half_height + 1, 2 * half_width + 1), dtype=np.float32)
    paths = read_only(paths)
    share_range(lambda first, stop: _rasterize(first, stop, paths, kernels), len(paths), threads)
    return kernels
