"""Shrinkage of a picture's gradient: the Numba kernel and its NumPy twin.

The gradient consists of forward differences. Beyond the last row and column they are zero or, if `periodic`, wrap
around. The gradient of a pixel, over both directions and all channels, is one vector, which is shortened as a whole.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array


@njit(nogil=True, inline="always")
def _differ(minuend, subtrahend, out):
    for i in range(len(out)):
        out[i] = minuend[i] - subtrahend[i]


@njit(nogil=True, error_model="numpy")  # a check for division by zero would prevent SIMD code
def _fill_factors(across, down, threshold, table, factors):
    """Compute the factors by which the gradients `across`, `down` of pixels are shortened; all arrays are (W, C)."""
    width, channels = factors.shape
    least, last = threshold * threshold, np.float32(len(table) - 1)
    following = table[1:]
    for x in range(width):
        squared = np.float32(0.0)
        for c in range(channels):
            squared += across[x, c] * across[x, c] + down[x, c] * down[x, c]
        factors[x, 0] = squared
    for x in range(width):
        place = last * (threshold / np.sqrt(max(factors[x, 0], least)))
        # A comparison with NaN is false, so that NaN is read at 0; of NaN or infinity no integer would be in the table.
        place = place if np.float32(0.0) <= place <= last else np.float32(0.0)
        i = min(np.int32(place), np.int32(len(following) - 1))
        share = table[i] + (place - np.float32(i)) * (following[i] - table[i])
        factors[x, 0] = share if factors[x, 0] > least else np.float32(0.0)
    for x in range(width):
        for c in range(1, channels):
            factors[x, c] = factors[x, 0]


@njit(nogil=True)
def _scale(values, factors):
    for i in range(len(values)):
        values[i] *= factors[i]


@njit(nogil=True)
def _grad_adjoint(before, across, above, down, out):
    for i in range(len(out)):
        out[i] = before[i] - across[i] + above[i] - down[i]


@njit(nogil=True)
def shrunk_grad_adjoint(picture, top, rows, threshold, table, periodic, out):
    """Compute `D^T w`, where w is the shrunk gradient of `picture` and D takes the gradient.

    Loops run over whole rows, without branches or computed indices, so that they become SIMD code.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32, C-contiguous
        Values whose gradient is shrunk.
    top, rows : int
        First row to compute, and number of rows.
    threshold : float32
        Gradients up to this magnitude become 0.
    table : ndarray, shape (n,), float32
        Factors by which gradients are shortened, at n evenly spaced values of threshold / magnitude from 0 to 1.
    periodic : bool
        Whether differences wrap around.
    out : ndarray, shape (H, W, C), float32, C-contiguous
        Output; only these rows are written.
    """
    height, width, channels = picture.shape
    n = width * channels
    values, adjoint = picture.reshape(height, n), out.reshape(height, n)
    # Vertical part of w, in the previous and in the current row.
    above, down = np.zeros(n, np.float32), np.empty(n, np.float32)
    # Horizontal part of w, shifted by one pixel: it begins with the pixel before the first one.
    across = np.zeros(n + channels, np.float32)
    factors = np.empty((width, channels), np.float32)
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
        _fill_factors(here.reshape(width, channels), down.reshape(width, channels), threshold, table, factors)
        _scale(here, factors.reshape(n))
        _scale(down, factors.reshape(n))
        if y >= top:
            # A loop: an assignment of arrays, with its error message, takes Numba seconds more to compile.
            for c in range(channels):
                across[c] = across[n + c]
            _grad_adjoint(across[:n], here, above, down, adjoint[y])
        above, down = down, above


def gradient(picture: Float32Array, *, periodic: bool) -> tuple[Float32Array, Float32Array]:
    """Return the forward differences across and down, both shaped like `picture` (H, W, C)."""
    across, down = (np.roll(picture, -1, axis) - picture for axis in (1, 0))
    if not periodic:
        across[:, -1] = 0
        down[-1] = 0
    return across, down


def shrunk_grad_adjoint_numpy(
    picture: Float32Array, top: int, rows: int, threshold: float, table: Float32Array, periodic: bool, out: Float32Array
) -> None:
    """Readable twin of :func:`shrunk_grad_adjoint`."""
    across, down = gradient(picture, periodic=periodic)
    magnitude = np.sqrt((across**2 + down**2).sum(axis=2, keepdims=True))
    places = threshold / np.maximum(magnitude, threshold)
    factors = np.where(magnitude > threshold, np.interp(places, np.linspace(0, 1, len(table)), table), 0.0)
    across, down = factors * across, factors * down
    # Rolling is correct without wrapping around too: differences in the last row and column are then zero.
    grad_adjoint = np.roll(across, 1, 1) - across + np.roll(down, 1, 0) - down
    out[top : top + rows] = grad_adjoint[top : top + rows]
