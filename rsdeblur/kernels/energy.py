"""Energy of the gradient of a picture at half its size.

A pixel at half the size is the mean of 2 x 2 pixels; an odd last row or column is left out.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import Float32Array


@njit(nogil=True)
def _halve(above, below, out):
    quarter = np.float32(0.25)
    for x in range(len(out)):
        for c in range(out.shape[1]):
            out[x, c] = quarter * (above[2 * x, c] + below[2 * x, c] + above[2 * x + 1, c] + below[2 * x + 1, c])


@njit(nogil=True, fastmath={"reassoc"})  # sums in any order
def _squared_difference(first, second):
    total = 0.0
    for i in range(len(first)):
        difference = np.float64(second[i] - first[i])
        total += difference * difference
    return total


@njit(nogil=True, error_model="numpy")
def _energy(light):
    height, width, channels = light.shape[0] // 2, light.shape[1] // 2, light.shape[2]
    rows, total = np.empty((2, width, channels), np.float32), 0.0
    for y in range(height):
        _halve(light[2 * y], light[2 * y + 1], rows[y % 2])
        here, before = rows[y % 2].reshape(-1), rows[(y + 1) % 2].reshape(-1)
        total += _squared_difference(here[:-channels], here[channels:])
        if y > 0:
            total += _squared_difference(before, here)
    return total / (height * width)


def halved_gradient_energy(light: Float32Array) -> float:
    """Return the mean squared gradient of linear light (H, W, C) at half its size, of both directions and all channels.

    They are added up. The last column has no difference across, and the last row none down. H and W are at least 2.
    """
    return float(_energy(read_only(light)))
