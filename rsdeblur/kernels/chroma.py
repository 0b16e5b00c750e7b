"""Brightness of a picture at full size and its colours at half size, and back.

On the way back, each colour is a linear function of the brightness in a small window, as in the guided filter [1]_. The
function is found at half size, where both are known, and evaluated at full size, where the brightness is.

.. [1] K. He and J. Sun, "Fast guided filter", arXiv:1505.00996, 2015.
"""

from __future__ import annotations

import numpy as np

from rsdeblur._util.memory import empty
from rsdeblur._util.threads import share
from rsdeblur.kernels._jit import njit
from rsdeblur.types import FloatImage

# Weights of red, green and blue in the brightness: most sensors have two green pixels for each red and blue one.
RED, GREEN, BLUE = (np.float32(weight) for weight in (0.25, 0.5, 0.25))
# Where the brightness varies by less than the root of this, as a share of the picture's bright parts, colours follow
# its relative change instead of the line through the window; and the brightness, as a share of them, of which things
# that are much darker count as grey.
FLAT, DARK = 1e-3, 1e-3
# Most that a colour exceeds the brightness: blue light alone has this ratio. Ringing could lead to larger ones.
MOST_RATIO = np.float32(4.0)
# Instead of zero, for a picture without light.
TINY = np.float32(1e-30)
# Rows of the half-size picture that a thread takes at a time.
ROWS = 32


@njit(nogil=True)
def _separate(light, first, last, luma, half):
    height, width = luma.shape[:2]
    for i in range(first, last):
        top, bottom = 2 * i, min(2 * i + 1, height - 1)
        for y in range(top, bottom + 1):
            for x in range(width):
                luma[y, x, 0] = RED * light[y, x, 0] + GREEN * light[y, x, 1] + BLUE * light[y, x, 2]
        for j in range(half.shape[1]):
            left, right = 2 * j, min(2 * j + 1, width - 1)
            for c in range(3):
                total = light[top, left, c] + light[top, right, c] + light[bottom, left, c] + light[bottom, right, c]
                half[i, j, c] = np.float32(0.25) * total


def separate(light: FloatImage, threads: int | None = None) -> tuple[FloatImage, FloatImage]:
    """Return the brightness (H, W, 1) of linear light (H, W, 3), and the picture at half size.

    The latter, of shape (ceil(H / 2), ceil(W / 2), 3), has the means of 2 x 2 pixels; the last row and column of odd
    sizes count twice.
    """
    height, width = light.shape[:2]
    luma, half = empty((height, width, 1), np.float32), empty((-(-height // 2), -(-width // 2), 3), np.float32)
    tops = range(0, len(half), ROWS)
    share(lambda _, top: _separate(light, top, min(top + ROWS, len(half)), luma, half), tops, threads)
    return luma, half


# Loops over values that lie beside each other, each one named alone, become SIMD code.
@njit(nogil=True)
def _products(half, i, row):
    """Fill the brightness of a row, its square, the colours, and the products of both, shape (8, W)."""
    for j in range(half.shape[1]):
        luma = RED * half[i, j, 0] + GREEN * half[i, j, 1] + BLUE * half[i, j, 2]
        row[0, j], row[1, j] = luma, luma * luma
        for c in range(3):
            row[2 + c, j], row[5 + c, j] = half[i, j, c], luma * half[i, j, c]


@njit(nogil=True)
def _means(above, own, below, sums, means):
    """Fill the means over windows of 3 x 3; the ends of a row count twice."""
    width, ninth = own.shape[1], np.float32(1.0 / 9.0)
    for n in range(len(own)):
        for j in range(width):
            sums[j + 1] = above[n, j] + own[n, j] + below[n, j]
        sums[0], sums[width + 1] = sums[1], sums[width]
        for j in range(width):
            means[n, j] = (sums[j] + sums[j + 1] + sums[j + 2]) * ninth


@njit(nogil=True, error_model="numpy")
def _fit(half, first, last, flat, dark, lines):
    height, width = half.shape[:2]
    zero, one = np.float32(0.0), np.float32(1.0)
    rows, means = np.empty((3, 8, width), np.float32), np.empty((8, width), np.float32)
    sums = np.empty(width + 2, np.float32)
    for i in range(max(first - 1, 0), min(first + 1, height)):
        _products(half, i, rows[i % 3])
    for i in range(first, last):
        if i + 1 < height:
            _products(half, i + 1, rows[(i + 1) % 3])
        own = rows[i % 3]
        _means(rows[max(i - 1, 0) % 3], own, rows[min(i + 1, height - 1) % 3], sums, means)
        for j in range(width):
            mean = means[0, j]
            brighter = one / (max(mean, zero) + dark)
            steeper = one / (max(means[1, j] - mean * mean, zero) + flat)
            for c in range(3):
                colour = means[2 + c, j]
                ratio = min((max(colour, zero) + dark) * brighter, MOST_RATIO)
                slope = (means[5 + c, j] - mean * colour + flat * ratio) * steeper
                lines[i, c, j] = slope
                lines[i, 3 + c, j] = own[2 + c, j] - slope * own[0, j]


@njit(nogil=True)
def _evaluate(lines, luma, first, last, out):
    height, width = lines.shape[0], lines.shape[2]
    near, far = np.float32(0.75), np.float32(0.25)
    row, doubled = np.empty(width + 2, np.float32), np.empty((6, 2 * width), np.float32)
    for y in range(first, last):
        i = y // 2
        other = max(i - 1, 0) if y % 2 == 0 else min(i + 1, height - 1)
        for n in range(6):
            for j in range(width):
                row[j + 1] = near * lines[i, n, j] + far * lines[other, n, j]
            row[0], row[width + 1] = row[1], row[width]
            for j in range(width):
                doubled[n, 2 * j] = near * row[j + 1] + far * row[j]
                doubled[n, 2 * j + 1] = near * row[j + 1] + far * row[j + 2]
        slope, offset, target = doubled[:3], doubled[3:], out[y].reshape(-1)
        for x in range(luma.shape[1]):
            level = luma[y, x, 0]
            target[3 * x] = slope[0, x] * level + offset[0, x]
            target[3 * x + 1] = slope[1, x] * level + offset[1, x]
            target[3 * x + 2] = slope[2, x] * level + offset[2, x]


def join(luma: FloatImage, half: FloatImage, peak: float, out: FloatImage, threads: int | None = None) -> None:
    """Fill `out` (H, W, 3) with a picture that has the brightness `luma` (H, W, 1) and about the colours of `half`.

    `half` is another picture of the scene, of shape (ceil(H / 2), ceil(W / 2), 3); `peak` is the value of the bright
    parts.
    """
    flat, dark = (max(np.float32(share), TINY) for share in (FLAT * peak**2, DARK * peak))
    lines = empty((half.shape[0], 6, half.shape[1]), np.float32)
    tops, lasts = range(0, len(half), ROWS), range(0, len(out), 2 * ROWS)
    share(lambda _, top: _fit(half, top, min(top + ROWS, len(half)), flat, dark, lines), tops, threads)
    share(lambda _, top: _evaluate(lines, luma, top, min(top + 2 * ROWS, len(out)), out), lasts, threads)
