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
from rsdeblur.types import Float32Array, FloatImage

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


def _fit(half: FloatImage, rows: slice, flat: np.float32, dark: np.float32, lines: Float32Array) -> None:
    """Fill `rows` of `lines` (h, 6, w): slopes and offsets of the lines through windows of 3 x 3 pixels."""
    # Borders count twice.
    near = half.take(range(rows.start - 1, rows.stop + 1), axis=0, mode="clip").transpose(2, 0, 1)
    colours = np.ascontiguousarray(near)
    own = RED * colours[:1] + GREEN * colours[1:2] + BLUE * colours[2:]
    values = np.concatenate([own, own * own, colours, own * colours])
    sums = values[:, :-2] + values[:, 1:-1]
    sums += values[:, 2:]
    means = sums.copy()
    means[..., 1:] += sums[..., :-1]
    means[..., :-1] += sums[..., 1:]
    means[..., 0] += sums[..., 0]
    means[..., -1] += sums[..., -1]
    means *= np.float32(1.0 / 9.0)
    mean, square, colour, product = means[:1], means[1:2], means[2:5], means[5:]
    slope, offset = lines[rows, :3].transpose(1, 0, 2), lines[rows, 3:].transpose(1, 0, 2)
    ratio = np.minimum((np.maximum(colour, 0) + dark) / (np.maximum(mean, 0) + dark), MOST_RATIO)
    np.divide(product - mean * colour + flat * ratio, np.maximum(square - mean * mean, 0) + flat, out=slope)
    np.subtract(colours[:, 1:-1], slope * own[:, 1:-1], out=offset)


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
    share(lambda _, top: _fit(half, slice(top, min(top + ROWS, len(half))), flat, dark, lines), tops, threads)
    share(lambda _, top: _evaluate(lines, luma, top, min(top + 2 * ROWS, len(out)), out), lasts, threads)
