"""Readable NumPy oracles of `rsdeblur.kernels.warp`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.kernels.warp import FARTHEST


def average_warps_numpy(
    coefficients: NDArray[np.float32], warps: NDArray[np.float64], width: int
) -> NDArray[np.float32]:
    """Readable twin of :func:`average_warps`."""
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
