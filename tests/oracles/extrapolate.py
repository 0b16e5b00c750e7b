"""Readable NumPy oracles of `rsdeblur.kernels.extrapolate`."""

from __future__ import annotations

import numpy as np

from rsdeblur.types import Float32Array


def extrapolate_numpy(before: Float32Array, after: Float32Array, ahead: np.float32) -> tuple[float, float]:
    """Readable twin of :func:`extrapolate`."""
    step = after - before
    before[...] = after + ahead * step
    change, norm = (np.square(values, dtype=np.float64).sum() for values in (step, after))
    return float(change), float(norm)
