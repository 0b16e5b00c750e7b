"""Noise of a picture and its gradient energy, and the error of its PSFs, all in linear light.

The noise is estimated from the finest detail (:func:`noise_level`), or in octaves, together with the error of the PSFs
(:func:`measure_floors`). Where a PSF leaves hardly any of the scene, the picture contains noise alone. So noise and
detail can be separated there; at the finest scale they cannot. If the scene shows there nevertheless, in proportion to
its power around, the PSF is wrong: an error of the path of e px changes H by up to `2 pi f e` at the frequency f.
Compression, and a phone's denoising and sharpening, leave noise in proportion to the scene too, and so count as such
errors; the rest of their noise is stronger on coarse scales, so each octave has a noise of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from rsdeblur.kernels.noise import TilePowers, fit_floors, halved_gradient_energy
from rsdeblur.kernels.shrink import gradient
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.periodograms import (
    DIRECTION,
    DIRECTIONS,
    GRADIENT,
    LOWEST,
    NOISE_RING,
    QUIET,
    RADIUS,
    TILE,
    noise_between,
    periodograms,
    power_of,
)
from rsdeblur.types import FloatArray, FloatImage

# Limits of the octaves, cycles/px: noise has a power of its own below the first, between both, and above, because
# cameras remove the finest noise first.
OCTAVES = (0.125, 0.25)
# Median magnitude of a standard normal variable.
MEDIAN = 0.67449

# Most tiles that are compared: more take longer, and results hardly change.
MOST_TILES = 32
# Light between these shares of the range from the darkest to the brightest is not clipped; the largest share of clipped
# light, and of pixels like their neighbours, in a tile that has the noise of the picture.
UNCLIPPED, MOST_CLIPPED, MOST_EVEN = (0.0005, 0.98), 0.02, 0.5
# Error of the paths that is assumed, px, and the number of frequencies that this assumption counts for.
ASSUMED, WEIGHT = 0.06, 100.0
# A camera that denoises leaves more noise on coarse scales. Ring of frequencies that is compared with the finest,
# cycles/px. White noise has at most the first ratio of amplitudes there, also in a JPEG; a photo with the second one is
# processed (`python -m benchmarks.noise`).
COARSE, PROCESSED = (0.125, 0.177), (1.5, 2.5)


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
    # Share of all frequencies that each octave contains.
    shares = np.diff([0.0, *(np.pi * limit**2 for limit in OCTAVES), 1.0])
    return float(np.sqrt(shares @ np.square(octaves)))


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
    """Return the root mean square of the noise estimates of all channels and of blocks of about `TILE` px."""
    # (1, -2, 1) along both axes has 36 times the variance of white noise.
    rough = np.abs(np.diff(np.diff(light, n=2, axis=0), n=2, axis=1)) / 6
    if rough.size == 0:
        return 0.0
    rows, cols = (np.array_split(np.arange(n), max(1, round(n / TILE))) for n in rough.shape[:2])
    medians = [np.median(rough[r[0] : r[-1] + 1, c[0] : c[-1] + 1], axis=(0, 1)) for r in rows for c in cols]
    return float(np.sqrt(np.mean(np.square(medians)))) / MEDIAN


class Floors(NamedTuple):
    """Noise of a picture and error of its PSFs.

    `octave_noise` is the standard deviation in each of the octaves of :data:`OCTAVES`, in the units of
    the picture; white noise has the same in all. `path_error` is the mean square of the errors of the paths, px^2; it
    is too low, because the powers of the scene absorb a part. `processed` says how clearly the noise has the colour
    that denoising leaves, from 0 (white) to 1.
    """

    octave_noise: tuple[float, ...]
    path_error: float
    processed: float = 0.0


def measure_floors(light: FloatImage, bank: PsfBank) -> Floors | None:
    """Return the noise of a picture in linear light, shape (H, W, C), and the error of its PSFs.

    A few PSFs that are spread over it are enough. None if the picture is smaller than a tile, or all tiles are clipped
    or even.
    """
    least = light.min()
    peak = light.max() - least
    if min(light.shape[:2]) < TILE or not peak > 0:
        return None
    places = _places(*light.shape[:2])
    # Scaled to 1, so that no power overflows.
    tiles = np.stack([light[top : top + TILE, left : left + TILE] for top, left in places]) / peak
    kept = _noisy(tiles, least / peak)
    if not kept.any():
        return None
    places, tiles = places[kept], tiles[kept]
    rows, cols = (
        np.abs(centres[:, None] - at - (TILE - 1) / 2).argmin(axis=0)
        for centres, at in zip((bank.rows, bank.cols), places.T, strict=True)
    )
    power = periodograms(np.moveaxis(tiles, -1, 1)).mean(axis=1)
    powers = _powers(tiles, power, bank.kernels[rows, cols])
    # Most frequencies contain little of the scene.
    noise = float(np.quantile(powers.measured / powers.noise, 0.2))
    steps = 80
    variances, squared = fit_floors(powers, (noise, ASSUMED**2), steps, WEIGHT)
    return Floors(tuple((float(peak) * np.sqrt(variances)).tolist()), squared, _processed(power, variances))


def _processed(power: NDArray[np.float32], variances: FloatArray) -> float:
    """Return how clearly noise has the colour that denoising leaves, by quiet tiles and by the fit, from 0 to 1."""
    ratios = np.sqrt(noise_between(power, *COARSE) / noise_between(power, *NOISE_RING))
    ratio = min(np.quantile(ratios, QUIET), np.sqrt(variances[-2] / variances[-1]))
    return float(np.interp(ratio, PROCESSED, (0.0, 1.0)))


def _noisy(tiles: NDArray[np.float32], least: np.float32) -> NDArray[np.bool_]:
    """Return which tiles (T, TILE, TILE, C) of a picture of range 1, whose minimum is `least`, have its noise."""
    clipped = (tiles - least <= UNCLIPPED[0]) | (tiles - least >= UNCLIPPED[1])
    even = (np.diff(tiles, axis=1)[:, :, 1:] == 0) & (np.diff(tiles, axis=2)[:, 1:] == 0)
    noisy: NDArray[np.bool_] = (clipped.mean(axis=(1, 2, 3)) <= MOST_CLIPPED) & (
        even.all(axis=3).mean(axis=(1, 2)) <= MOST_EVEN
    )
    return noisy


def _places(height: int, width: int) -> NDArray[np.intp]:
    """Return first row and column of tiles that are spread evenly over a picture, shape (T, 2)."""
    rows = int(np.clip(round((MOST_TILES * height / width) ** 0.5), 1, MOST_TILES))
    tops, lefts = (
        np.unique(np.linspace(0, n - TILE, min(count, -(-2 * n // TILE))).astype(np.intp))
        for n, count in ((height, rows), (width, MOST_TILES // rows))
    )
    return np.stack(np.meshgrid(tops, lefts, indexing="ij"), axis=-1).reshape(-1, 2)


def _powers(tiles: NDArray[np.float32], power: NDArray[np.float32], kernels: NDArray[np.float32]) -> TilePowers:
    """Return the powers of tiles (T, TILE, TILE, C) with these periodograms, each with its kernel (T, kh, kw)."""
    octave = np.digitize(RADIUS, OCTAVES)
    cell = octave * DIRECTIONS + DIRECTION
    used = np.flatnonzero(RADIUS > LOWEST)
    used = used[np.argsort(cell.flat[used], kind="stable")]
    _, first = np.unique(cell.flat[used], return_index=True)
    measured, left = (
        each.reshape(len(tiles), -1)[:, used].astype(np.float64) for each in (power, power_of(kernels[None])[0])
    )
    scene = (GRADIENT / RADIUS.clip(LOWEST) ** 2).flat[used]
    noise = GRADIENT.flat[used]
    # Nothing is certain, neither a frequency without power nor one that the PSF removes.
    return TilePowers(
        measured=np.maximum(measured, 1e-20),
        blurred=np.maximum(left, 1e-9) * scene,
        error=noise * scene,
        noise=noise,
        brightness=np.maximum(tiles.mean(axis=(1, 2, 3), dtype=np.float64), 1e-3),
        cells=np.append(first, len(used)).astype(np.int64),
        octaves=octave.flat[used[first]].astype(np.int64),
    )
