"""Power spectra of the tiles of a blurred picture, and how likely they are under a camera's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import InputError
from rsdeblur.estimate.correction import Recording
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
from rsdeblur.image.frame import upright
from rsdeblur.kernels import whittle
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# Frequencies that are compared, cycles/px. Below them the window smears; above them there are only the corners of the
# spectrum.
LOWEST, HIGHEST = 1.5 / TILE, 0.5
# Bounds of the rings in which phones leave noise of different power, cycles/px: half octaves. Of all tiles, this share
# has no more than the noise there.
RINGS = 2.0 ** np.arange(-4.5, -1.0, 0.5)
QUIET = 0.1
# Candidates for the noise, as multiples of its first estimate.
LEVELS = np.array([0.3, 1.0])
# Weight, in nats, of squared differences between the logarithms of a scene's power in different directions, which
# differs in natural scenes, but not by any factor.
STIFFNESS = 20.0

# Softness of photos that no motion explains, from lens, demosaicing and denoising: standard deviation, px of the
# picture as stored.
SOFTNESS = 0.7

# Reduction of the picture for its spectra. The finest detail is left out, because cameras denoise and sharpen it; the
# blur is at most so long, px; and the longer side is within these bounds, px.
LEAST_REDUCTION, LONGEST_BLUR = 2.4, 20.0
SPECTRA_SIDES = 320, 480

# Places across the picture at which PSFs are drawn; between them they change little.
COLUMNS = 4
# Time samples of the paths: at least, and per px of the longest one.
LEAST_SAMPLES, SAMPLES_PER_PIXEL = 65, 2


class TileSpectra:
    """Power spectra of overlapping tiles of a blurred picture, and how likely they are under a camera's motion.

    `light` is linear, shape (H, W), of the picture as stored, or already reduced, but not below `side`, the longer side
    of the picture after reduction, px; InputError if it is smaller than a tile then. Corrected recordings can be
    scored, too. Threads share the tiles of a fit; 1 suits callers whose threads share motions. Methods raise the errors
    of a log that does not describe the exposure.
    """

    def __init__(
        self,
        light: NDArray[np.float32],
        recording: Recording,
        *,
        side: int,
        threads: int | None = None,
    ) -> None:
        camera, self._threads = recording.camera, threads
        self._scale = min(1.0, side / max(camera.width, camera.height))
        small = camera.scaled(self._scale)
        if min(small.width, small.height) < TILE:
            raise InputError(f"the picture must keep {TILE} px on its shorter side when its longer one has {side} px")
        grey = upright(light, camera, self._scale)
        tops, lefts = (_places(n) for n in grey.shape)
        self._rows, cols = tops + (TILE - 1) / 2, lefts + (TILE - 1) / 2
        strips = min(COLUMNS, len(cols))
        self._cols = (np.arange(strips) + 0.5) * grey.shape[1] / strips - 0.5
        nearest = np.abs(cols[:, None] - self._cols).argmin(axis=1)
        #: Centres of the rows and columns of tiles, as shares of the upright picture's height and width.
        self.centres = self._rows / grey.shape[0], cols / grey.shape[1]
        self._periodograms = TilePeriodograms(grey, tops, lefts, softness=softness(self._scale), white=False)
        self._place = (np.arange(len(tops))[:, None] * strips + nearest).ravel()
        longest = float(recording.capture(self._scale).probe.lengths.max())
        self._samples = max(LEAST_SAMPLES, int(SAMPLES_PER_PIXEL * longest) + 1)

    @property
    def tiles(self) -> int:
        """Number of tiles."""
        return len(self._place)

    def expected(self, recording: Recording) -> NDArray[np.float32]:
        """Return the power expected at the places of the PSFs, see :meth:`TilePeriodograms.expected`."""
        capture = recording.capture(self._scale)
        paths = BlurPaths.from_capture(capture, self._rows, self._cols, samples=self._samples)
        # So few PSFs are drawn sooner than threads start.
        return self._periodograms.expected(PsfBank.from_paths(paths, threads=1).kernels)

    def fit(self, recording: Recording) -> Fit:
        """Return how likely every tile is under this motion."""
        expected = self.expected(recording)
        return Fit(expected, *self._periodograms.fit(expected, self._place, threads=self._threads))

    def score(self, recording: Recording) -> FloatArray:
        """Return the nats of :meth:`fit`."""
        return self.fit(recording).nats

    def information(self, fit: Fit, slopes: NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
        """Return gradient and Fisher information of every tile, see :func:`rsdeblur.kernels.whittle.information`.

        `slopes` are derivatives of the logarithm of the fit's expected power, shape (Q, K, F).
        """
        measured = self._periodograms
        tiles = measured.tiles_under(fit.expected, self._place)
        return whittle.information(tiles, slopes, (fit.gains, fit.levels), STIFFNESS, threads=self._threads)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Scene and noise fitted to the tiles under one motion, see :func:`rsdeblur.kernels.whittle.fit_gains`.

    `expected` is that of :meth:`TilePeriodograms.expected`, shape (K, F).
    """

    expected: NDArray[np.float32]
    nats: FloatArray
    gains: FloatArray
    levels: FloatArray


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
        noise = noise_between(power, NOISE_FROM, NOISE_TO).reshape(-1, 1)
        self.power = np.ascontiguousarray(power.reshape(len(noise), -1)[:, self._used])
        self.noise = (noise * GRADIENT.flat[self._used]).astype(np.float32)
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
        self,
        expected: NDArray[np.float32],
        place: NDArray[np.intp],
        *,
        levels: FloatArray = LEVELS,
        threads: int | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return nats, gains and levels of the noise of all tiles, see :func:`rsdeblur.kernels.whittle.fit_gains`.

        `expected` is the power at K places, `place` the index of each tile's, `levels` are the candidates for the
        noise, as multiples of its first estimate.
        """
        return whittle.fit_gains(self.tiles_under(expected, place), levels, STIFFNESS, threads=threads)

    def tiles_under(self, expected: NDArray[np.float32], place: NDArray[np.intp]) -> whittle.Tiles:
        """Return the tiles with the power expected at K places and the index of each tile's place; see `fit`."""
        return whittle.Tiles(self.power, self.noise, expected, place, self.sectors)


def softness(scale: float) -> float:
    """Return the standard deviation (px) of the softness of a photo that is smoothed and reduced by a factor."""
    return float(np.hypot(SOFTNESS * scale, 0.5 * (1 - scale)))


def spectra_side(recording: Recording) -> int:
    """Return the longer side to which a picture is reduced for its spectra, px."""
    camera = recording.camera
    longer, shorter = max(camera.width, camera.height), min(camera.width, camera.height)
    length = recording.capture().mean_length
    low, high = (max(side, TILE * longer / shorter + 1) for side in SPECTRA_SIDES)
    return int(np.clip(longer / max(LEAST_REDUCTION, length / LONGEST_BLUR), low, high))


def _places(n: int) -> NDArray[np.intp]:
    """Return the first pixels of tiles that overlap by about half and span `n` px."""
    return np.round(np.linspace(0, n - TILE, -(-2 * (n - TILE) // TILE) + 1)).astype(np.intp)
