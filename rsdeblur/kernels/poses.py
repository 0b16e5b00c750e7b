"""Directions of points from the camera's poses at the rows of a picture: the Numba kernel and its NumPy twin."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import FloatArray


@njit(nogil=True)
def _row_directions(world, rows, matrices, out):
    half, last = len(matrices) // 4, len(matrices) - 1
    for n in range(len(rows)):
        # A comparison with NaN is false, so that NaN is taken for the first row.
        place = rows[n] + half if rows[n] + half > 0.0 else 0.0
        place = min(place, float(last))
        i = min(int(place), last - 1)
        share = place - i
        for k in range(3):
            direction = 0.0
            for j in range(4):
                low, high = matrices[i, 4 * k + j], matrices[i + 1, 4 * k + j]
                direction += (low + share * (high - low)) * (world[n, j] if j < 3 else 1.0)
            out[n, k] = direction


def row_directions(world: FloatArray, rows: FloatArray, matrices: FloatArray) -> FloatArray:
    """Return the directions of points in camera axes, each from the pose of a row.

    Parameters
    ----------
    world : ndarray, shape (..., 3)
        Points or directions in world axes; NaN where there is none, and then in the result.
    rows : ndarray, shape (...)
        Rows; poses are interpolated linearly between them. Beyond the first and last ones, and for NaN, these count.
    matrices : ndarray, shape (2 H, 12)
        Poses `[C | -C P]` of the rows from -H/2 on.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    out = np.empty((rows.size, 3))
    _row_directions(read_only(world.reshape(-1, 3)), read_only(rows.ravel()), read_only(matrices), out)
    return out.reshape(*rows.shape, 3)


def row_directions_numpy(world: FloatArray, rows: FloatArray, matrices: FloatArray) -> FloatArray:
    """Readable twin of :func:`row_directions`."""
    place = np.clip(np.nan_to_num(rows, nan=-np.inf) + len(matrices) // 4, 0.0, len(matrices) - 1.0)
    i = np.minimum(place.astype(np.intp), len(matrices) - 2)
    pose = matrices[i] + (place - i)[..., None] * (matrices[i + 1] - matrices[i])
    pose = pose.reshape(*rows.shape, 3, 4)
    directions: FloatArray = np.einsum("...ij,...j->...i", pose[..., :3], world) + pose[..., 3]
    return directions
