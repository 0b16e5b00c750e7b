"""Scores of corrections: by spectra, by light streaks, and by the sharp pictures that they lead to.

Corrections are places of a :class:`rsdeblur.estimate.posterior.Posterior`; scores are in nats.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import beside, share_map
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, PhotoLikelihood, Posterior
from rsdeblur.estimate.sharpness import NATS_PER_FALL, SHORTER, QuickSharpness, WholeSharpness
from rsdeblur.estimate.spectra import TileSpectra, spectra_side
from rsdeblur.estimate.streaks import LightStreaks, lead_of
from rsdeblur.types import FloatArray

# Nats that a number of a correction costs, and the least gain that counts.
NATS_PER_NUMBER, WORST_GAIN = 3.0, -1000.0
# Gain (nats) without which the fall does not count where the paths become shorter.
LEAST_OF_SHORTER = 10.0
# Score (nats) of corrections of which half bring the motion nearer to the truth, and by how much more the odds grow
# e-fold: a fit to simulated recordings (docs/developer/decisions.md).
EVEN_SCORE, SCORE_SCALE = 8.0, 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """Corrected recordings, and the score of the correction, nats.

    With factors on the drift, in equal regions of the upright picture, shape (R, C), the drift of the place (N, 8)
    holds where they are 1. `gain` and `fall` are those of :class:`rsdeblur.estimate.Refinement`.
    """

    place: FloatArray
    recordings: list[Recording]
    gain: float
    fall: float
    score: float
    factors: FloatArray | None = None

    @property
    def confidence(self) -> float:
        """How likely the correction brings the motion nearer to the truth."""
        return 1.0 / (1.0 + float(np.exp((EVEN_SCORE - self.score) / SCORE_SCALE))) if self.place.any() else 0.0


class PhotoMeasures:
    """Light streaks and sharp pictures of one photo; what was measured of a row of a place is kept.

    `light` is linear, shape (H, W), of the picture as stored, or already reduced; `recording` is the one given.
    """

    def __init__(self, light: NDArray[np.float32], recording: Recording, streaks: LightStreaks) -> None:
        self._light, self._recording, self.streaks = light, recording, streaks
        self.quick = QuickSharpness(light, recording)
        self._streak_nats: dict[bytes, float] = {}
        self._tiles: dict[bytes, FloatArray] = {}
        self._whole_sparsities: dict[bytes, float] = {}

    def renewed(self) -> PhotoMeasures:
        """Return the same measures for another recording, of which nothing is known yet."""
        other = copy(self)
        other._streak_nats, other._tiles, other._whole_sparsities = {}, {}, {}
        return other

    @cached_property
    def whole(self) -> WholeSharpness:
        """The measure of whole solves, which most photos do not need."""
        return WholeSharpness(self._light, self._recording)

    def streak_nats(self, likelihood: PhotoLikelihood, row: FloatArray) -> float:
        """Return how much likelier the light streaks are than under no motion that explains them."""
        key = row.tobytes()
        if key not in self._streak_nats:
            self._streak_nats[key] = self.streaks.nats(likelihood.corrected(row))
        return self._streak_nats[key]

    def tiles(self, likelihood: PhotoLikelihood, row: FloatArray) -> FloatArray:
        """Return :meth:`rsdeblur.estimate.sharpness.QuickSharpness.tiles` of a row."""
        key = row.tobytes()
        if key not in self._tiles:
            self._tiles[key] = self.quick.tiles(likelihood.corrected(row))
        return self._tiles[key]

    def sparsity(self, likelihood: PhotoLikelihood, row: FloatArray) -> float:
        """Return the logarithm of l1 / l2 by the quick measure; infinite without a motion."""
        try:
            return float(self.tiles(likelihood, row).sum())
        except UNDESCRIBED:
            return np.inf

    def whole_sparsity(self, likelihood: PhotoLikelihood, row: FloatArray) -> float:
        """Return the logarithm of l1 / l2 by the whole solve."""
        key = row.tobytes()
        if key not in self._whole_sparsities:
            self._whole_sparsities[key] = self.whole.of(likelihood.corrected(row))
        return self._whole_sparsities[key]


class _Photo(NamedTuple):
    likelihood: PhotoLikelihood
    measures: PhotoMeasures


class Score:
    """Scores of corrections, in nats, by the posterior and the measures of each photo; threads share several places."""

    def __init__(self, posterior: Posterior, measures: Sequence[PhotoMeasures], threads: int | None) -> None:
        self.posterior, self.nothing, self._threads = posterior, posterior.nothing, threads
        self.photos = [_Photo(*pair) for pair in zip(posterior.photos, measures, strict=True)]

    @classmethod
    def of_photos(
        cls,
        lights: Sequence[NDArray[np.float32]],
        recordings: Sequence[Recording],
        deviations: FloatArray,
        threads: int | None,
    ) -> Score:
        """Return the scores of corrections of the photos of one recording.

        The linear light of each photo, shape (H, W), is that of the picture as stored, or already reduced. `deviations`
        are the standard deviations of the errors of the recordings as given, shape (8,).
        """
        pairs = list(zip(lights, recordings, strict=True))

        def likelihood(light: NDArray[np.float32], recording: Recording) -> PhotoLikelihood:
            spectra = TileSpectra(light, recording, side=spectra_side(recording), threads=1)
            return PhotoLikelihood(spectra, recording, deviations)

        with beside(lambda: list(starmap(LightStreaks, pairs)), threads) as streaks:
            likelihoods = list(starmap(likelihood, pairs))
            measures = [PhotoMeasures(*pair, each) for pair, each in zip(pairs, streaks(), strict=True)]
        return cls(_posterior(likelihoods, deviations, threads), measures, threads)

    def under(self, recordings: Sequence[Recording], deviations: FloatArray) -> Score:
        """Return the scores of corrections of other recordings of the same photos."""
        spectra = (photo.likelihood.spectra for photo in self.photos)
        likelihoods = [PhotoLikelihood(*pair, deviations) for pair in zip(spectra, recordings, strict=True)]
        measures = [photo.measures.renewed() for photo in self.photos]
        return Score(_posterior(likelihoods, deviations, self._threads), measures, self._threads)

    def alone(self, n: int) -> Score:
        """Return the scores by one of the photos alone."""
        return Score(self.posterior.alone(n), [self.photos[n].measures], self._threads)

    @property
    def has_streaks(self) -> bool:
        """Whether a photo has light streaks."""
        return any(photo.measures.streaks.streaks for photo in self.photos)

    def gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra and the light streaks are than without a correction."""
        return self.spectra_gain(place) + self.streak_gain(place)

    def spectra_gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra are than without a correction."""
        return self.posterior.gain(place, self.nothing)

    def streak_gain(self, place: FloatArray) -> float:
        """Return how much likelier the light streaks are than without a correction."""
        leads = map(lead_of, self._streak_nats(place), self._streak_nats(self.nothing))
        return float(sum(leads))

    def streak_nats(self, place: FloatArray) -> float:
        """Return how much likelier the light streaks are than under no motion that explains them."""
        return sum(self._streak_nats(place))

    def _streak_nats(self, place: FloatArray) -> list[float]:
        pairs = zip(self.photos, place, strict=True)
        return [measures.streak_nats(likelihood, row) for (likelihood, measures), row in pairs]

    def falls(self, place: FloatArray) -> FloatArray:
        """Return how much the logarithm of l1 / l2 of each photo falls, shape (N,)."""
        return self._sparsities(self.nothing) - self._sparsities(place)

    def _sparsities(self, place: FloatArray) -> FloatArray:
        pairs = zip(self.photos, place, strict=True)
        return np.array([measures.sparsity(likelihood, row) for (likelihood, measures), row in pairs])

    def over(self, place: FloatArray, other: Score, *, most: float = np.inf) -> float:
        """Return the score of a correction over the recordings that `other` measures, of the same photos, nats.

        The logarithms of l1 / l2 do not fall by more than `most`, and count only where the spectra agree.
        """
        given = other.posterior.nats(other.nothing)
        assert given is not None, "the log describes the exposures"
        streaks = map(lead_of, self._streak_nats(place), other._streak_nats(other.nothing))
        gain = max(self.posterior.lead(place, given) + float(sum(streaks)), WORST_GAIN)
        fall = float((other._sparsities(other.nothing) - self._sparsities(place)).sum())
        return gain if gain < 0 else gain + NATS_PER_FALL * min(fall, most)

    def whole_falls(self, places: Sequence[FloatArray]) -> FloatArray:
        """Return how much the logarithm of l1 / l2 of each photo falls in the whole solve, shape (places, N)."""
        for photo in self.photos:
            _ = photo.measures.whole  # planned once, not by each thread
        given, *others = share_map(self.whole_sparsities, [self.nothing, *places], self._threads)
        return given - np.reshape(others, (len(places), len(self.photos)))

    def whole_sparsities(self, place: FloatArray) -> FloatArray:
        """Return the logarithm of l1 / l2 of each photo by the whole solve, shape (N,)."""
        pairs = zip(self.photos, place, strict=True)
        return np.array([measures.whole_sparsity(likelihood, row) for (likelihood, measures), row in pairs])

    def of(self, place: FloatArray) -> float:
        """Return the score of a correction by its gain and the quick measure."""
        return self._sum(place, float(self.falls(place).sum()) if self.gain(place) >= 0 else 0.0)

    def all(self, places: Sequence[FloatArray]) -> list[float]:
        """Return the score of each of several corrections by their gains and the quick measure."""
        return share_map(self.of, places, self._threads)

    def all_whole(self, places: Sequence[FloatArray]) -> list[float]:
        """Return the score of each of several corrections by their gains and the whole solve."""
        falls = self.whole_falls(places).sum(axis=1).tolist()
        return [self._sum(place, fall) for place, fall in zip(places, falls, strict=True)]

    def cost(self, place: FloatArray) -> float:
        """Return the nats that the numbers of a correction cost."""
        return NATS_PER_NUMBER * float(np.count_nonzero(self.posterior.numbers(place)))

    def corrected(self, place: FloatArray) -> Corrected:
        """Return a correction with its score."""
        recordings, fall = self.posterior.recordings(place), float(self.falls(place).mean())
        return Corrected(place, recordings, gain=self.gain(place), fall=fall, score=self.of(place))

    def _sum(self, place: FloatArray, fall: float) -> float:
        return self.together(self.gain(place), fall, self.posterior.recordings(place))

    def together(self, gain: float, fall: float, recordings: Sequence[Recording]) -> float:
        """Return the score of corrected recordings by their gain and the fall of their sharp pictures."""
        gain = max(gain, WORST_GAIN)
        # The sharp picture counts only where the spectra agree. Far from the truth it may be clear because little blur
        # was removed.
        if gain < 0 or (gain < LEAST_OF_SHORTER and _length(recordings) < SHORTER * self._given_length):
            return gain
        return gain + NATS_PER_FALL * fall

    @cached_property
    def _given_length(self) -> float:
        return _length(self.posterior.recordings(self.nothing))


def _posterior(photos: Sequence[PhotoLikelihood], deviations: FloatArray, threads: int | None) -> Posterior:
    # Several photos are shared by threads; the starts of a search, by which one photo is shared, are fewer.
    return Posterior(photos, deviations, threads=threads if len(photos) > 1 else 1)


def _length(recordings: Sequence[Recording]) -> float:
    """Return the mean length of the paths, px."""
    return float(np.mean([recording.capture().mean_length for recording in recordings]))
