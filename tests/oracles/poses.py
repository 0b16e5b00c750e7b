"""Readable NumPy oracles of `rsdeblur.kernels.poses`."""

from __future__ import annotations

import numpy as np

from rsdeblur.types import FloatArray


def row_directions_numpy(world: FloatArray, rows: FloatArray, matrices: FloatArray) -> FloatArray:
    """Readable twin of :func:`row_directions`."""
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
    """Readable twin of :func:`pinhole_paths`."""
    world = np.einsum("btji,bsj->bsti", orientation, scene) + position[:, None]
    points = np.stack(np.meshgrid(cols, rows), axis=-1)[:, :, None]
    pixels = np.broadcast_to(points, (*world.shape[:-1], 2))
    for _ in range(steps):
        seen = row_directions_numpy(world, pixels[..., 1], matrices)
        depth = np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        pixels = seen[..., :2] / depth * pinhole[:2] + pinhole[2:]
    displacements: FloatArray = points - pixels
    return displacements
