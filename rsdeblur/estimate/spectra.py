"""Power spectra of the tiles of a blurred picture, and how likely they are under a camera's motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from skimage.transform import resize

from rsdeblur.errors import InputError
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# Side of the tiles whose spectra are compared, px: small enough for the PSF to be constant within a tile.
TILE = 64

# Frequencies that are compared, cycles/px. Below them the window smears; above them there are only the corners of the
# spectrum.
LOWEST, HIGHEST = 1.5 / TILE, 0.5
# Frequencies that mostly contain noise, cycles/px. Some directions may contain signal there, so the weakest of eight is
# the noise.
NOISE_BAND = 0.35, 0.5
DIRECTIONS = 8
# Candidates for the power of the scene and of the noise, as multiples of their first estimates.
GAINS = np.exp(np.linspace(-2.5, 2.5, 8)).astype(np.float32)
NOISES = np.array([0.3, 1.0], dtype=np.float32)
# Power above this multiple of what is expected, as along a strong edge, counts by its logarithm.
TAIL = np.float32(2.0)


class TileSpectra:
    """Power spectra of overlapping tiles of a blurred picture, and how likely they are under a camera's motion.

    Parameters
    ----------
    light : ndarray, shape (H, W)
        Linear light.
    camera : Camera
        Camera of the picture. Other clocks and focal lengths can be scored, but not another size.
    side : int
        Longer side of the picture after reduction, px.

    Raises
    ------
    InputError
        If the reduced picture is smaller than a tile.
    """

    def __init__(self, light: NDArray[np.float32], camera: Camera, *, side: int) -> None:
        self._scale = min(1.0, side / max(light.shape))
        small = camera.scaled(self._scale)
        if min(small.width, small.height) < TILE:
            raise InputError(f"the picture must keep {TILE} px on its shorter side when its longer one has {side} px")
        grey = light
        if self._scale < 1:
            grey = resize(light, (small.height, small.width), order=1, anti_aliasing=True)
        grey = ReadoutFrame(small).image(grey)
        tops, lefts = (_places(n) for n in grey.shape)
        self._rows, self._cols = tops + (TILE - 1) / 2, lefts + (TILE - 1) / 2
        self._measured = TilePeriodograms(grey, tops, lefts)

    def score(self, log: GyroLog, camera: Camera, exposure: Exposure) -> FloatArray:
        """Return the negative log-likelihood, in nats, of every tile under this motion.

        Raises
        ------
        CoverageError, ClockError, GapError
            If the log does not describe the exposure.
        """
        capture = ReadoutFrame(camera.scaled(self._scale)).capture(log, exposure)
        bank = PsfBank.from_paths(BlurPaths.from_capture(capture, self._rows, self._cols))
        return self._measured.fit(bank.kernels).ravel()


class TilePeriodograms:
    """Periodograms of tiles of a picture, and how likely they are under given PSFs.

    Parameters
    ----------
    grey : ndarray, shape (H, W)
        Linear light.
    tops, lefts : ndarray, shape (B,) and (S,)
        First rows and first columns of the tiles.
    """

    def __init__(self, grey: NDArray[np.float32], tops: NDArray[np.intp], lefts: NDArray[np.intp]) -> None:
        fy, fx = np.meshgrid(scipy.fft.fftfreq(TILE), scipy.fft.rfftfreq(TILE), indexing="ij")
        radius = np.hypot(fx, fy)
        self._used = (radius > LOWEST) & (radius < HIGHEST)
        # Squared response of both differences together.
        gradient = 4 * np.sin(np.pi * fy) ** 2 + 4 * np.sin(np.pi * fx) ** 2
        power = _periodograms(grey, tops, lefts)
        self._noise = _noise(power, gradient, fy, fx)[..., None] * gradient[self._used].astype(np.float32)
        self._power = power[..., self._used]
        self._scene = (gradient / np.maximum(radius, LOWEST) ** 2).astype(np.float32)

    def fit(
        self,
        kernels: NDArray[np.float32],
        *,
        gains: NDArray[np.float32] = GAINS,
        noises: NDArray[np.float32] = NOISES,
    ) -> FloatArray:
        """Return the negative log-likelihood, in nats, of the tiles under `kernels` (B or 1, S or 1, kh, kw)."""
        expected = (_power_of(kernels) * self._scene)[..., self._used]
        excess = (self._power - self._noise).mean(axis=-1).clip(1e-12)
        scene = (excess / expected.mean(axis=-1))[..., None] * expected
        likeliest = np.full(excess.shape, np.inf, dtype=np.float32)
        for noise in noises:
            for gain in gains:
                variance = gain * scene + noise * self._noise
                surprise = np.log(variance) + TAIL * np.log1p(self._power / (TAIL * variance))
                np.minimum(likeliest, surprise.sum(axis=-1), out=likeliest)
        return likeliest.astype(np.float64)


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


def _noise(power: NDArray[np.float32], gradient: FloatArray, fy: FloatArray, fx: FloatArray) -> NDArray[np.float32]:
    """Return the power of white noise in each tile: the least of several directions at high frequencies.

    It is not :func:`rsdeblur.estimate.noise.noise_level`, which is the average over the picture: a likelihood needs the
    noise of each tile, in the units of its periodogram, and not confused with detail that has a direction.
    """
    radius, angle = np.hypot(fy, fx), np.arctan2(fy, fx) / np.pi + 0.5
    high = (radius > NOISE_BAND[0]) & (radius < NOISE_BAND[1])
    white = power / np.maximum(gradient, 1e-9)
    sectors = [high & (np.minimum(angle * DIRECTIONS // 1, DIRECTIONS - 1) == k) for k in range(DIRECTIONS)]
    least: NDArray[np.float32] = np.min([white[..., sector].mean(axis=-1) for sector in sectors], axis=0)
    return np.maximum(least, 1e-12).astype(np.float32)


def _power_of(kernels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return |H|^2 as smoothed by the window, shape (B, S, TILE, TILE // 2 + 1)."""
    tall, wide = kernels.shape[2:]
    # A PSF larger than a tile wraps around, so that its spectrum has the same frequencies as the tile's.
    down, across = (-(-n // TILE) for n in (tall, wide))
    room = ((0, 0), (0, 0), (0, down * TILE - tall), (0, across * TILE - wide))
    kernels = np.pad(kernels, room).reshape(*kernels.shape[:2], down, TILE, across, TILE).sum(axis=(2, 4))
    power: NDArray[Any] = np.abs(scipy.fft.fft2(kernels)) ** 2
    for axis in (2, 3):
        # Power of the Hann window's transform at neighbouring frequencies: 1/6, 2/3, 1/6.
        power = power * (2 / 3) + (np.roll(power, 1, axis) + np.roll(power, -1, axis)) / 6
    return power[..., : TILE // 2 + 1]
