"""Noise level and gradient energy of a picture, both in linear light."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from rsdeblur.kernels.energy import halved_gradient_energy
from rsdeblur.kernels.shrink import gradient
from rsdeblur.types import FloatArray, FloatImage

# Limits of the octaves, cycles/px: noise has a power of its own below the first, between both, and above, because
# cameras remove the finest noise first.
OCTAVES = (0.125, 0.25)
# Share of all frequencies that each octave contains.
SHARES = np.diff([0.0, *(np.pi * limit**2 for limit in OCTAVES), 1.0])
# Side of the blocks whose noise is estimated one by one, px.
BLOCK = 64
# Median magnitude of a standard normal variable.
MEDIAN = 0.67449


def noise_level(light: FloatImage) -> float:
    """Estimate the standard deviation of the noise: the root mean square over a picture (H, W, C) and its channels.

    Noise that is even in encoded values, or comes from photons, is stronger in bright light, and none is left where the
    picture is clipped. So each block has its own estimate, from the median magnitude of its second differences along
    both axes (Donoho and Johnstone, Biometrika 81, 1994; Immerkaer, Computer Vision and Image Understanding 64, 1996),
    and the squares are averaged.

    Demosaicing, denoising and JPEG remove noise from the finest scale first, so the picture at half its size is
    estimated, too. There detail passes for noise: the estimate is up to twice too high in pictures with little blur. So
    half of it is used, where that is larger. It is 0 for a picture of less than 3 x 3 px.
    """
    # Half of the estimate at half the size, times 2, because an average of four pixels has half the noise.
    return max(_blockwise(light), 0.5 * 2.0 * _blockwise(halved(light)))


def overall_noise(octaves: ArrayLike) -> float:
    """Return the standard deviation of the noise from those in its octaves."""
    return float(np.sqrt(SHARES @ np.square(octaves)))


def noise_spectrum(octaves: ArrayLike, side: int) -> FloatArray:
    """Return the power of noise at the frequencies of `numpy.fft.fft2` of a square; its mean is the variance.

    `octaves` has the standard deviation in each octave, as white noise of the same power would have.
    """
    frequencies = fft.fftfreq(side)
    radius = np.hypot(frequencies[:, None], frequencies)
    power: FloatArray = np.square(octaves)[np.digitize(radius, OCTAVES)]
    return power


def gradient_energy(light: FloatImage) -> float:
    """Return the mean squared gradient of a picture (H, W, C) at half its size, noise included.

    Both directions and all channels are added up. At half the size noise has four times less weight than at full size.
    """
    if min(light.shape[:2]) < 2:  # too narrow to be halved
        return sum(float(np.square(part).sum(axis=2).mean()) for part in gradient(light, periodic=False))
    return halved_gradient_energy(light)


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
