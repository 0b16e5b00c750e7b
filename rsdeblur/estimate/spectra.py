"""Power spectra of the tiles of a blurred picture, and how likely they are under a camera's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import InputError
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.frame import upright
from rsdeblur.kernels import whittle
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.periodograms import STIFFNESS, TILE, TilePeriodograms
from rsdeblur.types import FloatArray

# Softness of photos that no motion explains, from lens, demosaicing and denoising: standard deviation, px of the
# picture as stored.
SOFTNESS = 0.7

# Mean length of the blur to which pictures are reduced, px.
LONGEST_BLUR = 20.0
# Reduction of the picture for its spectra, which leaves out the finest detail, because cameras denoise and sharpen it;
# and bounds of the longer side, px.
LEAST_REDUCTION, SPECTRA_SIDES = 2.4, (320, 480)


class TileSpectra:
    """Power spectra of overlapping tiles of a blurred picture, and how likely they are under a camera's motion.

    `light` is linear, shape (H, W), of the picture as stored, or already reduced, but not below `side`, the longer side
    of the picture after reduction, px; InputError if it is smaller than a tile then. Corrected recordings can be
    scored, too. Threads share the tiles of a fit; 1 suits callers whose threads share motions. Methods raise the errors
    of a log that does not describe the exposure.
    """

    def __init__(
        self, light: NDArray[np.float32], recording: Recording, *, side: int, threads: int | None = None
    ) -> None:
        camera, self._threads = recording.camera, threads
        self._scale = min(1.0, side / max(camera.width, camera.height))
        small = camera.scaled(self._scale)
        if min(small.width, small.height) < TILE:
            raise InputError(f"the picture must keep {TILE} px on its shorter side when its longer one has {side} px")
        grey = upright(light, camera, self._scale)
        tops, lefts = (_places(n) for n in grey.shape)
        self._rows, cols = tops + (TILE - 1) / 2, lefts + (TILE - 1) / 2
        strips = min(4, len(cols))  # PSFs change little across the picture
        self._cols = (np.arange(strips) + 0.5) * grey.shape[1] / strips - 0.5
        nearest = np.abs(cols[:, None] - self._cols).argmin(axis=1)
        #: Centres of the rows and columns of tiles, as shares of the upright picture's height and width.
        self.centres = self._rows / grey.shape[0], cols / grey.shape[1]
        self._periodograms = TilePeriodograms(grey, tops, lefts, softness=softness(self._scale), white=False)
        self._place = (np.arange(len(tops))[:, None] * strips + nearest).ravel()
        longest = float(recording.capture(self._scale).probe.lengths.max())
        self._samples = max(65, int(2 * longest) + 1)  # at least two per px of the longest path

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
