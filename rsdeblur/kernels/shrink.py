"""Shrinking a picture's gradient: the Numba kernel and its NumPy twin.

The gradient is of forward differences, zero across the last row and column or, if `periodic`, wrapping around. A
pixel's gradient, over both directions and all channels, is one vector; it is shortened as a whole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit

Real = NDArray[np.float32]


@njit(nogil=True, inline="always")
def _differ(minuend, subtrahend, out):
    for i in range(len(out)):
        out[i] = minuend[i] - subtrahend[i]


@njit(nogil=True, error_model="numpy")  # a check for division by zero would keep it from being SIMD code
def _keep(across, down, threshold, table, kept):
    """Fill `kept` (W, C) with the share that is kept of the gradient `across`, `down` of each pixel, all (W, C)."""
    width, channels = kept.shape
    least, last = threshold * threshold, np.float32(len(table) - 1)
    following = table[1:]
    for x in range(width):
        squared = np.float32(0.0)
        for c in range(channels):
            squared += across[x, c] * across[x, c] + down[x, c] * down[x, c]
        kept[x, 0] = squared
    for x in range(width):
        place = last * (threshold / np.sqrt(max(kept[x, 0], least)))
        i = min(np.int32(place), np.int32(len(following) - 1))
        share = table[i] + (place - np.float32(i)) * (following[i] - table[i])
        kept[x, 0] = share if kept[x, 0] > least else np.float32(0.0)
    for x in range(width):
        for c in range(1, channels):
            kept[x, c] = kept[x, 0]


@njit(nogil=True)
def _scale(values, factors):
    for i in range(len(values)):
        values[i] *= factors[i]


@njit(nogil=True)
def _pull(before, across, above, down, out):
    for i in range(len(out)):
        out[i] = before[i] - across[i] + above[i] - down[i]


@njit(nogil=True)
def shrunk_grad_adjoint(picture, top, rows, threshold, table, periodic, out):
    """Fill `rows` rows of `out` from `top` on with `D^T w`: w is the gradient D of `picture`, shrunk.

    Loops run over whole rows without branches or computed indices, so that they become SIMD code.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32, C-contiguous
    top, rows : int
        Rows to fill.
    threshold : float32
        Gradients up to this magnitude vanish.
    table : ndarray, shape (n,), float32
        Share kept of a gradient, at n evenly spaced values of threshold / magnitude from 0 to 1.
    periodic : bool
        Whether the picture repeats.
    out : ndarray, shape (H, W, C), float32, C-contiguous
    """
    height, width, channels = picture.shape
    n = width * channels
    values, pulls = picture.reshape(height, n), out.reshape(height, n)
    above, down = np.zeros(n, np.float32), np.empty(n, np.float32)  # vertical part of w in the row before and in this
    across = np.zeros(n + channels, np.float32)  # horizontal part, a pixel later: first what the last hands on
    kept = np.empty((width, channels), np.float32)
    for y in range(top - 1, top + rows):
        if y < 0 and not periodic:
            continue
        row = values[y % height]
        below = values[(y + 1) % height] if periodic else values[min(y + 1, height - 1)]
        _differ(row[channels:], row[: n - channels], across[channels:n])
        if periodic:
            _differ(row[:channels], row[n - channels :], across[n:])
        _differ(below, row, down)
        here = across[channels:]
        _keep(here.reshape(width, channels), down.reshape(width, channels), threshold, table, kept)
        _scale(here, kept.reshape(n))
        _scale(down, kept.reshape(n))
        if y >= top:
            across[:channels] = across[n:]
            _pull(across[:n], here, above, down, pulls[y])
        above, down = down, above


def gradient(picture: Real, *, periodic: bool) -> tuple[Real, Real]:
    """Forward differences across and down, both shaped like `picture` (H, W, C)."""
    across, down = (np.roll(picture, -1, axis) - picture for axis in (1, 0))
    if not periodic:
        across[:, -1] = 0
        down[-1] = 0
    return across, down


def shrunk_grad_adjoint_numpy(
    picture: Real, top: int, rows: int, threshold: float, table: Real, periodic: bool, out: Real
) -> None:
    """Readable twin of :func:`shrunk_grad_adjoint`."""
    across, down = gradient(picture, periodic=periodic)
    magnitude = np.sqrt((across**2 + down**2).sum(axis=2, keepdims=True))
    places = threshold / np.maximum(magnitude, threshold)
    kept = np.where(magnitude > threshold, np.interp(places, np.linspace(0, 1, len(table)), table), 0.0)
    across, down = kept * across, kept * down
    # What stands in the last row and column is zero unless it wraps around.
    grad_adjoint = np.roll(across, 1, 1) - across + np.roll(down, 1, 0) - down
    out[top : top + rows] = grad_adjoint[top : top + rows]
