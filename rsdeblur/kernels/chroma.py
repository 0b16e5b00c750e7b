"""Brightness of a picture at full size and its colours at half size, and back.

On the way back, each colour is a linear function of the brightness in a small window, as in the guided filter [1]_. The
function is found at half size, where both are known, and evaluated at full size, where the brightness is.

.. [1] K. He and J. Sun, "Fast guided filter", arXiv:1505.00996, 2015.
"""

import numpy as np

from rsdeblur._util.memory import empty
from rsdeblur._util.threads import share
from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array, FloatImage

# Weights of red, green and blue in the brightness: most sensors have two green pixels for each red and blue one.
RED, GREEN, BLUE = (np.float32(weight) for weight in (0.25, 0.5, 0.25))
# Shares of the bright parts. Where the brightness varies by less than the root of the first, colours follow its
# relative change instead of the line through the window. What is much darker than the second counts as grey.
FLAT, DARK = 1e-3, 1e-3
# Most that a colour exceeds the brightness: blue light alone has this ratio. Ringing could lead to larger ones.
MOST_RATIO = np.float32(4.0)
# Instead of zero, for a picture without light.
TINY = np.float32(1e-30)
# Rows of the half-size picture that a thread takes at a time; and so few that their lines stay in the cache.
ROWS, FEW_ROWS = 32, 8


def separate(light: FloatImage, threads: int | None = None) -> tuple[FloatImage, FloatImage]:
    """Return the brightness (H, W, 1) of linear light (H, W, 3), and the picture at half size.

    The latter, of shape (ceil(H / 2), ceil(W / 2), 3), has the means of 2 x 2 pixels; the last row and column of odd
    sizes count twice.
    """
    height, width = light.shape[:2]
    luma, half = empty((height, width, 1), np.float32), empty((-(-height // 2), -(-width // 2), 3), np.float32)
    weights = np.array([RED, GREEN, BLUE])

    def work(_: int, top: int) -> None:
        rows, means = slice(2 * top, 2 * (top + ROWS)), half[top : top + ROWS]
        np.matmul(light[rows], weights, out=luma[rows, :, 0])
        odd = light[rows][1::2]
        pairs = light[rows][::2] + (odd if len(odd) == len(means) else np.concatenate([odd, light[-1:]]))
        # Channel by channel: along so short an axis NumPy takes several times as long.
        for c in range(3):
            np.add(pairs[:, : width // 2 * 2 : 2, c], pairs[:, 1::2, c], out=means[:, : width // 2, c])
        if width % 2:
            means[:, -1] = 2 * pairs[:, -1]
        means *= np.float32(0.25)

    share(work, range(0, len(half), ROWS), threads)
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
def _evaluate(lines, luma, out):
    """Fill rows of a picture (h, W, 3) from lines (h, 6, w + 2), doubled across, and the brightness (h, W, 1)."""
    near, far = np.float32(0.75), np.float32(0.25)
    for y in range(luma.shape[0]):
        for x in range(luma.shape[1]):
            here = x // 2 + 1
            beside = here - 1 + 2 * (x % 2)
            for c in range(3):
                slope = near * lines[y, c, here] + far * lines[y, c, beside]
                offset = near * lines[y, c + 3, here] + far * lines[y, c + 3, beside]
                out[y, x, c] = slope * luma[y, x, 0] + offset


def _doubled_down(lines: Float32Array, rows: slice) -> Float32Array:
    """Return `rows` of lines (h, 6, w), each between two of them, (2 n, 6, w + 2); beyond the borders they go on."""
    around = lines.take(range(rows.start - 1, rows.stop + 1), axis=0, mode="clip")
    near, far = np.float32(0.75) * around[1:-1], np.float32(0.25) * around
    doubled = np.empty((len(near), 2, 6, lines.shape[2] + 2), np.float32)
    np.add(near, far[:-2], out=doubled[:, 0, :, 1:-1])
    np.add(near, far[2:], out=doubled[:, 1, :, 1:-1])
    doubled[..., 0], doubled[..., -1] = doubled[..., 1], doubled[..., -2]
    return doubled.reshape(-1, *doubled.shape[2:])


def join(luma: FloatImage, half: FloatImage, peak: float, out: FloatImage, threads: int | None = None) -> None:
    """Fill `out` (H, W, 3) with a picture that has the brightness `luma` (H, W, 1) and about the colours of `half`.

    `half` is another picture of the scene, of shape (ceil(H / 2), ceil(W / 2), 3); `peak` is the value of the bright
    parts.
    """
    flat, dark = (max(np.float32(share), TINY) for share in (FLAT * peak**2, DARK * peak))
    rows, lines = len(half), empty((half.shape[0], 6, half.shape[1]), np.float32)

    def fit(_: int, top: int) -> None:
        _fit(half, slice(top, min(top + ROWS, rows)), flat, dark, lines)

    def evaluate(_: int, top: int) -> None:
        here = slice(2 * top, 2 * (top + FEW_ROWS))
        _evaluate(_doubled_down(lines, slice(top, min(top + FEW_ROWS, rows))), luma[here], out[here])

    share(fit, range(0, rows, ROWS), threads)
    share(evaluate, range(0, rows, FEW_ROWS), threads)
