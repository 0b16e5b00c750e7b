"""Periodograms of square tiles of a picture, and the power that PSFs leave of them."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from rsdeblur.kernels.periodogram import smoothed_power
from rsdeblur.types import FloatArray

# Side of the tiles, px: small enough for the PSF to be constant within a tile.
TILE = 64
# Directions of frequencies in which a scene has a power of its own: the power of a door's edges, say.
DIRECTIONS = 8
# Frequencies that mostly contain noise, cycles/px.
NOISE_FROM, NOISE_TO = 0.35, 0.5

_DOWN, _ACROSS = np.meshgrid(scipy.fft.fftfreq(TILE), scipy.fft.rfftfreq(TILE), indexing="ij")
# Frequencies of `numpy.fft.rfft2` of a tile, cycles/px, and the squared response of both differences together.
RADIUS: FloatArray = np.hypot(_ACROSS, _DOWN)
GRADIENT: FloatArray = 4 * np.sin(np.pi * _DOWN) ** 2 + 4 * np.sin(np.pi * _ACROSS) ** 2
# Sector of each frequency, in [0, DIRECTIONS); opposite directions share one.
DIRECTION: NDArray[np.intp] = np.minimum(
    np.floor((np.arctan2(_DOWN, _ACROSS) / np.pi + 0.5) * DIRECTIONS).astype(np.intp), DIRECTIONS - 1
)


def periodograms(tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the power of both differences of tiles (..., TILE, TILE) under a Hann window, as that of `rfft2`.

    White noise has the power of GRADIENT.
    """
    hann = np.sin(np.pi * np.arange(TILE) / TILE) ** 2
    window = (np.outer(hann, hann) / np.sum(hann**2)).astype(np.float32)
    power = np.zeros((*tiles.shape[:-1], TILE // 2 + 1), dtype=np.float32)
    for axis in (-2, -1):
        # The window is zero where a difference is missing.
        difference = np.diff(tiles, axis=axis, prepend=np.take(tiles, [0], axis=axis)).astype(np.float32)
        power += np.abs(scipy.fft.rfft2(difference * window)) ** 2
    return power


def noise_between(power: NDArray[np.float32], low: float, high: float) -> NDArray[np.float32]:
    """Return the power of white noise in each tile: the least of several directions in a ring of frequencies.

    A scene and a blur have a direction, noise has none. Noise of the picture's average does not do: a likelihood needs
    the noise of each tile, in the units of its periodogram. `low` and `high` bound the ring, cycles/px.
    """
    ring = (low < RADIUS) & (high > RADIUS)
    white = power / np.maximum(GRADIENT, 1e-9)
    least: NDArray[np.float32] = np.min(
        [white[..., ring & (sector == DIRECTION)].mean(axis=-1) for sector in range(DIRECTIONS)], axis=0
    )
    return np.maximum(least, 1e-12).astype(np.float32)


def wrapped(kernels: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return kernels (B, S, kh, kw) on a grid that repeats, shape (B, S, *shape); larger ones wrap around.

    Their spectra have the frequencies of a tile of this shape.
    """
    (tall, wide), (height, width) = kernels.shape[2:], shape
    down, across = -(-tall // height), -(-wide // width)
    room = ((0, 0), (0, 0), (0, down * height - tall), (0, across * width - wide))
    grid = np.pad(kernels, room).reshape(*kernels.shape[:2], down, height, across, width)
    total: NDArray[np.float32] = grid.sum(axis=(2, 4))
    return total


def power_of(kernels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return |H|^2 of kernels (B, S, kh, kw) as smoothed by the window, shape (B, S, TILE, TILE // 2 + 1)."""
    grid = kernels if max(kernels.shape[2:]) <= TILE else wrapped(kernels, (TILE, TILE))
    spectra = scipy.fft.rfft2(grid.reshape(-1, *grid.shape[2:]), (TILE, TILE))
    return smoothed_power(spectra).reshape(*kernels.shape[:2], TILE, TILE // 2 + 1)
