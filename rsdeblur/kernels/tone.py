"""Tone curve of sRGB, from linear light to encoded values: the Numba kernel and its NumPy twin."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array

# IEC 61966-2-1: light up to END is multiplied by SLOPE; above, the curve is SCALE light^(1 / GAMMA) - OFFSET.
END, SLOPE, SCALE, OFFSET = map(np.float32, (0.0031308, 12.92, 1.055, 0.055))
GAMMA = 2.4


# NumPy's vectorised power is several times as fast as Numba's; to choose between both parts of the curve, it is slower.
@njit(nogil=True)
def _choose(light, values):
    for i in range(len(light)):
        magnitude = abs(light[i])
        value = magnitude * SLOPE if magnitude <= END else values[i] * SCALE - OFFSET
        values[i] = np.copysign(value, light[i])


def to_srgb(light: Float32Array) -> Float32Array:
    """Return encoded values of linear light; negative light keeps its sign.

    Parameters
    ----------
    light : ndarray, float32, C-contiguous
        Linear light of any shape, nominal range [0, 1].
    """
    values = np.abs(light, out=np.empty_like(light))
    np.power(values, np.float32(1 / GAMMA), out=values)
    _choose(light.reshape(-1), values.reshape(-1))
    return values


def to_srgb_numpy(light: Float32Array) -> Float32Array:
    """Readable twin of :func:`to_srgb`."""
    magnitude = np.abs(light)
    values = np.where(magnitude <= END, magnitude * SLOPE, magnitude ** np.float32(1 / GAMMA) * SCALE - OFFSET)
    encoded: Float32Array = np.copysign(values, light)
    return encoded
