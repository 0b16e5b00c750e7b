"""Readable NumPy oracles of `rsdeblur.kernels.tone`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.tone import END, GAMMA, OFFSET, SCALE, SLOPE, Stored
from rsdeblur.types import Float32Array


def look_up_numpy(table: Float32Array, values: Stored, light: Float32Array) -> None:
    """Readable twin of :func:`look_up`."""
    light[...] = table[values]


def to_srgb_levels_numpy(light: Float32Array, dtype: np.dtype[Any]) -> tuple[NDArray[Any], bool]:
    """Readable twin of :func:`to_srgb_levels`."""
    values = np.nan_to_num(to_srgb_numpy(light)).clip(0.0, 1.0) * np.float32(np.iinfo(dtype).max)
    return np.rint(values).astype(dtype), bool(np.isfinite(light).all())


def to_srgb_numpy(light: Float32Array) -> Float32Array:
    """Readable twin of :func:`to_srgb`."""
    magnitude = np.abs(light)
    values = np.where(magnitude <= END, magnitude * SLOPE, magnitude ** np.float32(1 / GAMMA) * SCALE - OFFSET)
    encoded: Float32Array = np.copysign(values, light)
    return encoded
