"""Noise level and gradient energy of a picture, both in linear light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsdeblur.kernels.shrink import gradient
from rsdeblur.types import FloatImage

# Side of the blocks whose noise is estimated one by one, px.
BLOCK = 64
# Most variance that detail adds to an estimate, in units of that of the noise; see `noise_level`.
MOST_DETAIL = 3.0
# Median magnitude of a standard normal variable.
MEDIAN = 0.67449


def noise_level(light: FloatImage) -> float:
    """Estimate the standard deviation of the noise: the root mean square over the picture and its channels.

    Noise that is even in encoded values, or comes from photons, is stronger in bright light, and none is left where the
    picture is clipped. So each block has its own estimate, from the median magnitude of its second differences along
    both axes [1]_ [2]_, and the squares are averaged. Demosaicing, denoising and JPEG remove noise from the finest
    scale first, so the picture at half its size is estimated, too. There detail passes for noise: the estimate is up to
    twice too high in pictures with little blur. So half of it is used, where that is larger than the first estimate.

    Parameters
    ----------
    light : ndarray, shape (H, W, C), float32
        Linear light.

    Returns
    -------
    float
        Noise in units of `light`; 0 for a picture of less than 3 x 3 px.

    References
    ----------
    .. [1] D. L. Donoho and I. M. Johnstone, "Ideal spatial adaptation by wavelet shrinkage", Biometrika 81, 1994.
    .. [2] J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64, 1996.
    """
    # Half of the estimate at half the size, times 2, because an average of four pixels has half the noise.
    return max(_blockwise(light), 0.5 * 2.0 * _blockwise(halved(light)))


def noise_levels(estimates: Sequence[float], brightness: Sequence[float]) -> list[float]:
    """Return the noise of several pictures of one scene, from that which was estimated in each.

    Detail passes for noise, and the less a picture is blurred, the more. So only such noise counts as a picture's own
    as its detail cannot explain; the rest of it is that of the picture with the least noise.

    Parameters
    ----------
    estimates : sequence of float
        :func:`noise_level` of each picture.
    brightness : sequence of float
        Mean of each picture, positive.
    """
    relative = np.square(np.divide(estimates, brightness))
    least = relative.min()
    levels = np.sqrt(np.maximum(relative - MOST_DETAIL * least, least)) * brightness
    return [float(level) for level in levels]


def gradient_energy(light: FloatImage, noise: float) -> float:
    """Return the mean squared gradient of a picture at half its size, without the share of the noise.

    Both directions and all channels are added up. At half the size noise has four times less weight than at full size.

    Parameters
    ----------
    light : ndarray, shape (H, W, C), float32
        Linear light.
    noise : float
        Standard deviation of the noise.

    Returns
    -------
    float
        Squared units of `light` per px of the halved picture.
    """
    half = halved(light)
    # Two directions, each a difference of two pixels whose noise has a quarter of the variance.
    of_noise = light.shape[2] * 2 * 2 * noise**2 / 4
    energy = sum(float(np.square(part).sum(axis=2).mean()) for part in gradient(half, periodic=False))
    # At least a tenth: where noise dominates, an error of its estimate must not leave a gradient of zero.
    return float(max(energy - of_noise, 0.1 * energy))


def halved(light: FloatImage) -> FloatImage:
    """Return averages of 2 x 2 pixels, without an odd last row or column; a single row or column stays as it is."""
    if min(light.shape[:2]) < 2:
        return light
    height, width = (n - n % 2 for n in light.shape[:2])
    even = light[:height, :width]
    mean: FloatImage = 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
    return mean


def _blockwise(light: FloatImage) -> float:
    """Return the root mean square of the noise estimates of all blocks and channels."""
    # (1, -2, 1) along both axes has 36 times the variance of white noise.
    rough = np.abs(np.diff(np.diff(light, n=2, axis=0), n=2, axis=1)) / 6
    if rough.size == 0:
        return 0.0
    rows, cols = (np.array_split(np.arange(n), max(1, round(n / BLOCK))) for n in rough.shape[:2])
    medians = [np.median(rough[r[0] : r[-1] + 1, c[0] : c[-1] + 1], axis=(0, 1)) for r in rows for c in cols]
    return float(np.sqrt(np.mean(np.square(medians)))) / MEDIAN
