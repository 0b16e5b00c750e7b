"""Readable NumPy oracles of `rsdeblur.kernels.resample`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.kernels.resample import ORDER
from rsdeblur.kernels.warp import FARTHEST
from rsdeblur.types import FloatImage


def to_spline_numpy(picture: FloatImage) -> None:
    """Readable twin of :func:`to_spline`."""
    for c in range(picture.shape[2]):
        picture[..., c] = ndimage.spline_filter(picture[..., c], ORDER, output=np.float32, mode="mirror")


def sample_numpy(coefficients: FloatImage, x: NDArray[np.float32], y: NDArray[np.float32]) -> FloatImage:
    """Readable twin of :func:`sample`."""
    known = (np.abs(x) < FARTHEST) & (np.abs(y) < FARTHEST)
    places = np.where(known, np.stack([y, x]), 0.0)
    channels = [
        ndimage.map_coordinates(part, places, order=ORDER, mode="mirror", prefilter=False, output=np.float32)
        for part in np.moveaxis(coefficients, -1, 0)
    ]
    values: FloatImage = np.where(known[..., None], np.stack(channels, axis=-1), np.float32(np.nan))
    return values
