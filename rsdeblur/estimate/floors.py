"""Noise of a picture and error of its PSFs, from the spectra of its tiles.

Where a PSF leaves hardly any of the scene, the picture contains noise alone. So noise and detail can be separated
there; at the finest scale they cannot. If the scene shows there nevertheless, in proportion to its power around, the
PSF is wrong: an error of the path of e px changes H by up to `2 pi f e` at the frequency f. Compression, and a phone's
denoising and sharpening, leave noise in proportion to the scene too, and so count as such errors; the rest of their
noise is stronger on coarse scales, so each octave has a noise of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.estimate.noise import OCTAVES
from rsdeblur.estimate.periodograms import (
    DIRECTION,
    DIRECTIONS,
    GRADIENT,
    NOISE_FROM,
    NOISE_TO,
    RADIUS,
    TILE,
    noise_between,
    periodograms,
    power_of,
)
from rsdeblur.kernels.floors import TilePowers, fit_floors
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, FloatImage

# Most tiles that are compared: more take longer, and results hardly change.
MOST_TILES = 32
# Light that counts as clipped, as shares of the range from the darkest to the brightest; the largest share of such
# light, and of pixels like their neighbours, in a tile that has the noise of the picture.
DARKEST, BRIGHTEST, MOST_CLIPPED, MOST_EVEN = 0.0005, 0.98, 0.02, 0.5
# Frequencies above those which the window smears, cycles/px. A scene has a power of its own in each octave and
# direction, noise in each octave.
LOWEST = 1.5 / TILE
# Error of the paths that is assumed, px, and the number of frequencies that this assumption counts for.
ASSUMED, WEIGHT = 0.06, 100.0
STEPS = 80
# A camera that denoises leaves more noise on coarse scales. Ring of frequencies that is compared with the finest,
# cycles/px, and the share of the tiles that have no more noise there: others have texture. White noise has at most the
# first ratio of amplitudes, also in a JPEG; a photo with the second one is processed (`python -m benchmarks.noise`).
COARSE, QUIET, WHITE, PROCESSED = (0.125, 0.177), 0.1, 1.5, 2.5


class Floors(NamedTuple):
    """Noise of a picture and error of its PSFs.

    `octave_noise` is the standard deviation in each of the octaves of :mod:`rsdeblur.estimate.noise`, in the units of
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
    variances, squared = fit_floors(powers, (noise, ASSUMED**2), STEPS, WEIGHT)
    return Floors(tuple((float(peak) * np.sqrt(variances)).tolist()), squared, _processed(power, variances))


def _processed(power: NDArray[np.float32], variances: FloatArray) -> float:
    """Return how clearly noise has the colour that denoising leaves, by quiet tiles and by the fit, from 0 to 1."""
    ratios = np.sqrt(noise_between(power, *COARSE) / noise_between(power, NOISE_FROM, NOISE_TO))
    ratio = min(np.quantile(ratios, QUIET), np.sqrt(variances[-2] / variances[-1]))
    return float(np.clip((ratio - WHITE) / (PROCESSED - WHITE), 0.0, 1.0))


def _noisy(tiles: NDArray[np.float32], least: np.float32) -> NDArray[np.bool_]:
    """Return which tiles (T, TILE, TILE, C) of a picture of range 1, whose minimum is `least`, have its noise."""
    clipped = (tiles - least <= DARKEST) | (tiles - least >= BRIGHTEST)
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
