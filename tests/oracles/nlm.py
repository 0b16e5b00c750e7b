"""Readable NumPy oracles of `rsdeblur.kernels.nlm`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from rsdeblur.kernels.nlm import PATCH, WINDOW
from rsdeblur.types import Float32Array


def average_alike_numpy(
    planes: Float32Array, variance: float, softness: float, work: Float32Array, out: NDArray[np.float32]
) -> None:
    """Readable twin of :func:`average_alike`."""
    height, width = out.shape[1:]
    around = slice(WINDOW, WINDOW + height + 2 * PATCH), slice(WINDOW, WINDOW + width + 2 * PATCH)
    here = planes[:, *around]
    out[...] = 0
    for down in range(-WINDOW, WINDOW + 1):
        for across in range(-WINDOW, WINDOW + 1):
            there = np.roll(planes, (-down, -across), (1, 2))[:, *around]
            alike = uniform_filter(np.square(here - there).mean(axis=0), 2 * PATCH + 1)
            distance = alike[PATCH:-PATCH, PATCH:-PATCH]
            weights = (1 - (distance - 2 * variance).clip(0) / softness / 8).clip(0) ** 8
            out[:-1] += weights * there[:, PATCH:-PATCH, PATCH:-PATCH]
            out[-1] += weights
    out[:-1] /= out[-1]
