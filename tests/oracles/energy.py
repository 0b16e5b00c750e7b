"""Readable NumPy oracles of `rsdeblur.kernels.energy`."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.energy import QUARTER
from rsdeblur.types import Float32Array


def halved_gradient_energy_numpy(light: Float32Array) -> float:
    """Readable twin of :func:`halved_gradient_energy`."""
    height, width = (n - n % 2 for n in light.shape[:2])
    even = light[:height, :width]
    halved = QUARTER * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
    squares = sum(np.square(np.diff(halved, axis=axis), dtype=np.float64).sum() for axis in (0, 1))
    return float(squares / (halved.shape[0] * halved.shape[1]))
