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
def _kept(squared, threshold, table):
    """Share that is kept of a gradient whose squared magnitude is given."""
    if squared <= threshold * threshold:
        return np.float32(0.0)
    place = threshold / np.sqrt(squared) * np.float32(len(table) - 1)
    i = min(int(place), len(table) - 2)
    return table[i] + (place - np.float32(i)) * (table[i + 1] - table[i])


@njit(nogil=True)
def shrunk_pull(picture, top, rows, threshold, table, periodic, out):
    """Fill `rows` rows of `out` from `top` on with `D^T w`: w is the gradient D of `picture`, shrunk.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32
    top, rows : int
        Rows to fill.
    threshold : float32
        Gradients up to this magnitude vanish.
    table : ndarray, shape (n,), float32
        Share kept of a gradient, at n evenly spaced values of threshold / magnitude from 0 to 1.
    periodic : bool
        Whether the picture repeats.
    out : ndarray, shape (H, W, C), float32
    """
    height, width, channels = picture.shape
    above = np.zeros((width, channels), np.float32)  # vertical part of w in the row before
    left = np.empty(channels, np.float32)  # horizontal part in the pixel before
    for y in range(top - 1, top + rows):
        if y < 0 and not periodic:
            continue
        row = picture[y % height]
        below = picture[(y + 1) % height] if periodic else picture[min(y + 1, height - 1)]
        left[:] = 0.0
        for x in range(width):
            following = (x + 1) % width if periodic else min(x + 1, width - 1)
            squared = np.float32(0.0)
            for c in range(channels):
                across, down = row[following, c] - row[x, c], below[x, c] - row[x, c]
                squared += across * across + down * down
            kept = _kept(squared, threshold, table)
            for c in range(channels):
                across, down = kept * (row[following, c] - row[x, c]), kept * (below[x, c] - row[x, c])
                if y >= top:
                    out[y, x, c] = left[c] - across + above[x, c] - down
                left[c] = across
                above[x, c] = down
        if y >= top:
            for c in range(channels):
                out[y, 0, c] += left[c]  # zero, or what wraps around


def gradient(picture: Real, *, periodic: bool) -> tuple[Real, Real]:
    """Forward differences across and down, both shaped like `picture` (H, W, C)."""
    across, down = (np.roll(picture, -1, axis) - picture for axis in (1, 0))
    if not periodic:
        across[:, -1] = 0
        down[-1] = 0
    return across, down


def shrunk_pull_numpy(
    picture: Real, top: int, rows: int, threshold: float, table: Real, periodic: bool, out: Real
) -> None:
    """Readable twin of :func:`shrunk_pull`."""
    across, down = gradient(picture, periodic=periodic)
    magnitude = np.sqrt((across**2 + down**2).sum(axis=2, keepdims=True))
    places = threshold / np.maximum(magnitude, threshold)
    kept = np.where(magnitude > threshold, np.interp(places, np.linspace(0, 1, len(table)), table), 0.0)
    across, down = kept * across, kept * down
    # What stands in the last row and column is zero unless it wraps around.
    pull = np.roll(across, 1, 1) - across + np.roll(down, 1, 0) - down
    out[top : top + rows] = pull[top : top + rows]
