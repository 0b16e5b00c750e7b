"""Pictures between their pixels: values of a spline there, and averages over projective warps.

A picture is given as B-spline coefficients, quintic ones for values and cubic ones for averages
(``scipy.ndimage.spline_filter``, ``mode="mirror"``), so that interpolation costs no visible sharpness. Beyond its edges
it is mirrored.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit
from rsdeblur.types import FloatImage

# Largest coordinate in px that is mirrored into the picture; beyond, and for NaN, the average is NaN.
FARTHEST: Final = 2.0**31
# Order of the interpolating splines. Cubic ones cost pixel-sharp pictures 0.4 dB more, windowed sincs of 6 and 8 pixels
# 0.3 to 1 dB (rectify, three simulated captures).
ORDER: Final = 5
# Poles of the filter from pixels to coefficients: roots of z^4 + 26 z^3 + 66 z^2 + 26 z + 1 within the unit circle.
POLES: Final = (np.float32(-0.43057534709997825), np.float32(-0.043096288203264653))
# Values of a row that are filtered along the columns together, and rows that are filtered together.
BLOCK: Final = 256
TOGETHER: Final = 16
# All of fastmath but what assumes that there are neither NaN nor infinity.
FAST: Final = {"reassoc", "contract", "arcp", "nsz"}


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


@njit(nogil=True, error_model="numpy", fastmath=FAST)
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


@njit(nogil=True, error_model="numpy", fastmath=FAST, inline="always")
def _outer_weights(t):
    """Return the weights of the three coefficients beyond a place, farthest first, `t` px above the one below it."""
    # Sums of truncated powers: Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing
    # Magazine 16 (1999).
    outer, near, inner = t**5, (np.float32(1.0) + t) ** 5, (np.float32(2.0) + t) ** 5
    return (
        outer / np.float32(120.0),
        (near - np.float32(6.0) * outer) / np.float32(120.0),
        (inner - np.float32(6.0) * near + np.float32(15.0) * outer) / np.float32(120.0),
    )


@njit(nogil=True, error_model="numpy", fastmath=FAST)
def _fill_weights(places, first, weights):
    """Compute the first of the six coefficients that each place depends on, and their weights (6, n)."""
    for s in range(len(places)):
        # Comparisons with NaN are false.
        place = places[s] if abs(places[s]) < FARTHEST else np.float32(0.0)
        below = np.floor(place)
        first[s] = np.int64(below) - 2
        t = place - below
        weights[5, s], weights[4, s], weights[3, s] = _outer_weights(t)
        weights[0, s], weights[1, s], weights[2, s] = _outer_weights(np.float32(1.0) - t)


@njit(nogil=True, error_model="numpy", fastmath=FAST)
def _sample(first, stop, coefficients, x, y, out, per_pixel):
    """Fill the rows `first` to `stop` - 1 of `out`; `per_pixel` is a tuple with one item for each channel.

    The compiler knows the length of a tuple, so that loops over a few values become SIMD code without a remainder.
    """
    height, width = coefficients.shape[:2]
    channels = len(per_pixel)
    rows = coefficients.reshape(height, width * channels)
    samples = out.shape[1]
    left, top = np.empty(samples, np.int64), np.empty(samples, np.int64)
    across, down = np.empty((6, samples), np.float32), np.empty((6, samples), np.float32)
    # Sums over the six rows, of all channels of the six columns.
    sums = np.empty(6 * channels, np.float32)
    for r in range(first, stop):
        _fill_weights(x[r], left, across)
        _fill_weights(y[r], top, down)
        for s in range(samples):
            i, j = top[s], left[s]
            w0, w1, w2, w3, w4, w5 = down[0, s], down[1, s], down[2, s], down[3, s], down[4, s], down[5, s]
            if 0 <= i < height - 5 and 0 <= j < width - 5:
                r0, r1, r2, r3, r4, r5 = rows[i], rows[i + 1], rows[i + 2], rows[i + 3], rows[i + 4], rows[i + 5]
                for k in range(6 * channels):
                    n = j * channels + k
                    sums[k] = (w0 * r0[n] + w1 * r1[n]) + (w2 * r2[n] + w3 * r3[n]) + (w4 * r4[n] + w5 * r5[n])
            else:
                for k in range(6 * channels):
                    sums[k] = np.float32(0.0)
                for a in range(6):
                    row = rows[_mirror(i + a, height)]
                    for b in range(6):
                        n = _mirror(j + b, width) * channels
                        for c in range(channels):
                            sums[b * channels + c] += down[a, s] * row[n + c]
            for c in range(channels):
                value = np.float32(0.0)
                for b in range(6):
                    value += across[b, s] * sums[b * channels + c]
                out[r, s, c] = value
        for s in range(samples):
            if not (abs(x[r, s]) < FARTHEST and abs(y[r, s]) < FARTHEST):
                for c in range(channels):
                    out[r, s, c] = np.float32(np.nan)


@njit(nogil=True, error_model="numpy", fastmath={"contract"})
def _filter(lines):
    """Replace the values of a grid (n, m) by the coefficients of the splines through its n values of each column."""
    last, m = len(lines) - 1, lines.shape[1]
    if last == 0:
        return
    for pole in POLES:
        gain = (np.float32(1.0) - pole) * (np.float32(1.0) - np.float32(1.0) / pole)
        # Sums over the mirrored values, the first one counted last; 0.43^24 is less than the rounding of float32.
        start = np.zeros(m, np.float32)
        power = np.float32(1.0)
        for n in range(24):
            row = lines[_mirror(n, last + 1)]
            for k in range(m):
                start[k] += power * row[k]
            power *= pole
        for k in range(m):
            lines[0, k] = gain * start[k]
        for n in range(1, last + 1):
            before, row = lines[n - 1], lines[n]
            for k in range(m):
                row[k] = gain * row[k] + pole * before[k]
        before, row = lines[last - 1], lines[last]
        for k in range(m):
            row[k] = pole / (pole * pole - np.float32(1.0)) * (row[k] + pole * before[k])
        for n in range(last - 1, -1, -1):
            row, after = lines[n], lines[n + 1]
            for k in range(m):
                row[k] = pole * (after[k] - row[k])


@njit(nogil=True)
def _filter_columns(first, stop, picture):
    """Filter along the columns of the picture, blocks `first` to `stop` - 1 of `BLOCK` values of each row."""
    values = picture.reshape(len(picture), picture.shape[1] * picture.shape[2])
    for n in range(first, stop):
        _filter(values[:, n * BLOCK : min((n + 1) * BLOCK, values.shape[1])])


@njit(nogil=True)
def _filter_rows(first, stop, picture):
    """Filter along the rows `first` to `stop` - 1 of the picture, some together, so that loops become SIMD code."""
    width, channels = picture.shape[1:]
    for top in range(first, stop, TOGETHER):
        count = min(TOGETHER, stop - top)
        lines = np.empty((width, count * channels), np.float32)
        for r in range(count):
            for x in range(width):
                for c in range(channels):
                    lines[x, r * channels + c] = picture[top + r, x, c]
        _filter(lines)
        for r in range(count):
            for x in range(width):
                for c in range(channels):
                    picture[top + r, x, c] = lines[x, r * channels + c]


def to_spline(picture: FloatImage, threads: int | None = None) -> None:
    """Replace a picture (h, w, C), C-contiguous, by the coefficients of the quintic spline through its pixels.

    The filter is recursive (Unser 1999).
    """
    height, width, channels = picture.shape
    share_range(lambda first, stop: _filter_rows(first, stop, picture), height, threads)
    blocks = -(-width * channels // BLOCK)
    share_range(lambda first, stop: _filter_columns(first, stop, picture), blocks, threads)


def sample(
    coefficients: FloatImage, x: NDArray[np.float32], y: NDArray[np.float32], threads: int | None = None
) -> FloatImage:
    """Return the values (H, W, C) of a spline (:func:`to_spline`) at places x and y (H, W), px.

    They are NaN at places that are not finite or 2^31 px away.
    """
    channels = coefficients.shape[2]
    out: FloatImage = np.empty((*x.shape, channels), dtype=np.float32)
    per_pixel = (0,) * channels
    share_range(lambda first, stop: _sample(first, stop, coefficients, x, y, out, per_pixel), len(out), threads)
    return out
