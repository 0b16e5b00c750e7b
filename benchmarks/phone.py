"""A phone's processing of a picture: mosaic, demosaicing, denoising, sharpening, tone curve and JPEG."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from benchmarks.captures import SimulatedCapture
from rsdeblur.image.transfer import from_linear, to_linear

# Bilinear demosaicing of the green pixels, and of the red or blue ones.
GREEN = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
RED_OR_BLUE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
# Weights of red, green and blue in the luma, which is denoised less than the chroma.
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
# Softness of the denoised chroma, px; spread in px and in standard deviations of the noise of the bilateral filter of
# the luma; amount and radius (px) of the sharpening.
CHROMA, NEAR, ALIKE, SHARPER, RADIUS = 2.0, 1.5, 4.5, 0.6, 1.0
# Photon noise at white of a series of pictures in turn: much, some and little light.
NOISES = 0.004, 0.01, 0.02
# Noise and JPEG quality of a sharp picture, with which results are compared.
TRUTH_NOISE, TRUTH_QUALITY = 0.001, 97


def phone_photo(light: NDArray[np.float32], n: int) -> NDArray[np.uint8]:
    """Return what a phone would store of the linear light of the `n`-th picture of a series."""
    return processed(light, np.random.default_rng(n), noise=NOISES[n % len(NOISES)])


def from_phone(capture: SimulatedCapture, n: int) -> SimulatedCapture:
    """Return the `n`-th capture of a series with its pictures as a phone would store them, in linear light."""
    random = np.random.default_rng(n)
    sharp = processed(capture.pictures.rolling, random, noise=TRUTH_NOISE, quality=TRUTH_QUALITY)
    photos = {"rolling": sharp, "blurred": phone_photo(capture.pictures.blurred, n)}
    light = {name: to_linear(photo.astype(np.float32) / np.float32(255), "srgb") for name, photo in photos.items()}
    return replace(capture, pictures=capture.pictures._replace(**light))


def processed(
    light: NDArray[np.float32], random: np.random.Generator, *, noise: float, quality: int = 90
) -> NDArray[np.uint8]:
    """Return what a phone would store of linear light of shape (H, W, 3).

    Parameters
    ----------
    light : ndarray
        Linear light in [0, 1].
    random : Generator
        Source of the noise.
    noise : float
        Standard deviation of the photon noise at white.
    quality : int
        Quality of the JPEG.
    """
    light = light.clip(0, 1)
    sensed = light + random.normal(size=light.shape) * np.sqrt(noise**2 * light + (noise / 4) ** 2)
    encoded = from_linear(_demosaiced(sensed).clip(0, 1).astype(np.float32), "srgb")
    luma = encoded @ LUMA
    chroma = ndimage.gaussian_filter(encoded - luma[..., None], (CHROMA, CHROMA, 0))
    calm = _bilateral(luma, ALIKE * 1.5 * noise)
    sharper = calm + SHARPER * (calm - ndimage.gaussian_filter(calm, RADIUS))
    file = io.BytesIO()
    values = np.round((sharper[..., None] + chroma).clip(0, 1) * 255).astype(np.uint8)
    Image.fromarray(values).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def _demosaiced(sensed: NDArray[Any]) -> NDArray[Any]:
    down, across = np.indices(sensed.shape[:2]) % 2
    places = (down == 0) & (across == 0), down != across, (down == 1) & (across == 1)
    kernels = RED_OR_BLUE, GREEN, RED_OR_BLUE
    return np.stack(
        [
            ndimage.convolve(np.where(place, sensed[..., c], 0), kernel, mode="mirror")
            for c, (place, kernel) in enumerate(zip(places, kernels, strict=True))
        ],
        axis=-1,
    )


def _bilateral(luma: NDArray[Any], alike: float) -> NDArray[Any]:
    total, weights = np.zeros_like(luma), np.zeros_like(luma)
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            other = np.roll(luma, (dy, dx), axis=(0, 1))
            weight = np.exp(-(dy**2 + dx**2) / (2 * NEAR**2) - np.square((other - luma) / alike) / 2)
            total += weight * other
            weights += weight
    calm: NDArray[Any] = total / weights
    return calm
