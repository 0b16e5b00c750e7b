"""Averaging a picture over projective warps, row by row.

The picture is given as cubic B-spline coefficients (``scipy.ndimage.spline_filter``, ``mode="mirror"``), so that
interpolation costs no visible sharpness. Beyond its edges it is mirrored.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit

# Largest coordinate in px that is mirrored into the picture; beyond, and for NaN, the average is NaN.
FARTHEST = 2.0**31


@njit(nogil=True, inline="always")
def _spline_weights(f, out):
    g = 1.0 - f
    out[0] = g * g * g / 6.0
    out[1] = 2.0 / 3.0 - 0.5 * f * f * (2.0 - f)
    out[2] = 2.0 / 3.0 - 0.5 * g * g * (2.0 - g)
    out[3] = f * f * f / 6.0


@njit(nogil=True, inline="always")
def _mirror(i, n):
    if n == 1:
        return 0
    period = 2 * n - 2
    i = abs(i) % period
    return period - i if i >= n else i


# All of fastmath but what assumes that there are neither NaN nor infinity.
@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "arcp", "nsz"})
def _average_warps(first, stop, coefficients, warps, out, per_pixel):
    """Fill the rows `first` to `stop` - 1 of `out`; `per_pixel` is a tuple with one item for each channel.

    The compiler knows the length of a tuple, so that loops over channels are unrolled.
    """
    height, width = coefficients.shape[:2]
    channels, samples = len(per_pixel), warps.shape[1]
    rows = coefficients.reshape(height, width * channels)
    wx, wy = np.empty(4, np.float32), np.empty(4, np.float32)
    value, sums = np.empty(channels, np.float32), np.empty(4 * channels, np.float32)
    for y in range(first, stop):
        for x in range(out.shape[1]):
            value[:] = np.float32(0.0)
            for t in range(samples):
                m = warps[y, t]
                w = 1.0 / (m[2, 0] * x + m[2, 1] * y + m[2, 2])
                qx = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) * w
                qy = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) * w
                if not (abs(qx) < FARTHEST and abs(qy) < FARTHEST):
                    value[:] = np.float32(np.nan)
                    break
                i0, j0 = int(np.floor(qy)), int(np.floor(qx))
                _spline_weights(np.float32(qx - j0), wx)
                _spline_weights(np.float32(qy - i0), wy)
                if 1 <= i0 < height - 2 and 1 <= j0 < width - 2:
                    r0, r1, r2, r3 = rows[i0 - 1], rows[i0], rows[i0 + 1], rows[i0 + 2]
                    for k in range(4 * channels):
                        n = (j0 - 1) * channels + k
                        sums[k] = (wy[0] * r0[n] + wy[1] * r1[n]) + (wy[2] * r2[n] + wy[3] * r3[n])
                else:
                    for k in range(4 * channels):
                        sums[k] = np.float32(0.0)
                    for a in range(4):
                        row = rows[_mirror(i0 - 1 + a, height)]
                        for b in range(4):
                            n = _mirror(j0 - 1 + b, width) * channels
                            for c in range(channels):
                                sums[b * channels + c] += wy[a] * row[n + c]
                for b in range(4):
                    for c in range(channels):
                        value[c] += wx[b] * sums[b * channels + c]
            for c in range(channels):
                out[y, x, c] = value[c] / samples


def average_warps(
    coefficients: NDArray[np.float32], warps: NDArray[np.float64], width: int, threads: int | None = None
) -> NDArray[np.float32]:
    """Return the mean over t of the picture warped by `warps[y, t]`, for every output row y, shape (H, width, C).

    `coefficients` (h, w, C) are those of the picture's cubic spline, `warps` (H, T, 3, 3) homographies from output
    pixels (x, y, 1) to picture coordinates. The result is NaN where a warp leads nowhere.
    """
    channels = coefficients.shape[2]
    out = np.empty((len(warps), width, channels), dtype=np.float32)
    per_pixel = (0,) * channels
    share_range(lambda first, stop: _average_warps(first, stop, coefficients, warps, out, per_pixel), len(out), threads)
    return out
