"""Noise of a picture and its gradient energy, and the error of its PSFs, all in linear light.

The noise is estimated from the finest detail (:func:`noise_level`), or in octaves, together with the error of the PSFs
(:func:`measure_floors`). Where a PSF leaves hardly any of the scene, the picture contains noise alone. So noise and
detail can be separated there; at the finest scale they cannot. If the scene shows there nevertheless, in proportion to
its power around, the PSF is wrong: an error of the path of e px changes H by up to `2 pi f e` at the frequency f.
Compression, and a phone's denoising and sharpening, leave noise in proportion to the scene too, and so count as such
errors; the rest of their noise is stronger on coarse scales, so each octave has a noise of its own.

All of this, and how likely a picture is under PSFs (:class:`TilePeriodograms`), is measured in periodograms of square
tiles.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from rsdeblur.kernels import whittle
from rsdeblur.kernels.noise import fit_cells
from rsdeblur.kernels.shrink import gradient
from rsdeblur.kernels.whittle import smoothed_power
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, FloatImage

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

_DOWN, _ACROSS = np.meshgrid(fft.fftfreq(TILE), fft.rfftfreq(TILE), indexing="ij")
# Frequencies of `numpy.fft.rfft2` of a tile, cycles/px, and the squared response of both differences together.
RADIUS: FloatArray = np.hypot(_ACROSS, _DOWN)
GRADIENT: FloatArray = 4 * np.sin(np.pi * _DOWN) ** 2 + 4 * np.sin(np.pi * _ACROSS) ** 2
# Sector of each frequency, in [0, DIRECTIONS); opposite directions share one.
DIRECTION: NDArray[np.intp] = np.minimum(
    np.floor((np.arctan2(_DOWN, _ACROSS) / np.pi + 0.5) * DIRECTIONS).astype(np.intp), DIRECTIONS - 1
)
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
# Rows at half the size that are measured at a time, within a second-level cache.
HALF_ROWS = 16
# Error of the paths that is assumed, px, and the number of frequencies that this assumption counts for.
ASSUMED, WEIGHT = 0.06, 100.0
# A camera that denoises leaves more noise on coarse scales. Ring of frequencies compared with the finest, cycles/px.
# White noise has at most the first ratio of amplitudes, a processed photo the second (`python -m benchmarks.noise`).
COARSE, PROCESSED = (0.125, 0.177), (1.5, 2.5)


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
        power += np.abs(fft.rfft2(difference * window)) ** 2
    return power


def noise_between(power: NDArray[np.float32], low: float, high: float) -> NDArray[np.float32]:
    """Return the power of white noise in each tile: the least of all directions between two frequencies, cycles/px.

    A scene and a blur have a direction, noise has none.
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
    spectra = fft.rfft2(grid.reshape(-1, *grid.shape[2:]), (TILE, TILE))
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
        """Return the power of the noise at all frequencies, as multiples of white noise: that of quiet directions."""
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
        """Return nats, gains and levels, see :func:`rsdeblur.kernels.whittle.fit_gains`, under :meth:`tiles_under`."""
        return whittle.fit_gains(self.tiles_under(expected, place), self._levels, STIFFNESS, threads=threads)

    def tiles_under(self, expected: NDArray[np.float32], place: NDArray[np.intp]) -> whittle.Tiles:
        """Return the tiles with the power expected at K places and the index of each tile's place; see `fit`."""
        return whittle.Tiles(self.power, self.noise, expected, place, self.sectors)


def noise_level(light: FloatImage) -> float:
    """Estimate the standard deviation of the noise: the root mean square over a picture (H, W, C) and its channels.

    Noise depends on brightness, so each block has its own estimate, from the median magnitude of its second differences
    along both axes (Donoho and Johnstone, Biometrika 81, 1994; Immerkaer, Computer Vision and Image Understanding 64,
    1996), and the squares are averaged. It is 0 for a picture of less than 3 x 3 px.
    """
    # Demosaicing, denoising and JPEG remove the finest noise first, so the picture at half its size counts, too. An
    # average of four pixels has half the noise; but detail passes for noise there, up to as much again.
    return max(_blockwise(light), _blockwise(halved(light)))


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
    """Return the mean squared gradient of a picture (H, W, C) at half its size, where noise has less weight.

    Both directions and all channels are added up; the last column has no difference across, and the last row none down.
    """
    if min(light.shape[:2]) < 2:  # too narrow to be halved
        return sum(float(np.square(part).sum(axis=2).mean()) for part in gradient(light, periodic=False))
    height, width, total = light.shape[0] // 2, light.shape[1] // 2, 0.0
    for top in range(0, height, HALF_ROWS):
        rows = light[2 * top : 2 * min(top + HALF_ROWS + 1, height), : 2 * width]
        pairs = rows[::2] + rows[1::2]
        # Channel by channel: along so short an axis NumPy takes several times as long.
        for channel in np.moveaxis(pairs, -1, 0):
            sums = channel[:, ::2] + channel[:, 1::2]
            steps = sums[:HALF_ROWS, 1:] - sums[:HALF_ROWS, :-1], sums[1:] - sums[:-1]
            total += sum(float(np.vecdot(step, step).sum(dtype=np.float64)) for step in steps)
    # The mean of 2 x 2 pixels is a quarter of their sum.
    return float(total / (16 * height * width))


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
    """Noise of a picture and error of its PSFs."""

    octave_noise: tuple[float, ...]  # standard deviation in each of the octaves, in the units of the picture
    path_error: float  # mean square, px^2; too low, because the powers of the scene absorb a part
    processed: float = 0.0  # how clearly the noise has the colour that denoising leaves, from 0 (white) to 1


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
    variances, squared = _fit_floors(tiles, power, bank.kernels[rows, cols])
    # How clearly noise has the colour that denoising leaves, by quiet tiles and by the fit.
    ratios = np.sqrt(noise_between(power, *COARSE) / noise_between(power, *NOISE_RING))
    ratio = min(np.quantile(ratios, QUIET), np.sqrt(variances[-2] / variances[-1]))
    processed = float(np.interp(ratio, PROCESSED, (0.0, 1.0)))
    return Floors(tuple((float(peak) * np.sqrt(variances)).tolist()), squared, processed)


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


def _fit_floors(
    tiles: NDArray[np.float32], power: NDArray[np.float32], kernels: NDArray[np.float32]
) -> tuple[FloatArray, float]:
    """Return the mean variance of the noise in each octave and the mean square of the paths' errors, px^2.

    The tiles (T, TILE, TILE, C) have the periodograms `power` and the `kernels` (T, kh, kw). The power expected of a
    tile is `V = g_c (E + e^2 D) + (a_o + b_o m) N`. E is the power of scene and blur, D that which an error of 1 px of
    the paths adds, N that of white noise, and m the tile's brightness. Each cell c of neighbouring frequencies has a
    gain g_c of its own, because scenes differ in scale and direction; the floors a_o and b_o of each octave o, and e^2,
    are those of all tiles. The fit minimises the sum of `P / V + log V`, the Itakura-Saito divergence from the
    periodogram P: each step multiplies a parameter by the ratio of the two parts of its derivative (Fevotte, Bertin and
    Durrieu, Neural Computation 21, 2009), without the square root there, which halves the steps.
    """
    octave = np.digitize(RADIUS, OCTAVES)
    cell = octave * DIRECTIONS + DIRECTION
    used = np.flatnonzero(RADIUS > LOWEST)
    used = used[np.argsort(cell.flat[used], kind="stable")]
    first = np.unique(cell.flat[used], return_index=True)[1]
    cells, octave_of = np.append(first, len(used)), octave.flat[used[first]]
    octaves = np.unique(octave_of, return_index=True)[1]
    # In units of the power of white noise. Not `[:, used]`, in whose result the values of a tile are not contiguous:
    # that takes three times as long.
    measured, left = (
        each.reshape(len(tiles), -1).take(used, axis=1).astype(np.float64)
        for each in (power, power_of(kernels[None])[0])
    )
    noise, scene = GRADIENT.flat[used], (GRADIENT / RADIUS.clip(LOWEST) ** 2).flat[used]
    # Nothing is certain, neither a frequency without power nor one that the PSF removes.
    powers = np.maximum(measured, 1e-20), np.maximum(left, 1e-9) * scene
    light = np.maximum(tiles.mean(axis=(1, 2, 3), dtype=np.float64), 1e-3)[:, None]
    gains = np.divide(*(np.add.reduceat(each, first, axis=1) for each in powers))
    measured, blurred = (each / noise for each in powers)
    sums = np.empty((4, *gains.shape))
    # Most frequencies contain little of the scene. At first, half of the noise is in proportion to light.
    even = np.full(len(octaves), np.quantile(measured, 0.2) / 2)
    bright, squared, start = even / light.mean(), ASSUMED**2, ASSUMED**2
    for _ in range(80):
        floors = (even + bright * light).take(octave_of, axis=1)
        fit_cells(measured, blurred, scene, cells, floors, squared, gains, sums)
        ups, downs = np.add.reduceat(sums[:2], octaves, axis=2)
        even *= ups.sum(axis=0) / downs.sum(axis=0)
        bright *= (ups * light).sum(axis=0) / (downs * light).sum(axis=0)
        more, less = sums[2:].sum(axis=(1, 2))
        # The assumption is also the prior of the errors.
        squared *= float((WEIGHT * start / squared**2 + more) / (WEIGHT / squared + less))
    return even + bright * light.mean(), squared
