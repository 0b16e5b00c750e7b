"""Periodograms of square tiles of a picture, the power that PSFs leave of them, and how likely they are under PSFs."""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from rsdeblur.kernels import whittle
from rsdeblur.kernels.whittle import smoothed_power
from rsdeblur.types import FloatArray

# Side of the tiles, px: small enough for the PSF to be constant within a tile.
TILE = 64
# Directions of frequencies in which a scene has a power of its own: the power of a door's edges, say.
DIRECTIONS = 8
# Frequencies that are compared, cycles/px. Below them the window smears; above them there are only the corners of the
# spectrum. Those of the ring mostly contain noise.
LOWEST, HIGHEST = 1.5 / TILE, 0.5
NOISE_RING = 0.35, HIGHEST
# Bounds of the rings in which phones leave noise of different power, cycles/px: half octaves. Of all tiles, this share
# has no more than the noise there: others have texture.
RINGS = 2.0 ** np.arange(-4.5, -1.0, 0.5)
QUIET = 0.1
# Weight, in nats, of squared differences between the logarithms of a scene's power in different directions, which
# differs in natural scenes, but not by any factor.
STIFFNESS = 20.0

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


class TilePeriodograms:
    """Periodograms of tiles of a picture in linear light, and how likely they are under given PSFs.

    `tops` (B,) and `lefts` (S,) are the first rows and columns of the tiles; a Gaussian of `softness` px softens the
    scene. Unless the noise is `white`, its colour is measured, because denoising leaves more noise on coarse scales: a
    bare wall would look like a scene that is blurred alike in all directions.

    `power` of both differences and `noise` in it have the shape (B * S, F), at frequencies sorted by direction;
    `sectors` has the first frequency of each direction, and F.
    """

    def __init__(
        self,
        grey: NDArray[np.float32],
        tops: NDArray[np.intp],
        lefts: NDArray[np.intp],
        *,
        softness: float = 0.0,
        white: bool = True,
    ) -> None:
        used = np.flatnonzero((RADIUS > LOWEST) & (RADIUS < HIGHEST))
        self._used = used[np.argsort(DIRECTION.flat[used], kind="stable")]
        self.sectors = np.searchsorted(DIRECTION.flat[self._used], np.arange(DIRECTIONS + 1))
        tiles = np.lib.stride_tricks.sliding_window_view(grey, (TILE, TILE))[np.ix_(tops, lefts)]
        power = periodograms(tiles)
        noise = noise_between(power, *NOISE_RING).reshape(-1, 1)
        self.power = np.ascontiguousarray(power.reshape(len(noise), -1)[:, self._used])
        self.noise = (noise * GRADIENT.flat[self._used]).astype(np.float32)
        # Candidates for the noise, as multiples of its first estimate. If less white noise were possible, short blurs
        # would explain noise as detail.
        self._levels = np.array([1.0] if white else [0.3, 1.0])
        if not white:
            self.noise *= self._colour()
        scene = GRADIENT / np.maximum(RADIUS, LOWEST) ** 2 * np.exp(-np.square(2 * np.pi * softness * RADIUS))
        self._scene = scene.astype(np.float32).flat[self._used]

    def _colour(self) -> NDArray[np.float32]:
        """Return the power of the noise at all frequencies, as multiples of white noise.

        In each ring, the direction with the least power contains the least of the scene, and quiet tiles contain
        hardly anything else.
        """
        relative = self.power / self.noise
        ring, direction = np.digitize(RADIUS, RINGS).flat[self._used], DIRECTION.flat[self._used]
        multiples = np.ones(len(RINGS) + 2)
        for n in range(len(RINGS), -1, -1):
            cells = [relative[:, (ring == n) & (direction == k)] for k in range(DIRECTIONS)]
            means = [cell.mean(axis=1) for cell in cells if cell.shape[1] > 1]
            quiet = float(np.quantile(np.min(means, axis=0), QUIET)) if means else 0.0
            multiples[n] = max(quiet, multiples[n + 1])
        return multiples[ring].astype(np.float32)

    def expected(self, kernels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the power of the scene under `kernels` (B, S, kh, kw), up to a gain, shape (B * S, F)."""
        power = power_of(kernels)
        # A PSF can make a frequency vanish, but nothing is certain.
        expected: NDArray[np.float32] = np.maximum(power.reshape(-1, power[0, 0].size)[:, self._used], 1e-9)
        expected *= self._scene
        return expected

    def fit(
        self, expected: NDArray[np.float32], place: NDArray[np.intp], *, threads: int | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return nats, gains and levels of the noise of all tiles, see :func:`rsdeblur.kernels.whittle.fit_gains`.

        `expected` is the power at K places, `place` the index of each tile's.
        """
        return whittle.fit_gains(self.tiles_under(expected, place), self._levels, STIFFNESS, threads=threads)

    def tiles_under(self, expected: NDArray[np.float32], place: NDArray[np.intp]) -> whittle.Tiles:
        """Return the tiles with the power expected at K places and the index of each tile's place; see `fit`."""
        return whittle.Tiles(self.power, self.noise, expected, place, self.sectors)
