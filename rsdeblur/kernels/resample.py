"""Values of a spline between the pixels of a picture: the Numba kernel and its NumPy twin.

The picture is given as quintic B-spline coefficients. Beyond its edges it is mirrored.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit
from rsdeblur.kernels.warp import FARTHEST, _mirror
from rsdeblur.types import FloatImage

ORDER: Final = 5


@njit(nogil=True, inline="always")
def _spline_weights(f, out):
    # Sums of truncated powers: Unser, "Splines: a perfect fit for signal and image processing", IEEE Signal Processing
    # Magazine 16 (1999).
    g = np.float32(1.0) - f
    for n in range(2):
        t = f if n == 0 else g
        outer, near, inner = t**5, (np.float32(1.0) + t) ** 5, (np.float32(2.0) + t) ** 5
        w0 = outer / np.float32(120.0)
        w1 = (near - np.float32(6.0) * outer) / np.float32(120.0)
        w2 = (inner - np.float32(6.0) * near + np.float32(15.0) * outer) / np.float32(120.0)
        if n == 0:
            out[5], out[4], out[3] = w0, w1, w2
        else:
            out[0], out[1], out[2] = w0, w1, w2


@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "arcp", "nsz"})
def _sample(first, stop, coefficients, x, y, out):
    height, width, channels = coefficients.shape
    rows = coefficients.reshape(height, width * channels)
    wx, wy = np.empty(6, np.float32), np.empty(6, np.float32)
    # Sums over the six rows, of all channels of the six columns.
    sums = np.empty(6 * channels, np.float32)
    for r in range(first, stop):
        for s in range(out.shape[1]):
            qx, qy = x[r, s], y[r, s]
            if not (abs(qx) < FARTHEST and abs(qy) < FARTHEST):
                for c in range(channels):
                    out[r, s, c] = np.float32(np.nan)
                continue
            i0, j0 = int(np.floor(qy)) - 2, int(np.floor(qx)) - 2
            _spline_weights(np.float32(qx - j0 - 2), wx)
            _spline_weights(np.float32(qy - i0 - 2), wy)
            for k in range(6 * channels):
                sums[k] = np.float32(0.0)
            if 0 <= i0 < height - 5 and 0 <= j0 < width - 5:
                left = j0 * channels
                for a in range(6):
                    for k in range(6 * channels):
                        sums[k] += wy[a] * rows[i0 + a, left + k]
            else:
                for a in range(6):
                    i = _mirror(i0 + a, height)
                    for b in range(6):
                        j = _mirror(j0 + b, width)
                        for c in range(channels):
                            sums[b * channels + c] += wy[a] * coefficients[i, j, c]
            for c in range(channels):
                value = np.float32(0.0)
                for b in range(6):
                    value += wx[b] * sums[b * channels + c]
                out[r, s, c] = value


def to_spline(picture: FloatImage) -> None:
    """Replace a picture (h, w, C) by the coefficients of the quintic spline through its pixels."""
    for c in range(picture.shape[2]):
        picture[..., c] = ndimage.spline_filter(picture[..., c], ORDER, output=np.float32, mode="mirror")


def sample(
    coefficients: FloatImage, x: NDArray[np.float32], y: NDArray[np.float32], threads: int | None = None
) -> FloatImage:
    """Return the values of a spline at given places.

    Parameters
    ----------
    coefficients : ndarray, shape (h, w, C), float32, C-contiguous
        Quintic spline coefficients of the picture, see :func:`to_spline`.
    x, y : ndarray, shape (H, W), float32
        Places in px.
    threads : int, optional
        Number of threads that share the rows; default all processors. Any number gives the same bits.

    Returns
    -------
    ndarray, shape (H, W, C), float32
        NaN at places that are not finite or 2^31 px away.
    """
    out: FloatImage = np.empty((*x.shape, coefficients.shape[2]), dtype=np.float32)
    share_range(lambda first, stop: _sample(first, stop, coefficients, x, y, out), len(out), threads)
    return out


def sample_numpy(coefficients: FloatImage, x: NDArray[np.float32], y: NDArray[np.float32]) -> FloatImage:
    """Readable twin of :func:`sample`."""
    known = (np.abs(x) < FARTHEST) & (np.abs(y) < FARTHEST)
    places = np.where(known, np.stack([y, x]), 0.0)
    channels = [
        ndimage.map_coordinates(part, places, order=ORDER, mode="mirror", prefilter=False, output=np.float32)
        for part in np.moveaxis(coefficients, -1, 0)
    ]
    values: FloatImage = np.where(known[..., None], np.stack(channels, axis=-1), np.float32(np.nan))
    return values
