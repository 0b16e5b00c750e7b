"""Posterior of corrections of a recording, given the spectra of one or several of its photos.

A place is a correction of each photo in standard deviations of the prior, shape (N, 8): one row for each photo, in the
order of `PARAMETERS`. Numbers that belong to the recording (`SHARED`) are equal in all rows; drift and acceleration
belong to the photo. :class:`TileSpectra` are the power spectra of the tiles of a blurred picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_map
from rsdeblur.errors import ClockError, CoverageError, GapError, InputError
from rsdeblur.estimate.correction import PARAMETERS, SHARED, Correction, Recording
from rsdeblur.image.encoded import upright
from rsdeblur.kernels import whittle
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.noise import STIFFNESS, TILE, TilePeriodograms
from rsdeblur.types import FloatArray

Measure = TypeVar("Measure")

# Softness of photos that no motion explains, from lens, demosaicing and denoising: standard deviation, px of the
# picture as stored.
SOFTNESS = 0.7

# Mean length of the blur to which pictures are reduced, px.
LONGEST_BLUR = 20.0
# Reduction of the picture for its spectra, which leaves out the finest detail, because cameras denoise and sharpen it;
# and bounds of the longer side, px.
LEAST_REDUCTION, SPECTRA_SIDES = 2.4, (320, 480)
# Errors of a log that does not describe the exposure.
UNDESCRIBED = (CoverageError, ClockError, GapError)
# Nats of a tile beyond which it has little more weight: the edge of a door, say, looks like a straight blur beyond
# doubt.
MOST_NATS = 30.0
# Tiles that together count as one observation. They overlap, their frequencies are correlated by the window, and no
# scene follows its model exactly; with full weight, the errors of the model would outweigh the sensors.
TILES_AS_ONE = 0.5
# Fewer tiles than these prove less.
LEAST_TILES = 40
# Step of numerical derivatives, longest step of the descents at first and at last, and change at which they end:
# standard deviations.
STEP, TRUST, SETTLED = 0.05, (0.7, 1.5), 0.03
# Gain at which descents end, nats, and the most steps.
LEAST_STEP_GAIN, STEPS = 0.02, 6
# Fits and recordings that are kept: more than threads that descend at a time.
RECENT = 16
# Bound of the derivatives of the logarithm of the power, where it nearly vanishes.
STEEPEST = 8.0


class TileSpectra:
    """Power spectra of overlapping tiles of a blurred picture, and how likely they are under a camera's motion.

    `light` is linear, shape (H, W), of the picture as stored, or already reduced, but not below 640 px; InputError if
    it is smaller than a tile. Corrected recordings can be scored, too. Methods raise the errors of a log that does not
    describe the exposure.
    """

    def __init__(self, light: NDArray[np.float32], recording: Recording) -> None:
        camera = recording.camera
        longer, shorter = max(camera.width, camera.height), min(camera.width, camera.height)
        if shorter < TILE:
            raise InputError(f"the picture must have at least {TILE} px on its shorter side, got {shorter}")
        low, high = (max(side, TILE * longer / shorter + 1) for side in SPECTRA_SIDES)
        side = int(np.clip(longer / max(LEAST_REDUCTION, recording.capture().mean_length / LONGEST_BLUR), low, high))
        self._scale = min(1.0, side / longer)
        grey = upright(light, camera, self._scale)
        tops, lefts = (tile_places(n) for n in grey.shape)
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
        return Fit(expected, *self._periodograms.fit(expected, self._place, threads=1))

    def information(self, fit: Fit, slopes: NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
        """Return gradient and information of every tile for `slopes` (Q, K, F), of the log of the expected power."""
        measured = self._periodograms
        tiles = measured.tiles_under(fit.expected, self._place)
        return whittle.information(tiles, slopes, (fit.gains, fit.levels), STIFFNESS)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Scene and noise fitted to the tiles under one motion, see :func:`rsdeblur.kernels.whittle.fit_gains`."""

    expected: NDArray[np.float32]  # that of :meth:`TilePeriodograms.expected`, shape (K, F)
    nats: FloatArray
    gains: FloatArray
    levels: FloatArray


def softness(scale: float) -> float:
    """Return the standard deviation (px) of the softness of a photo that is smoothed and reduced by a factor."""
    return float(np.hypot(SOFTNESS * scale, 0.5 * (1 - scale)))


def tile_places(n: int) -> NDArray[np.intp]:
    """Return the first pixels of tiles that overlap by about half and span `n` px."""
    return np.round(np.linspace(0, n - TILE, -(-2 * (n - TILE) // TILE) + 1)).astype(np.intp)


def kept(measure: Callable[[FloatArray], Measure], most: int | None = None) -> Callable[[FloatArray], Measure]:
    """Return a function of a row of a place that keeps what it measures, of at most so many rows."""
    cached = lru_cache(most)(lambda key: measure(np.frombuffer(key)))
    return lambda row: cached(row.tobytes())


class PhotoLikelihood:
    """Likelihood of corrections of one photo by its spectra; corrections are rows of a place."""

    def __init__(self, spectra: TileSpectra, recording: Recording, deviations: FloatArray) -> None:
        self.spectra, self.recording = spectra, recording
        self._tiles = TILES_AS_ONE * max(spectra.tiles, LEAST_TILES)
        #: The recording with a correction. Several measures ask for that of their place.
        self.corrected = kept(lambda row: recording.corrected(Correction(*(row * deviations).tolist())), RECENT)
        # Descents ask for the fit of their last place again.
        self._fit = kept(lambda row: spectra.fit(self.corrected(row)), RECENT)
        #: The nats of all tiles; None if the log does not describe the exposure.
        self.nats = kept(self._described)

    def _described(self, row: FloatArray) -> FloatArray | None:
        try:
            return self._fit(row).nats
        except UNDESCRIBED:
            return None

    def leads(self, nats: FloatArray, others: FloatArray) -> FloatArray:
        """Return how much likelier each tile is with one motion than with another; none counts beyond the bound."""
        bounded: FloatArray = MOST_NATS * np.tanh((others - nats) / MOST_NATS) / self._tiles
        return bounded

    def information(self, row: FloatArray, at: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return gradient and Fisher information for the parameters `at`, without the prior."""
        fit = self._fit(row)
        slopes = np.array([self._slope(row, index, fit.expected) for index in at])
        gradient, information = self.spectra.information(fit, slopes)
        # A tile that alone would gain more than the bound has less weight.
        solved = np.linalg.solve(information + TILES_AS_ONE * np.eye(len(at)), gradient[..., None])[..., 0]
        weight = 1.0 / (1.0 + 0.5 * (solved * gradient).sum(axis=1) / MOST_NATS)
        weight /= self._tiles
        return weight @ gradient, np.tensordot(weight, information, 1)

    def _slope(self, row: FloatArray, index: int, expected: NDArray[np.float32]) -> NDArray[np.float32]:
        for step in (STEP, -STEP):
            moved = row.copy()
            moved[index] += step
            try:
                slope: NDArray[np.float32] = np.log(self.spectra.expected(self.corrected(moved)) / expected) / step
            except UNDESCRIBED:
                continue
            return slope.clip(-STEEPEST, STEEPEST)
        return np.zeros_like(expected)


OnePhoto = TypeVar("OnePhoto", bound=PhotoLikelihood)


class Posterior(Generic[OnePhoto]):
    """How likely corrections are, given the photos' spectra and how uncertain the recording is.

    `deviations` (8,), in the units of :class:`Correction`, are those of the recordings' errors; 0 for what is known.
    """

    def __init__(self, photos: Sequence[OnePhoto], deviations: FloatArray, threads: int | None) -> None:
        self.photos, self.deviations, self.threads = list(photos), deviations, threads
        # The starts of a search, by which one photo is shared, are more than the tiles of a photo are worth.
        self._threads = threads if len(photos) > 1 else 1
        self.nothing: FloatArray = np.zeros((len(self.photos), len(PARAMETERS)))
        #: Names of the parameters that are not known.
        self.free = tuple(np.array(PARAMETERS)[deviations > 0].tolist())
        # The numbers of a place; those that the photos share count once.
        self._counted = np.array(
            [[n == 0 or name not in SHARED for name in PARAMETERS] for n in range(len(self.photos))]
        )

    def recordings(self, place: FloatArray) -> list[Recording]:
        """Return the recordings with a correction."""
        return [photo.corrected(row) for photo, row in zip(self.photos, place, strict=True)]

    def directions(self, names: Iterable[str], changed_by: FloatArray | None = None) -> list[FloatArray]:
        """Return unit steps (N, 8) along the numbers of some parameters that are free, and that a place changes."""
        steps = []
        for name in names:
            if name not in self.free:
                continue
            for photos in [slice(None)] if name in SHARED else range(len(self.photos)):
                step = np.zeros_like(self.nothing)
                step[photos, PARAMETERS.index(name)] = 1.0
                if changed_by is None or changed_by[step > 0].any():
                    steps.append(step)
        return steps

    def numbers(self, place: FloatArray) -> FloatArray:
        """Return the numbers of a place, those that the photos share once."""
        numbers: FloatArray = place[self._counted]
        return numbers

    def nats(self, place: FloatArray) -> list[FloatArray] | None:
        """Return the nats of all tiles of each photo; None if a log does not describe its exposure."""
        found = self._nats(place)
        described = [nats for nats in found if nats is not None]
        return described if len(described) == len(found) else None

    def _nats(self, place: FloatArray) -> list[FloatArray | None]:
        return share_map(lambda n: self.photos[n].nats(place[n]), range(len(self.photos)), self._threads)

    def lead(self, place: FloatArray, others: Sequence[FloatArray]) -> float:
        """Return how much more likely a correction is than motions with the nats `others`, whose prior is ignored."""
        return float(self.photo_leads(place, others).sum() - self.prior(place))

    def photo_leads(self, place: FloatArray, others: Sequence[FloatArray]) -> FloatArray:
        """Return how much likelier each photo is than with the nats `others`, without the prior, shape (N,)."""
        triples = zip(self.photos, self._nats(place), others, strict=True)
        return np.array([-np.inf if own is None else photo.leads(own, each).sum() for photo, own, each in triples])

    def prior(self, place: FloatArray) -> float:
        """Return how much less likely a correction is than none before any photo is seen, nats."""
        numbers = self.numbers(place)
        return 0.5 * float(numbers @ numbers)

    def spread(self, place: FloatArray, free: Sequence[str] | None = None) -> FloatArray:
        """Return the standard deviations of all numbers of a place, as shares of those of the prior, shape (N, 8).

        They follow from the information and from how far the photos' gradients disagree (Huber's sandwich).
        """
        spread, steps = np.zeros_like(self.nothing), self.directions(self.free if free is None else free)
        if not steps:
            return spread
        gradients, matrix = self._information(place, steps)
        inverse = np.linalg.inv(damped(matrix, 0.0))
        count, shared = len(self.photos), np.array([np.count_nonzero(step) == len(self.photos) for step in steps])
        apart = np.where(shared, gradients - gradients.mean(axis=0), 0.0)
        scatter = apart.T @ apart * count / max(count - 1, 1)
        for step, deviation in zip(
            steps, np.sqrt(np.diag(inverse @ scatter @ inverse) + np.diag(inverse)), strict=True
        ):
            spread += deviation * step
        return spread

    def descend(self, place: FloatArray, free: Sequence[str]) -> FloatArray:
        """Return the local maximum that Fisher scoring, by damped steps of bounded length, reaches with some free."""
        directions = self.directions(free)
        damping, trust = 0.01, TRUST[0]
        for _ in range(STEPS):
            gradients, matrix = self._information(place, directions)
            given = self.nats(place)
            assert given is not None, "the log describes the exposures"
            at = np.array([place[direction > 0][0] for direction in directions])
            gained, moved = 0.0, place
            step = np.zeros(len(directions))
            while trust > SETTLED and not gained > 0:
                step = -np.linalg.solve(damped(matrix, damping), gradients.sum(axis=0) + at)
                step *= min(1.0, trust / max(float(np.abs(step).max()), 1e-9))
                moved = place + np.tensordot(step, directions, 1)
                gained = self.lead(moved, given) + self.prior(place)
                damping, trust = (damping / 4, trust * 1.3) if gained > 0 else (max(6 * damping, 0.05), trust / 2)
            if not gained > 0:
                break
            place, damping, trust = moved, max(damping, 1e-3), min(trust, TRUST[1])
            if np.abs(step).max() < SETTLED or gained < LEAST_STEP_GAIN:
                break
        return place

    def _information(self, place: FloatArray, steps: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the gradient of each photo along K directions, shape (N, K), and the information of all, (K, K)."""
        count, jacobian = len(self.photos), np.array(steps)

        def measure(n: int) -> tuple[FloatArray, FloatArray]:
            gradient, information = np.zeros(len(steps)), np.zeros((len(steps), len(steps)))
            own, at = np.nonzero(jacobian[:, n])
            gradient[own], information[np.ix_(own, own)] = self.photos[n].information(place[n], at.tolist())
            return gradient, information

        gradients, matrices = zip(*share_map(measure, range(count), self._threads), strict=True)
        return np.array(gradients), np.sum(matrices, axis=0)


def damped(information: FloatArray, damping: float) -> FloatArray:
    """Return an information matrix with the prior's, damped as Levenberg and Marquardt do."""
    matrix: FloatArray = information + np.eye(len(information)) + damping * np.diag(np.diag(information) + 1)
    return matrix


def costs_of(motions: Sequence[Sequence[FloatArray] | None]) -> FloatArray:
    """Return how much less likely each motion is than the likeliest one of each tile, nats; no tile decides alone.

    Each motion has the nats of the tiles of each photo; None where no log describes it, which costs infinitely much.
    """
    described, costs = [each for each in motions if each is not None], np.full(len(motions), np.inf)
    photos = (np.array(tiles) for tiles in zip(*described, strict=True))
    bounded = [np.minimum(tiles - tiles.min(axis=0), MOST_NATS).mean(axis=1) for tiles in photos]
    costs[[each is not None for each in motions]] = np.sum(bounded, axis=0) / TILES_AS_ONE
    return costs
