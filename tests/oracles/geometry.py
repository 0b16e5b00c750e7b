"""Readable NumPy oracles of kernels: paths, PSFs and resampling."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.kernels.raster import GAUSS_HIGH, GAUSS_LOW
from rsdeblur.kernels.resample import FARTHEST, ORDER
from rsdeblur.types import FloatArray, FloatImage


def row_directions_numpy(world: FloatArray, rows: FloatArray, matrices: FloatArray) -> FloatArray:
    place = np.clip(np.nan_to_num(rows, nan=-np.inf) + len(matrices) // 4, 0.0, len(matrices) - 1.0)
    i = np.minimum(place.astype(np.intp), len(matrices) - 2)
    pose = matrices[i] + (place - i)[..., None] * (matrices[i + 1] - matrices[i])
    pose = pose.reshape(*rows.shape, 3, 4)
    directions: FloatArray = np.einsum("...ij,...j->...i", pose[..., :3], world) + pose[..., 3]
    return directions


def pinhole_paths_numpy(
    orientation: FloatArray,
    position: FloatArray,
    scene: FloatArray,
    rows: FloatArray,
    cols: FloatArray,
    matrices: FloatArray,
    pinhole: tuple[float, float, float, float],
    steps: int,
) -> FloatArray:
    world = np.einsum("btji,bsj->bsti", orientation, scene) + position[:, None]
    points = np.stack(np.meshgrid(cols, rows), axis=-1)[:, :, None]
    pixels = np.broadcast_to(points, (*world.shape[:-1], 2))
    for _ in range(steps):
        seen = row_directions_numpy(world, pixels[..., 1], matrices)
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        pixels = seen[..., :2] / depth * pinhole[:2] + pinhole[2:]
    displacements: FloatArray = points - pixels
    return displacements


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


def sample_numpy(coefficients: FloatImage, x: NDArray[np.float32], y: NDArray[np.float32]) -> FloatImage:
    known = (np.abs(x) < FARTHEST) & (np.abs(y) < FARTHEST)
    places = np.where(known, np.stack([y, x]), 0.0)
    channels = [
        ndimage.map_coordinates(part, places, order=ORDER, mode="mirror", prefilter=False, output=np.float32)
        for part in np.moveaxis(coefficients, -1, 0)
    ]
    values: FloatImage = np.where(known[..., None], np.stack(channels, axis=-1), np.float32(np.nan))
    return values


def average_warps_numpy(
    coefficients: NDArray[np.float32], warps: NDArray[np.float64], width: int
) -> NDArray[np.float32]:
    height, samples = warps.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float64)
    total = np.zeros((height, width, coefficients.shape[2]))
    for t in range(samples):
        qx, qy, w = np.einsum("yij,jyx->iyx", warps[:, t], np.stack([x, y, np.ones_like(x)]))
        with np.errstate(all="ignore"):
            place = np.stack([qy, qx]) / w
        known = (np.abs(place) < FARTHEST).all(axis=0)
        for c in range(total.shape[2]):
            values = ndimage.map_coordinates(
                coefficients[..., c], np.where(known, place, 0.0), order=3, mode="mirror", prefilter=False
            )
            total[..., c] += np.where(known, values, np.nan)
    mean: NDArray[np.float32] = (total / samples).astype(np.float32)
    return mean
