"""Readable NumPy oracles of `rsdeblur.kernels.spread`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.raster import GAUSS_HIGH, GAUSS_LOW
from rsdeblur.kernels.spread import _TABLE, MOST_STEP, STEPS, WIDTH, _fits, _sinc_table
from rsdeblur.types import FloatArray


def interpolated_numpy(
    paths: NDArray[np.float64], half_height: int, half_width: int, softness: float = 0.0
) -> NDArray[np.float32]:
    """Readable twin of :func:`interpolated`."""
    grids = np.full((len(paths), 2 * half_height + 1, 2 * half_width + 1), np.nan)
    if _fits(paths, (1.0, 1.0), grids[0]):
        grids[...] = 0
        for path, grid in zip(paths, grids, strict=True):
            _spread_numpy(path, (1.0, 1.0), _sinc_table(softness), grid)
    kernels: NDArray[np.float32] = (grids / grids.sum(axis=(1, 2), keepdims=True)).astype(np.float32)
    return kernels


def spread_numpy(path: NDArray[np.float64], pitches: tuple[float, float], grid: FloatArray) -> float:
    """Readable twin of :func:`spread`: first all Gauss points, then a weighted histogram."""
    grid[...] = 0 if _fits(path, pitches, grid) else np.nan
    if grid[0, 0] == 0:
        _spread_numpy(path, pitches, _TABLE, grid)
    return float(grid.sum())


def _spread_numpy(path: NDArray[np.float64], pitches: tuple[float, float], table: FloatArray, grid: FloatArray) -> None:
    scaled = path * pitches[::-1]
    steps = np.diff(scaled, axis=0)
    parts = np.maximum(np.ceil(np.abs(steps).max(axis=1) / MOST_STEP), 1).astype(int)
    segment = np.repeat(np.arange(len(steps)), parts)
    part = np.arange(len(segment)) - np.repeat(np.cumsum(parts) - parts, parts)
    for gauss in (GAUSS_LOW, GAUSS_HIGH):
        at = scaled[segment] + ((part + gauss) / parts[segment])[:, None] * steps[segment]
        first = np.floor(at).astype(int) - WIDTH // 2 + 1
        place = first[..., None] + np.arange(WIDTH)
        in_x, in_y = np.moveaxis(np.interp(np.abs(place - at[..., None]) * STEPS, np.arange(len(table)), table), 1, 0)
        x, y = np.moveaxis(place, 1, 0)
        energy = 0.5 / parts[segment] / len(steps)
        at_points = y[:, :, None] + grid.shape[0] // 2, x[:, None] + grid.shape[1] // 2
        np.add.at(grid, at_points, energy[:, None, None] * in_y[:, :, None] * in_x[:, None])
