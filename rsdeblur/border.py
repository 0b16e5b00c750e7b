"""What a tile sees where the picture ends, and how its two ends are made to meet.

A discrete Fourier transform repeats its input; a step from the last row to the first would ring through the result.
As in Sindelar and Sroubek (2013), opposite ends are blended over the PSF's width. The picture itself is left alone: it
is continued by reflection, and only the continuation fades from one end into the other.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Border = Literal["blend", "periodic"]
Samples = NDArray[np.float32] | NDArray[np.complex64]
BORDERS: tuple[Border, ...] = ("blend", "periodic")


def extend(source: Samples, out: Samples, start: int, *, taper: int, border: Border, axis: int) -> None:
    """Copy positions `start`, `start` + 1, ... of `source` into `out` along `axis`, continued beyond the ends.

    Parameters
    ----------
    source : ndarray
        Picture or row spectra, n positions along `axis`.
    out : ndarray
        Filled; its length along `axis` is the tile's.
    start : int
        Position of `source` that comes first in `out`; may be negative.
    taper : int
        The last `taper` positions of `out` fade into those that precede `start`, so that `out` repeats smoothly.
    border : {"blend", "periodic"}
        How `source` goes on beyond its ends: reflected or repeated.
    axis : int
        Axis of both arrays.
    """
    source, out = np.moveaxis(source, axis, 0), np.moveaxis(out, axis, 0)
    n, length = len(source), len(out)
    low, high = max(-start, 0), min(n - start, length)
    out[low:high] = source[start + low : start + high]
    beyond = np.r_[0:low, high:length]
    out[beyond] = source[_continued(start + beyond, n, border)]
    if taper:
        tail = np.arange(length - taper, length)
        before = source[_continued(start + tail - length, n, border)]
        out[tail] += _fade(taper).reshape(-1, *(1,) * (out.ndim - 1)) * (before - out[tail])


def _continued(positions: NDArray[np.intp], n: int, border: Border) -> NDArray[np.intp]:
    """Positions inside 0 to n - 1 that stand for `positions` outside."""
    if border == "periodic":
        return positions % n
    folded = positions % (2 * n)
    return np.minimum(folded, 2 * n - 1 - folded)


def _fade(n: int) -> NDArray[np.float32]:
    """Return a smooth ramp strictly between 0 and 1."""
    return (0.5 - 0.5 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))).astype(np.float32)
