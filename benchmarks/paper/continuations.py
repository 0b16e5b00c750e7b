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
