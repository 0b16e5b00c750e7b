"""Readable NumPy oracles of `rsdeblur.kernels.undershoot`."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.undershoot import Between
from rsdeblur.types import Float32Array, FloatImage


def depths_numpy(light: FloatImage, step: int, below: Float32Array) -> None:
    """Readable twin of :func:`depths`."""
    depth = -np.minimum(light.min(axis=2), 0)
    tops, lefts = (np.arange(0, n, step) for n in depth.shape)
    areas = np.multiply.outer(*(np.diff([*range(0, n, step), n]) for n in depth.shape))
    below[...] = np.add.reduceat(np.add.reduceat(depth, tops, axis=0), lefts, axis=1) / areas


def fade_to_numpy(sharp: FloatImage, blurred: FloatImage, weight: Float32Array, down: Between, across: Between) -> None:
    """Readable twin of :func:`fade_to`."""
    (above, under, low), (left, right, far) = down, across
    lines = weight[above] + low[:, None] * (weight[under] - weight[above])
    share = lines[:, left] + far * (lines[:, right] - lines[:, left])
    sharp += share[..., None] * (blurred - sharp)
