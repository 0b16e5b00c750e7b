"""Readable NumPy oracles of `rsdeblur.kernels.raster`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.raster import GAUSS_HIGH, GAUSS_LOW


def rasterize_numpy(paths: NDArray[np.float64], half_height: int, half_width: int) -> NDArray[np.float32]:
    """Readable twin of :func:`rasterize`: first all grid crossings, then a weighted histogram per kernel."""
    shape = (2 * half_height + 1, 2 * half_width + 1)
    kernels = np.empty((len(paths), *shape), dtype=np.float32)
    centre = np.array([half_width, half_height])
    for kernel, path in zip(kernels, paths + centre, strict=True):
        if not (np.abs(path - centre) < centre).all():
            kernel[:] = np.nan
            continue
        knots = np.arange(len(path), dtype=np.float64)
        breaks = np.unique(np.concatenate([knots, *(_crossings(path[:, axis]) for axis in (0, 1))]))
        start, step = breaks[:-1], np.diff(breaks)
        dense = np.zeros(shape)
        for gauss in (GAUSS_LOW, GAUSS_HIGH):
            x, y = (np.interp(start + gauss * step, knots, path[:, axis]) for axis in (0, 1))
            i, j = np.floor(y).astype(int), np.floor(x).astype(int)
            for di, wy in ((0, 1 - (y - i)), (1, y - i)):
                for dj, wx in ((0, 1 - (x - j)), (1, x - j)):
                    np.add.at(dense, (i + di, j + dj), step * wy * wx)
        kernel[:] = dense / dense.sum()
    return kernels


def _crossings(coordinate: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the path parameters (0 to T - 1) at which a piecewise linear coordinate crosses integers."""
    low, high = np.minimum(coordinate[:-1], coordinate[1:]), np.maximum(coordinate[:-1], coordinate[1:])
    first, last = np.ceil(low).astype(int), np.floor(high).astype(int)
    counts = np.maximum(last - first + 1, 0)
    segment = np.repeat(np.arange(len(counts)), counts)
    rank = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    grid = first[segment] + rank
    velocity = coordinate[segment + 1] - coordinate[segment]
    moving = velocity != 0
    crossings: NDArray[np.float64] = (segment + (grid - coordinate[segment]) / np.where(moving, velocity, 1.0))[moving]
    return crossings
