"""Alternatives to the blended border that make a picture periodic without a seam; it is then solved as periodic."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rsdeblur.kernels.lines import continued
from rsdeblur.types import FloatImage


def reflected(light: FloatImage, height: int, width: int) -> FloatImage:
    """Fill the first half of the added pixels with a reflection at the end, the rest with one at the start."""
    rows, columns = (_mirrored(n, length) for n, length in zip(light.shape, (height, width), strict=False))
    return light[rows[:, None], columns]


def _mirrored(n: int, length: int) -> NDArray[np.intp]:
    added = length - n
    after, before = np.arange(n, n + (added + 1) // 2), np.arange(-(added // 2), 0)
    return continued(np.concatenate([np.arange(n), after, before]), n)


def tapered(light: FloatImage, kernel: NDArray[np.floating]) -> FloatImage:
    """Fade the picture towards its borders into its periodic blur (the "edgetaper" of image processing toolboxes).

    Along each axis, the weight of the picture at a distance from the border is one minus the PSF's autocorrelation at
    that distance: the share of the blur that does not reach across the border.
    """
    height, width, _ = light.shape
    shares = []
    for axis, n in ((1, height), (0, width)):
        profile = kernel.sum(axis=axis, dtype=np.float64)
        overlap = np.correlate(profile, profile, "full")[len(profile) - 1 :]
        reach = min(len(overlap), n)
        share = np.ones(n)
        share[:reach] -= overlap[:reach] / overlap[0]
        shares.append(np.minimum(share, share[::-1]).astype(np.float32))
    weight = shares[0][:, None, None] * shares[1][:, None]
    placed = np.zeros((height, width), dtype=np.float32)
    placed[: kernel.shape[0], : kernel.shape[1]] = kernel
    placed = np.roll(placed, [-(n // 2) for n in kernel.shape], axis=(0, 1))
    spectrum = fft.rfft2(light, axes=(0, 1)) * fft.rfft2(placed)[..., None]
    blurred = fft.irfft2(spectrum, s=(height, width), axes=(0, 1))
    faded: FloatImage = weight * light + (1 - weight) * blurred
    return faded


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
