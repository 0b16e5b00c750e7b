"""First guess of what lies beyond the frame, for a solver that leaves it open (:mod:`rsdeblur.deconv.unknown_border`).

Rows and columns after the last ones lead the picture from its end to its start, so that it is periodic without a seam.
After the solve they are cut off again.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rsdeblur.deconv.fft import fast_length
from rsdeblur.deconv.tiling import WHOLE_EXCESS
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage


def extended(light: FloatImage, bank: PsfBank) -> FloatImage:
    """Return the picture (H, W, C) made periodic; its own rows and columns come first."""
    height, width, _ = extended_shape(light.shape, bank)
    return smooth(light, height, width)


def extended_shape(shape: tuple[int, ...], bank: PsfBank) -> tuple[int, int, int]:
    """Return the shape of :func:`extended`: larger by at least a PSF."""
    height, width, channels = shape
    tall, wide = bank.size
    return fast_length(height + tall, excess=WHOLE_EXCESS), fast_length(width + wide, excess=WHOLE_EXCESS), channels


def smooth(light: FloatImage, height: int, width: int) -> FloatImage:
    """Fill the added pixels with harmonic functions (zero Laplacian), in the manner of Liu and Jia (2008).

    First the rows that join the last row to the first, then the columns that join the last column to the first, then
    the corner between both.
    """
    out = np.empty((height, width, light.shape[2]), dtype=np.float32)
    tall, wide, _ = light.shape
    out[:tall, :wide] = light
    below = _between(light[-1], light[0], height - tall)
    right = _between(light[:, -1], light[:, 0], width - wide)
    out[tall:, :wide] = below
    out[:tall, wide:] = right.swapaxes(0, 1)
    # The corner lies between the last and, as the picture repeats, the first row of `right`, and so it does between
    # the last and the first column of `below`.
    ring = np.zeros((height - tall + 2, width - wide + 2, light.shape[2]))
    ring[0, 1:-1], ring[-1, 1:-1] = right[:, -1], right[:, 0]
    ring[1:-1, 0], ring[1:-1, -1] = below[:, -1], below[:, 0]
    out[tall:, wide:] = _harmonic(ring)
    return out


def _between(start: FloatImage, end: FloatImage, count: int) -> NDArray[np.float64]:
    """Return `count` lines, shape (count, n, C), that lead harmonically from `start` to `end` (n, C)."""
    ring = np.zeros((count + 2, *start.shape))
    ring[0], ring[-1] = start, end
    # The two short sides lead straight from corner to corner.
    step = np.linspace(0, 1, count + 2)[:, None]
    for side in (0, -1):
        ring[:, side] = (1 - step) * start[side] + step * end[side]
    lines = ring[1:-1]
    lines[:, 1:-1] = _harmonic(ring)
    return lines


def _harmonic(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the harmonic function inside the border of `ring` (h + 2, w + 2, C); only that border is read."""
    inner = tuple(max(n - 2, 0) for n in ring.shape[:2])
    known = np.zeros((*inner, ring.shape[2]))
    if not known.size:
        return known
    known[0] -= ring[0, 1:-1]
    known[-1] -= ring[-1, 1:-1]
    known[:, 0] -= ring[1:-1, 0]
    known[:, -1] -= ring[1:-1, -1]
    down, across = (2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) - 2 for n in inner)
    sines = fft.dstn(known, type=1, axes=(0, 1)) / (down[:, None] + across)[..., None]
    solved: NDArray[np.float64] = fft.idstn(sines, type=1, axes=(0, 1))
    return solved
