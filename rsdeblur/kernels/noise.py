"""Noise and model error of tiles, fitted to their periodograms, and the energy of the gradient at half size."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import FloatArray, FloatImage


class TilePowers(NamedTuple):
    """Power of T tiles at F frequencies, which are sorted by C cells."""

    measured: FloatArray  # periodograms (T, F), positive
    blurred: FloatArray  # power (T, F) expected from the scene and the blur, up to a gain, positive
    error: FloatArray  # power (F,) that an error of the paths of 1 px adds, in the same unit
    noise: FloatArray  # power (F,) of white noise of variance 1
    brightness: FloatArray  # of the tiles (T,), positive
    cells: NDArray[np.int64]  # first frequency of each cell, and F, (C + 1,)
    octaves: NDArray[np.int64]  # octave of each cell (C,), from 0 on without a gap


# Sums in any order, so that the loops become SIMD code; NaN and infinity stay what they are.
@njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _fit(tiles, noises, squared, gains, steps, prior, weight):
    """Fit `noises`, rows a and b of shape (2, O), and `gains`, both in place, and return e^2, `squared` at first."""
    for _ in range(steps):
        up, down = np.zeros_like(noises), np.zeros_like(noises)
        error_up, error_down = weight * prior / squared**2, weight / squared
        for tile in range(len(gains)):
            for cell in range(len(tiles.octaves)):
                inside, octave = slice(tiles.cells[cell], tiles.cells[cell + 1]), tiles.octaves[cell]
                measured, blurred = tiles.measured[tile, inside], tiles.blurred[tile, inside]
                error, noise = tiles.error[inside], tiles.noise[inside]
                light, gain = tiles.brightness[tile], gains[tile, cell]
                floor, more, less = noises[0, octave] + noises[1, octave] * light, 0.0, 0.0
                for i in range(len(measured)):
                    scene = blurred[i] + squared * error[i]
                    known = 1.0 / (gain * scene + floor * noise[i])
                    more += measured[i] * known * known * scene
                    less += known * scene
                gain *= more / less
                noise_up, noise_down, of_error_up, of_error_down = 0.0, 0.0, 0.0, 0.0
                for i in range(len(measured)):
                    known = 1.0 / (gain * (blurred[i] + squared * error[i]) + floor * noise[i])
                    surprise = measured[i] * known * known
                    noise_up += surprise * noise[i]
                    noise_down += known * noise[i]
                    of_error_up += surprise * error[i]
                    of_error_down += known * error[i]
                gains[tile, cell] = gain
                up[0, octave] += noise_up
                down[0, octave] += noise_down
                up[1, octave] += noise_up * light
                down[1, octave] += noise_down * light
                error_up += gain * of_error_up
                error_down += gain * of_error_down
        for octave in range(noises.shape[1]):
            noises[0, octave] *= up[0, octave] / down[0, octave]
            noises[1, octave] *= up[1, octave] / down[1, octave]
        squared *= error_up / error_down
    return squared


def fit_floors(tiles: TilePowers, start: tuple[float, float], steps: int, weight: float) -> tuple[FloatArray, float]:
    """Return the mean variance of the noise in each octave and the mean square of the paths' errors, px^2.

    The power expected of a tile is `V = g_c (E + e^2 D) + (a_o + b_o m) N`. E is the power of scene and blur, D that
    which an error of 1 px of the paths adds, N that of white noise, and m the tile's brightness. Each cell c of
    neighbouring frequencies has a gain g_c of its own, because scenes differ in scale and direction; the floors a_o and
    b_o of each octave o, and e^2, are those of all tiles. The fit minimises the sum of `P / V + log V`, the
    Itakura-Saito divergence from the periodogram P: each step multiplies a parameter by the ratio of the two parts of
    its derivative [1]_, without the square root there, which halves the steps.

    The fit starts at `start`, the values of noise and errors, positive. That of the errors is also their prior, which
    counts for `weight` frequencies.

    .. [1] C. Fevotte, N. Bertin and J.-L. Durrieu, "Nonnegative matrix factorization with the Itakura-Saito
       divergence", Neural Computation 21, 2009.
    """
    # At first, half of the noise is in proportion to light.
    halves = np.array([[start[0] / 2], [start[0] / 2 / tiles.brightness.mean()]])
    noises = np.repeat(halves, tiles.octaves.max() + 1, axis=1)
    measured, blurred = (np.add.reduceat(power, tiles.cells[:-1], axis=1) for power in tiles[:2])
    squared = _fit(tiles, noises, start[1], measured / blurred, steps, start[1], weight)
    return noises[0] + noises[1] * tiles.brightness.mean(), float(squared)


@njit(nogil=True, error_model="numpy", fastmath={"reassoc"})  # sums in any order
def _energy(light):
    quarter, total = np.float32(0.25), 0.0
    height, width, channels = light.shape[0] // 2, light.shape[1] // 2, light.shape[2]
    rows = np.empty((2, width * channels), np.float32)
    for y in range(height):
        above, below, here, before = light[2 * y], light[2 * y + 1], rows[y % 2], rows[1 - y % 2]
        for x in range(width):
            for c in range(channels):
                across = above[2 * x, c] + above[2 * x + 1, c]
                here[x * channels + c] = quarter * (across + below[2 * x, c] + below[2 * x + 1, c])
        for i in range(channels, len(here)):
            total += np.float64(here[i] - here[i - channels]) ** 2
        if y > 0:
            for i in range(len(here)):
                total += np.float64(here[i] - before[i]) ** 2
    return total / (height * width)


def halved_gradient_energy(light: FloatImage) -> float:
    """Return the mean squared gradient of linear light (H, W, C) at half its size, of both directions and all channels.

    They are added up. A pixel at half the size is the mean of 2 x 2 pixels; an odd last row or column is left out. The
    last column has no difference across, and the last row none down. H and W are at least 2.
    """
    return float(_energy(read_only(light)))
