"""Power spectra of the tiles of a blurred picture, and how likely they are under a camera's motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from skimage.transform import resize

from rsdeblur.errors import InputError
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.kernels import whittle
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# Side of the tiles whose spectra are compared, px: small enough for the PSF to be constant within a tile.
TILE = 64

# Frequencies that are compared, cycles/px. Below them the window smears; above them there are only the corners of the
# spectrum.
LOWEST, HIGHEST = 1.5 / TILE, 0.5
# Directions of frequencies in which a scene has a power of its own: the power of a door's edges, say.
DIRECTIONS = 8
# Frequencies that mostly contain noise, cycles/px. Some directions may contain signal there, so the weakest is the
# noise.
NOISE_BAND = 0.35, 0.5
# Candidates for the noise, as multiples of its first estimate.
LEVELS = np.array([0.3, 1.0])
# Weight, in nats, of squared differences between the logarithms of a scene's power in different directions, which
# differs in natural scenes, but not by any factor.
STIFFNESS = 20.0

# Places across the picture at which PSFs are drawn; between them they change little.
COLUMNS = 4
# Time samples of the paths: at least, and per px of the longest one.
LEAST_SAMPLES, SAMPLES_PER_PIXEL = 65, 2


class TileSpectra:
    """Power spectra of overlapping tiles of a blurred picture, and how likely they are under a camera's motion.

    Parameters
    ----------
    light : ndarray, shape (H, W)
        Linear light, of the picture as stored, or already reduced, but not below `side`.
    recording : Recording
        Recording of the picture. Corrected ones can be scored.
    side : int
        Longer side of the picture after reduction, px.

    Raises
    ------
    InputError
        If the reduced picture is smaller than a tile.
    """

    def __init__(self, light: NDArray[np.float32], recording: Recording, *, side: int) -> None:
        camera = recording.camera
        self._scale = min(1.0, side / max(camera.width, camera.height))
        small = camera.scaled(self._scale)
        if min(small.width, small.height) < TILE:
            raise InputError(f"the picture must keep {TILE} px on its shorter side when its longer one has {side} px")
        grey = light
        if light.shape != (small.height, small.width):
            grey = resize(light, (small.height, small.width), order=1, anti_aliasing=True)
        grey = ReadoutFrame(small).image(grey)
        tops, lefts = (_places(n) for n in grey.shape)
        self._rows, cols = tops + (TILE - 1) / 2, lefts + (TILE - 1) / 2
        strips = min(COLUMNS, len(cols))
        self._cols = (np.arange(strips) + 0.5) * grey.shape[1] / strips - 0.5
        nearest = np.abs(cols[:, None] - self._cols).argmin(axis=1)
        self._periodograms = TilePeriodograms(grey, tops, lefts)
        self._place = (np.arange(len(tops))[:, None] * strips + nearest).ravel()
        longest = float(recording.capture(self._scale).probe.lengths.max())
        self._samples = max(LEAST_SAMPLES, int(SAMPLES_PER_PIXEL * longest) + 1)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return len(self._place)

    def expected(self, recording: Recording) -> NDArray[np.float32]:
        """Return the power expected at the places of the PSFs, see :meth:`TilePeriodograms.expected`.

        Raises
        ------
        CoverageError, ClockError, GapError
            If the log does not describe the exposure.
        """
        capture = recording.capture(self._scale)
        paths = BlurPaths.from_capture(capture, self._rows, self._cols, samples=self._samples)
        # So few PSFs are drawn sooner than threads start.
        return self._periodograms.expected(PsfBank.from_paths(paths, threads=1).kernels)

    def fit(self, recording: Recording) -> Fit:
        """Return how likely every tile is under this motion.

        Raises
        ------
        CoverageError, ClockError, GapError
            If the log does not describe the exposure.
        """
        expected = self.expected(recording)
        return Fit(expected, *self._periodograms.fit(expected, self._place))

    def score(self, recording: Recording) -> FloatArray:
        """Return the nats of :meth:`fit`."""
        return self.fit(recording).nats

    def information(self, fit: Fit, slopes: NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
        """Return gradient and Fisher information of every tile, see :func:`rsdeblur.kernels.whittle.information`.

        Parameters
        ----------
        fit : Fit
            Result of :meth:`fit`.
        slopes : ndarray, shape (Q, K, F)
            Derivatives of the logarithm of its expected power.
        """
        measured, fitted = self._periodograms, (fit.gains, fit.levels)
        given = measured.power, measured.noise, fit.expected, slopes, self._place, measured.sectors
        return whittle.information(*given, fitted, STIFFNESS)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Scene and noise fitted to the tiles under one motion.

    Parameters
    ----------
    expected : ndarray, shape (K, F), float32
        Expected power, see :meth:`TilePeriodograms.expected`.
    nats, gains, levels : ndarray
        See :func:`rsdeblur.kernels.whittle.fit_gains`.
    """

    expected: NDArray[np.float32]
    nats: FloatArray
    gains: FloatArray
    levels: FloatArray


class TilePeriodograms:
    """Periodograms of tiles of a picture, and how likely they are under given PSFs.

    Parameters
    ----------
    grey : ndarray, shape (H, W)
        Linear light.
    tops, lefts : ndarray, shape (B,) and (S,)
        First rows and first columns of the tiles.

    Attributes
    ----------
    power, noise : ndarray, shape (B * S, F), float32
        Power of both differences, and of the noise in it, at F frequencies sorted by direction.
    sectors : ndarray, shape (DIRECTIONS + 1,)
        First frequency of each direction, and F.
    """

    def __init__(self, grey: NDArray[np.float32], tops: NDArray[np.intp], lefts: NDArray[np.intp]) -> None:
        fy, fx = np.meshgrid(scipy.fft.fftfreq(TILE), scipy.fft.rfftfreq(TILE), indexing="ij")
        radius, direction = np.hypot(fx, fy), _directions(fy, fx)
        used = np.flatnonzero((radius > LOWEST) & (radius < HIGHEST))
        self._used = used[np.argsort(direction.flat[used], kind="stable")]
        self.sectors = np.searchsorted(direction.flat[self._used], np.arange(DIRECTIONS + 1))
        # Squared response of both differences together.
        gradient = 4 * np.sin(np.pi * fy) ** 2 + 4 * np.sin(np.pi * fx) ** 2
        power = _periodograms(grey, tops, lefts)
        noise = _noise(power, gradient, radius, direction).reshape(-1, 1)
        self.power = np.ascontiguousarray(power.reshape(len(noise), -1)[:, self._used])
        self.noise = (noise * gradient.flat[self._used]).astype(np.float32)
        self._scene = (gradient / np.maximum(radius, LOWEST) ** 2).astype(np.float32).flat[self._used]

    def expected(self, kernels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the power of the scene under `kernels` (B, S, kh, kw), up to a gain, shape (B * S, F)."""
        power = _power_of(kernels)
        # A PSF can make a frequency vanish, but nothing is certain.
        expected: NDArray[np.float32] = np.maximum(power.reshape(-1, power[0, 0].size)[:, self._used], 1e-9)
        expected *= self._scene
        return expected

    def fit(
        self, expected: NDArray[np.float32], place: NDArray[np.intp], *, levels: FloatArray = LEVELS
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return nats, gains and levels of the noise of all tiles, see :func:`rsdeblur.kernels.whittle.fit_gains`.

        Parameters
        ----------
        expected : ndarray, shape (K, F)
            Expected power at K places.
        place : ndarray, shape (B * S,)
            Index of each tile's place.
        levels : ndarray, optional
            Candidates for the noise, as multiples of its first estimate.
        """
        return whittle.fit_gains(self.power, self.noise, expected, place, self.sectors, levels, STIFFNESS)


def _directions(fy: FloatArray, fx: FloatArray) -> NDArray[np.intp]:
    """Return the sector of each frequency, in [0, DIRECTIONS); opposite directions share one."""
    turns = np.arctan2(fy, fx) / np.pi + 0.5
    return np.minimum(np.floor(turns * DIRECTIONS).astype(np.intp), DIRECTIONS - 1)


def _places(n: int) -> NDArray[np.intp]:
    """Return the first pixels of tiles that overlap by about half and span `n` px."""
    return np.round(np.linspace(0, n - TILE, -(-2 * (n - TILE) // TILE) + 1)).astype(np.intp)


def _periodograms(grey: NDArray[np.float32], tops: NDArray[np.intp], lefts: NDArray[np.intp]) -> NDArray[np.float32]:
    """Return the power of both differences in every tile under a Hann window, shape (B, S, TILE, TILE // 2 + 1)."""
    hann = np.sin(np.pi * np.arange(TILE) / TILE) ** 2
    window = (np.outer(hann, hann) / np.sum(hann**2)).astype(np.float32)
    power = np.zeros((len(tops), len(lefts), TILE, TILE // 2 + 1), dtype=np.float32)
    for axis in (0, 1):
        difference = np.diff(grey, axis=axis, prepend=np.take(grey, [0], axis=axis)).astype(np.float32)
        tiles = np.lib.stride_tricks.sliding_window_view(difference, (TILE, TILE))[np.ix_(tops, lefts)]
        power += np.abs(scipy.fft.rfft2(tiles * window)) ** 2
    return power


def _noise(
    power: NDArray[np.float32], gradient: FloatArray, radius: FloatArray, direction: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Return the power of white noise in each tile: the least of several directions at high frequencies.

    It is not :func:`rsdeblur.estimate.noise.noise_level`, which is the average over the picture: a likelihood needs the
    noise of each tile, in the units of its periodogram, and not confused with detail that has a direction.
    """
    high = (radius > NOISE_BAND[0]) & (radius < NOISE_BAND[1])
    white = power / np.maximum(gradient, 1e-9)
    least: NDArray[np.float32] = np.min(
        [white[..., high & (direction == sector)].mean(axis=-1) for sector in range(DIRECTIONS)], axis=0
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


def _power_of(kernels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return |H|^2 as smoothed by the window, shape (B, S, TILE, TILE // 2 + 1)."""
    power: NDArray[Any] = np.abs(scipy.fft.fft2(wrapped(kernels, (TILE, TILE)))) ** 2
    for axis in (2, 3):
        # Power of the Hann window's transform at neighbouring frequencies: 1/6, 2/3, 1/6.
        power = power * (2 / 3) + (np.roll(power, 1, axis) + np.roll(power, -1, axis)) / 6
    return power[..., : TILE // 2 + 1]
