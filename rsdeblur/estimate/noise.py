"""How noisy a picture is, and how much goes on in it, both in linear light."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.shrink import gradient
from rsdeblur.types import FloatImage

# Side of the blocks whose noise is estimated one by one, px.
BLOCK = 64
# Median magnitude of a standard normal variable.
MEDIAN = 0.67449


def noise_level(light: FloatImage) -> float:
    """Estimate the standard deviation of the noise: the root mean square over the picture and its channels.

    Noise that is even in stored values, or comes from photons, is stronger in bright light, and none is left where the
    picture is clipped. So each block is estimated by itself, by the median magnitude of its second differences along
    both axes [1]_ [2]_, and the squares are averaged. Demosaicing, denoising and JPEG remove noise from the finest
    scale first, so the picture at half its size is looked at too. Detail is taken for noise there, up to twofold in
    pictures that are hardly blurred; half of that estimate counts where it is larger.

    Parameters
    ----------
    light : ndarray, shape (H, W, C), float32
        Linear light.

    Returns
    -------
    float
        In units of `light`; 0 for a picture of fewer than 3 x 3 px.

    References
    ----------
    .. [1] D. L. Donoho and I. M. Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81, 1994.
    .. [2] J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64, 1996.
    """
    # What half the size averages over four pixels is half as noisy.
    return max(_blockwise(light), 0.5 * 2.0 * _blockwise(halved(light)))


def gradient_energy(light: FloatImage, noise: float) -> float:
    """Mean squared gradient of a picture at half its size, over both directions and all channels, without the noise's.

    At half the size it can be told from noise four times better than at full size.

    Parameters
    ----------
    light : ndarray, shape (H, W, C), float32
        Linear light.
    noise : float
        Standard deviation of the noise.
    """
    half = halved(light)
    # A difference of two pixels, each of the noise's variance / 4, in two directions.
    of_noise = light.shape[2] * 2 * 2 * noise**2 / 4
    energy = sum(float(np.square(part).sum(axis=2).mean()) for part in gradient(half, periodic=False))
    # A tenth: where noise dominates, its estimate must not make the picture vanish.
    return float(max(energy - of_noise, 0.1 * energy))


def halved(light: FloatImage) -> FloatImage:
    """Average 2 x 2 pixels; an odd last row or column is left out. A picture of a single one is returned as it is."""
    if min(light.shape[:2]) < 2:
        return light
    height, width = (n - n % 2 for n in light.shape[:2])
    even = light[:height, :width]
    mean: FloatImage = 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
    return mean


def _blockwise(light: FloatImage) -> float:
    """Root mean square of the noise estimates of all blocks and channels."""
    # (1, -2, 1) along both axes: 36 times the variance of white noise.
    rough = np.abs(np.diff(np.diff(light, n=2, axis=0), n=2, axis=1)) / 6
    if rough.size == 0:
        return 0.0
    rows, cols = (np.array_split(np.arange(n), max(1, round(n / BLOCK))) for n in rough.shape[:2])
    medians = [np.median(rough[r[0] : r[-1] + 1, c[0] : c[-1] + 1], axis=(0, 1)) for r in rows for c in cols]
    return float(np.sqrt(np.mean(np.square(medians)))) / MEDIAN
