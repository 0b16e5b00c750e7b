"""Noise and model error of tiles, fitted to their periodograms, and the energy of the gradient at half size.

The power expected of a tile is `V = g_c (E + e^2 D) + (a_o + b_o m) N`. E is the power of scene and blur, D that which
an error of 1 px of the paths adds, N that of white noise, and m the tile's brightness. Each cell c of neighbouring
frequencies has a gain g_c of its own, because scenes differ in scale and direction; the floors a_o and b_o of each
octave o, and e^2, are those of all tiles. The fit minimises the sum of `P / V + log V`, the Itakura-Saito divergence
from the periodogram P: each step multiplies a parameter by the ratio of the two parts of its derivative [1]_, without
the square root there, which halves the steps.

References
----------
.. [1] C. Fevotte, N. Bertin and J.-L. Durrieu, "Nonnegative matrix factorization with the Itakura-Saito divergence",
       Neural Computation 21, 2009.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import Float32Array, FloatArray


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
FAST = {"reassoc", "contract", "nsz"}


@njit(nogil=True, error_model="numpy", fastmath=FAST)
def _gain_ratio(measured, blurred, error, noise, squared, floor, gain):
    """Return the ratio by which a cell's gain changes."""
    up, down = 0.0, 0.0
    for i in range(len(measured)):
        scene = blurred[i] + squared * error[i]
        known = 1.0 / (gain * scene + floor * noise[i])
        up += measured[i] * known * known * scene
        down += known * scene
    return up / down


@njit(nogil=True, error_model="numpy", fastmath=FAST)
def _shared_ratios(measured, blurred, error, noise, squared, floor, gain):
    """Return a cell's parts of the numerators and denominators of the ratios of the noise and of the error."""
    noise_up, noise_down, error_up, error_down = 0.0, 0.0, 0.0, 0.0
    for i in range(len(measured)):
        known = 1.0 / (gain * (blurred[i] + squared * error[i]) + floor * noise[i])
        surprise = measured[i] * known * known
        noise_up += surprise * noise[i]
        noise_down += known * noise[i]
        error_up += surprise * error[i]
        error_down += known * error[i]
    return noise_up, noise_down, gain * error_up, gain * error_down


@njit(nogil=True, error_model="numpy")
def _fit(tiles, noises, squared, gains, steps, prior, weight):
    """Fit `noises`, rows a and b of shape (2, O), and `gains`, both in place, and return e^2, `squared` at first."""
    measured, blurred, error, noise, brightness, cells, octaves = tiles
    for _ in range(steps):
        up, down = np.zeros_like(noises), np.zeros_like(noises)
        error_up, error_down = weight * prior / squared**2, weight / squared
        for tile in range(len(measured)):
            for cell in range(len(cells) - 1):
                first, stop, octave = cells[cell], cells[cell + 1], octaves[cell]
                floor = noises[0, octave] + noises[1, octave] * brightness[tile]
                powers = measured[tile, first:stop], blurred[tile, first:stop], error[first:stop], noise[first:stop]
                gains[tile, cell] *= _gain_ratio(*powers, squared, floor, gains[tile, cell])
                ratios = _shared_ratios(*powers, squared, floor, gains[tile, cell])
                up[0, octave] += ratios[0]
                down[0, octave] += ratios[1]
                up[1, octave] += ratios[0] * brightness[tile]
                down[1, octave] += ratios[1] * brightness[tile]
                error_up += ratios[2]
                error_down += ratios[3]
        for part in range(len(noises)):
            for octave in range(noises.shape[1]):
                noises[part, octave] *= up[part, octave] / down[part, octave]
        squared *= error_up / error_down
    return squared


def fit_floors(tiles: TilePowers, start: tuple[float, float], steps: int, weight: float) -> tuple[FloatArray, float]:
    """Return the mean variance of the noise in each octave and the mean square of the paths' errors, px^2.

    The fit starts at `start`, the values of both, positive. That of the errors is also their prior, which counts for
    `weight` frequencies.
    """
    noises, mean = _first_noises(tiles, start[0]), tiles.brightness.mean()
    squared = _fit(tiles, noises, start[1], _first_gains(tiles), steps, start[1], weight)
    return noises[0] + noises[1] * mean, float(squared)


def _first_noises(tiles: TilePowers, variance: float) -> FloatArray:
    """Return the noise at which the fit starts, rows a and b of shape (2, O): half of it is in proportion to light."""
    halves = np.array([variance / 2, variance / 2 / tiles.brightness.mean()])
    return np.repeat(halves[:, None], tiles.octaves.max() + 1, axis=1)


def _first_gains(tiles: TilePowers) -> FloatArray:
    measured, blurred = (np.add.reduceat(power, tiles.cells[:-1], axis=1) for power in (tiles.measured, tiles.blurred))
    gains: FloatArray = measured / blurred
    return gains


@njit(nogil=True)
def _halve(above, below, out):
    quarter = np.float32(0.25)
    for x in range(len(out)):
        for c in range(out.shape[1]):
            out[x, c] = quarter * (above[2 * x, c] + below[2 * x, c] + above[2 * x + 1, c] + below[2 * x + 1, c])


@njit(nogil=True, fastmath={"reassoc"})  # sums in any order
def _squared_difference(first, second):
    total = 0.0
    for i in range(len(first)):
        difference = np.float64(second[i] - first[i])
        total += difference * difference
    return total


@njit(nogil=True, error_model="numpy")
def _energy(light):
    height, width, channels = light.shape[0] // 2, light.shape[1] // 2, light.shape[2]
    rows, total = np.empty((2, width, channels), np.float32), 0.0
    for y in range(height):
        _halve(light[2 * y], light[2 * y + 1], rows[y % 2])
        here, before = rows[y % 2].reshape(-1), rows[(y + 1) % 2].reshape(-1)
        total += _squared_difference(here[:-channels], here[channels:])
        if y > 0:
            total += _squared_difference(before, here)
    return total / (height * width)


def halved_gradient_energy(light: Float32Array) -> float:
    """Return the mean squared gradient of linear light (H, W, C) at half its size, of both directions and all channels.

    They are added up. A pixel at half the size is the mean of 2 x 2 pixels; an odd last row or column is left out. The
    last column has no difference across, and the last row none down. H and W are at least 2.
    """
    return float(_energy(read_only(light)))
