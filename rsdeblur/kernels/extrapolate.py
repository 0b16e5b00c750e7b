"""Extrapolation of an iteration by a share of its last change."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array

# Values that stay in the first-level cache between the sums and the extrapolation.
CHUNK = 2048


@njit(nogil=True, fastmath={"reassoc"})  # sums in any order
def _squares(before, after):
    change = norm = np.float32(0.0)
    for i in range(len(after)):
        step = after[i] - before[i]
        change += step * step
        norm += after[i] * after[i]
    return change, norm


@njit(nogil=True)
def _step(before, after, ahead):
    for i in range(len(after)):
        before[i] = after[i] + ahead * (after[i] - before[i])


@njit(nogil=True)
def _extrapolate(before, after, ahead):
    total = whole = 0.0
    for first in range(0, len(after), CHUNK):
        old, new = before[first : first + CHUNK], after[first : first + CHUNK]
        change, norm = _squares(old, new)
        total += change
        whole += norm
        _step(old, new, ahead)
    return total, whole


def extrapolate(before: Float32Array, after: Float32Array, ahead: np.float32) -> tuple[float, float]:
    """Replace `before` by `after + ahead (after - before)`.

    Parameters
    ----------
    before, after : ndarray, float32, C-contiguous
        Two steps of an iteration, of the same shape.
    ahead : float32
        Share of the change.

    Returns
    -------
    (float, float)
        Sums of the squares of `after - before` and of `after`.
    """
    change, norm = _extrapolate(before.reshape(-1), after.reshape(-1), ahead)
    return float(change), float(norm)
