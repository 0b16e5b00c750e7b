"""Frames of YCbCr whose colours have half the resolution, to RGB and back.

A colour is the mean of the 2 x 2 pixels around it. On the way to RGB, colours are interpolated linearly down the frame,
which averages some of their noise (docs/developer/decisions.md). FFmpeg's conversion takes four times as long.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit, read_only

Stored = TypeVar("Stored", NDArray[np.uint8], NDArray[np.uint16])
Rgb16 = NDArray[np.uint16]

FULL = np.float32(65535.0)
HALF = np.float32(0.5)


class Coding(NamedTuple):
    """Meaning of the stored values.

    Parameters
    ----------
    red, blue : float32
        Weights of red and blue in the luma; green has the rest.
    black, luma_span : float32
        Stored luma of black, and how much more white has.
    grey, chroma_span : float32
        Stored Cb and Cr of grey, and the difference between their largest and least values.
    """

    red: np.float32
    blue: np.float32
    black: np.float32
    luma_span: np.float32
    grey: np.float32
    chroma_span: np.float32

    @classmethod
    def of(cls, red: float, blue: float, bits: int, *, full_range: bool) -> Coding:
        """Return the coding of ITU-R BT.601, BT.709 and BT.2020 with these weights.

        Parameters
        ----------
        red, blue : float
            Weights of red and blue.
        bits : int
            Number of bits of a value.
        full_range : bool
            Whether the luma uses the whole range.
        """
        unit, most = 2 ** (bits - 8), 2**bits - 1
        black, luma, chroma = (0, most, most) if full_range else (16 * unit, 219 * unit, 224 * unit)
        return cls(*map(np.float32, (red, blue, black, luma, 128 * unit, chroma)))


# Loops over whole rows, each value named alone, become SIMD code: five times as fast as a loop over the channels.
@njit(nogil=True, error_model="numpy")
def _to_rgb(luma, cb, cr, coding, rgb):
    red, blue, black, luma_span, grey, chroma_span = coding
    one, zero, near, far = np.float32(1.0), np.float32(0.0), np.float32(0.75), np.float32(0.25)
    green = one - red - blue
    gain, chroma_gain = FULL / luma_span, np.float32(2.0) * FULL / chroma_span
    offset = HALF - black * gain
    height, width = luma.shape
    added = np.empty((3, width + 1), np.float32)
    for y in range(height):
        i = y // 2
        other = max(i - 1, 0) if y % 2 == 0 else min(i + 1, cb.shape[0] - 1)
        for j in range(cb.shape[1]):
            r = (near * cr[i, j] + far * cr[other, j] - grey) * (one - red) * chroma_gain
            b = (near * cb[i, j] + far * cb[other, j] - grey) * (one - blue) * chroma_gain
            g = -(red * r + blue * b) / green
            added[0, 2 * j] = added[0, 2 * j + 1] = r + offset
            added[1, 2 * j] = added[1, 2 * j + 1] = g + offset
            added[2, 2 * j] = added[2, 2 * j + 1] = b + offset
        row, red_added, green_added, blue_added = rgb[y], added[0], added[1], added[2]
        for x in range(width):
            level = np.float32(luma[y, x]) * gain
            row[3 * x] = np.int32(min(max(level + red_added[x], zero), FULL))
            row[3 * x + 1] = np.int32(min(max(level + green_added[x], zero), FULL))
            row[3 * x + 2] = np.int32(min(max(level + blue_added[x], zero), FULL))


def to_rgb(luma: Stored, cb: Stored, cr: Stored, coding: Coding, rgb: Rgb16) -> None:
    """Decode a frame; RGB that it cannot have is clipped.

    Parameters
    ----------
    luma : ndarray, shape (H, W), uint8 or uint16
        The luma.
    cb, cr : ndarray, shape (ceil(H / 2), ceil(W / 2))
        The colours, of the same type.
    coding : Coding
        What these values mean.
    rgb : ndarray, shape (H, W, 3), uint16, C-contiguous
        Receives RGB of full range.
    """
    _to_rgb(read_only(luma), read_only(cb), read_only(cr), coding, rgb.reshape(len(rgb), -1))


@njit(nogil=True, error_model="numpy")
def _from_rgb(rgb, coding, luma, cb, cr):
    red, blue, black, luma_span, grey, chroma_span = coding
    one, zero, eighth = np.float32(1.0), np.float32(0.0), np.float32(0.125)
    green = one - red - blue
    gain, chroma_gain = luma_span / FULL, eighth * chroma_span / FULL
    black, grey, most = black + HALF, grey + HALF, np.float32(2.0) * grey - one
    height, width = luma.shape
    # Of two rows: blue and red minus luma. The last column of an odd number counts twice, and so does the last row.
    blues, reds = np.empty(width + 1, np.float32), np.empty(width + 1, np.float32)
    for i in range(cb.shape[0]):
        blues[...], reds[...] = zero, zero
        for y in (2 * i, min(2 * i + 1, height - 1)):
            row, stored = rgb[y], luma[y]
            for x in range(width):
                r, g, b = np.float32(row[3 * x]), np.float32(row[3 * x + 1]), np.float32(row[3 * x + 2])
                level = red * r + green * g + blue * b
                blues[x] += b - level
                reds[x] += r - level
                stored[x] = np.int32(level * gain + black)
        blues[width], reds[width] = blues[width - 1], reds[width - 1]
        for j in range(cb.shape[1]):
            b, r = blues[2 * j] + blues[2 * j + 1], reds[2 * j] + reds[2 * j + 1]
            cb[i, j] = np.int32(min(max(b * chroma_gain / (one - blue) + grey, zero), most))
            cr[i, j] = np.int32(min(max(r * chroma_gain / (one - red) + grey, zero), most))


def from_rgb(rgb: Rgb16, coding: Coding, luma: Stored, cb: Stored, cr: Stored) -> None:
    """Encode a frame.

    Parameters
    ----------
    rgb : ndarray, shape (H, W, 3), uint16
        RGB of full range.
    coding : Coding
        Meaning of the values to be stored.
    luma : ndarray, shape (H, W), uint8 or uint16
        Receives the luma.
    cb, cr : ndarray, shape (ceil(H / 2), ceil(W / 2))
        Receive the colours, of the same type; the last row and column of odd sizes count twice.
    """
    _from_rgb(read_only(rgb).reshape(len(rgb), -1), coding, luma, cb, cr)
