"""Pictures between their pixels: values of a spline there, and averages over projective warps.

A picture is given as B-spline coefficients, quintic ones for values and cubic ones for averages
(``scipy.ndimage.spline_filter``, ``mode="mirror"``), so that interpolation costs no visible sharpness. Beyond its edges
it is mirrored.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import spline_filter1d

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit
from rsdeblur.types import FloatImage

# Largest coordinate in px that is mirrored into the picture; beyond, and for NaN, the average is NaN.
FARTHEST: Final = 2.0**31
# Order of the interpolating splines. Cubic ones cost pixel-sharp pictures 0.4 dB more, windowed sincs of 6 and 8 pixels
# 0.3 to 1 dB (rectify, three simulated captures).
ORDER: Final = 5
# All of fastmath but what assumes that there are neither NaN nor infinity.
FAST: Final = {"reassoc", "contract", "arcp", "nsz"}
HALF: Final = np.float32(0.5)


@njit(nogil=True, inline="always")
def _mirror(i, n):
    if n == 1:
        return 0
    period = 2 * n - 2
    i = abs(i) % period
    return period - i if i >= n else i


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
    """Compute the first of the coefficients that each place depends on, and their weights: four (cubic) or six, (6, n).

    Quintic splines have six.
    """
    taps = len(weights)
    for s in range(len(places)):
        # Comparisons with NaN are false.
        place = places[s] if abs(places[s]) < FARTHEST else 0.0
        below = np.floor(place)
        first[s] = np.int64(below) - (taps // 2 - 1)
        t = np.float32(place - below)
        g = np.float32(1.0) - t
        if taps == 6:
            weights[5, s], weights[4, s], weights[3, s] = _outer_weights(t)
            weights[0, s], weights[1, s], weights[2, s] = _outer_weights(g)
        else:
            weights[0, s], weights[3, s] = g * g * g / np.float32(6.0), t * t * t / np.float32(6.0)
            weights[1, s] = np.float32(2.0 / 3.0) - HALF * t * t * (np.float32(2.0) - t)
            weights[2, s] = np.float32(2.0 / 3.0) - HALF * g * g * (np.float32(2.0) - g)


@njit(nogil=True, error_model="numpy", fastmath=FAST)
def _sample(first, stop, coefficients, x, y, out, per_pixel, per_place):
    """Fill the rows `first` to `stop` - 1 of `out`.

    `per_pixel` is a tuple with one item for each channel, `per_place` one with an item for each coefficient along an
    axis. The compiler knows the length of a tuple, so that loops over a few values become SIMD code without a
    remainder.
    """
    height, width = coefficients.shape[:2]
    channels, taps, samples = len(per_pixel), len(per_place), out.shape[1]
    rows = coefficients.reshape(height, width * channels)
    left, top = np.empty(samples, np.int64), np.empty(samples, np.int64)
    across, down = np.empty((taps, samples), np.float32), np.empty((taps, samples), np.float32)
    # Sums over the rows, of all channels of the columns.
    sums = np.empty(taps * channels, np.float32)
    for r in range(first, stop):
        _fill_weights(x[r], left, across)
        _fill_weights(y[r], top, down)
        for s in range(samples):
            i, j = top[s], left[s]
            for k in range(taps * channels):
                sums[k] = np.float32(0.0)
            if 0 <= i < height - taps + 1 and 0 <= j < width - taps + 1:
                for a in range(taps):
                    row, weight = rows[i + a], down[a, s]
                    for k in range(taps * channels):
                        sums[k] += weight * row[j * channels + k]
            else:
                for a in range(taps):
                    row, weight = rows[_mirror(i + a, height)], down[a, s]
                    for b in range(taps):
                        n = _mirror(j + b, width) * channels
                        for c in range(channels):
                            sums[b * channels + c] += weight * row[n + c]
            for c in range(channels):
                value = np.float32(0.0)
                for b in range(taps):
                    value += across[b, s] * sums[b * channels + c]
                out[r, s, c] = value
        for s in range(samples):
            if not (abs(x[r, s]) < FARTHEST and abs(y[r, s]) < FARTHEST):
                for c in range(channels):
                    out[r, s, c] = np.float32(np.nan)


def average_warps(
    coefficients: NDArray[np.float32], warps: NDArray[np.float64], width: int, threads: int | None = None
) -> NDArray[np.float32]:
    """Return the mean over t of the picture warped by `warps[y, t]`, for every output row y, shape (H, width, C).

    `coefficients` (h, w, C) are those of the picture's cubic spline, `warps` (H, T, 3, 3) homographies from output
    pixels (x, y, 1) to picture coordinates. The result is NaN where a warp leads nowhere.
    """
    channels = coefficients.shape[2]
    out = np.empty((len(warps), width, channels), dtype=np.float32)
    per_pixel, columns = (0,) * channels, np.arange(width)

    def average(first: int, stop: int) -> None:
        for row in range(first, stop):
            warp = warps[row, :, :, :, None]
            with np.errstate(all="ignore"):
                x, y, w = np.moveaxis(warp[:, :, 0] * columns + (warp[:, :, 1] * row + warp[:, :, 2]), 1, 0)
                x, y = x / w, y / w
                values = np.empty((*x.shape, channels), np.float32)
                _sample(0, len(x), coefficients, x, y, values, per_pixel, (0,) * 4)
                values.mean(axis=0, out=out[row])

    share_range(average, len(out), threads)
    return out


def to_spline(picture: FloatImage, threads: int | None = None) -> None:
    """Replace a picture (h, w, C) by the coefficients of the quintic spline through its pixels."""
    for axis in (1, 0):
        lines = np.moveaxis(picture, axis, 0)

        def filter_lines(first: int, stop: int, lines: FloatImage = lines) -> None:
            part = lines[:, first:stop]
            part[...] = spline_filter1d(part, ORDER, axis=0, output=np.float32, mode="mirror")

        share_range(filter_lines, lines.shape[1], threads)


def sample(
    coefficients: FloatImage, x: NDArray[np.float32], y: NDArray[np.float32], threads: int | None = None
) -> FloatImage:
    """Return the values (H, W, C) of a spline (:func:`to_spline`) at places x and y (H, W), px.

    They are NaN at places that are not finite or 2^31 px away.
    """
    channels = coefficients.shape[2]
    out: FloatImage = np.empty((*x.shape, channels), dtype=np.float32)
    per_pixel = (0,) * channels
    share_range(
        lambda first, stop: _sample(first, stop, coefficients, x, y, out, per_pixel, (0,) * 6), len(out), threads
    )
    return out
