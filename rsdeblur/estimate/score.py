"""Scores of corrections: by spectra, by light streaks, and by the sharp pictures that they lead to.

Corrections are places of a :class:`rsdeblur.estimate.posterior.Posterior`; scores are in nats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import starmap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import beside, once, share_map
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, PhotoLikelihood, Posterior, TileSpectra, kept
from rsdeblur.estimate.sharpness import NATS_PER_FALL, SHORTER, QuickSharpness, WholeSharpness
from rsdeblur.estimate.streaks import LightStreaks, lead_of
from rsdeblur.types import FloatArray

# Nats that a number of a correction costs.
NATS_PER_NUMBER = 3.0
# Nats that count as evidence. With less, a correction is not adjusted, neither an acceleration nor factors by region
# nor light streaks are followed, and the fall does not count where the paths become shorter.
EVIDENCE = 10.0
# Nats of the spectra below which a correction is not compared by the sharp picture.
HOPELESS = -20.0
# Score (nats) of corrections of which half bring the motion nearer to the truth, and by how much more the odds grow
# e-fold: a fit to simulated recordings (docs/developer/decisions.md).
EVEN_SCORE, SCORE_SCALE = 8.0, 12.0


class Proof(NamedTuple):
    """Least score of a correction, nats, and least fall of the logarithm of l1 / l2 in the whole solve."""

    score: float
    fall: float


# What a correction needs to be accepted: usually; where the smaller of both falls counts; of the readout time alone,
# because little else looks like that; of guesses, which need not be proved wrong; and with factors by region, where no
# correction by one drift is accepted. Right recordings score up to 32 with little fall; of 220, two score 34 and 50
# with factors (`python -m benchmarks.refine`).
PROOFS = {
    "usual": Proof(30.0, 0.01),
    "smaller": Proof(36.0, 0.004),
    "readout": Proof(15.0, 0.005),
    "guess": Proof(EVIDENCE, -np.inf),
    "regions": Proof(70.0, 0.01),
}


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """Corrected recordings, and the score of the correction, nats; see :class:`rsdeblur.estimate.Refinement`."""

    place: FloatArray
    recordings: list[Recording]
    gain: float
    fall: float
    score: float
    factors: FloatArray | None = None  # on the drift of the place, in regions of the upright picture, shape (R, C)

    @property
    def confidence(self) -> float:
        """How likely the correction brings the motion nearer to the truth."""
        return 1.0 / (1.0 + float(np.exp((EVEN_SCORE - self.score) / SCORE_SCALE))) if self.place.any() else 0.0


@dataclass(frozen=True, eq=False)
class Picture:
    """A blurred photo and what measures motions by it."""

    light: NDArray[np.float32]  # linear, shape (H, W), as stored or already reduced
    recording: Recording  # as given
    spectra: TileSpectra
    streaks: LightStreaks
    quick: QuickSharpness

    @once
    def whole(self) -> WholeSharpness:
        """The measure of whole solves, which most photos do not need."""
        return WholeSharpness(self.light, self.recording)


class Photo(PhotoLikelihood):
    """Measures of corrections of one photo, or of another recording of it; what was measured of a row is kept."""

    def __init__(self, picture: Picture, recording: Recording, deviations: FloatArray) -> None:
        super().__init__(picture.spectra, recording, deviations)
        self.picture = picture
        #: How much likelier the light streaks are than under no motion that explains them.
        self.streak_nats = kept(lambda row: picture.streaks.nats(self.corrected(row)))
        #: :meth:`rsdeblur.estimate.sharpness.QuickSharpness.tiles` of a row.
        self.tiles = kept(lambda row: picture.quick.tiles(self.corrected(row)))
        #: The logarithm of l1 / l2 by the whole solve.
        self.whole_sparsity = kept(lambda row: picture.whole.of(self.corrected(row)))

    def sparsity(self, row: FloatArray) -> float:
        """Return the logarithm of l1 / l2 by the quick measure; infinite without a motion."""
        try:
            return float(self.tiles(row).sum())
        except UNDESCRIBED:
            return np.inf


class Score(Posterior[Photo]):
    """Scores of corrections of the photos of one recording, in nats."""

    @classmethod
    def of_photos(
        cls,
        lights: Sequence[NDArray[np.float32]],
        recordings: Sequence[Recording],
        deviations: FloatArray,
        threads: int | None,
    ) -> Score:
        """Return the scores by the linear light of each photo (H, W), as stored, or already reduced."""
        pairs = list(zip(lights, recordings, strict=True))
        with beside(lambda: list(starmap(LightStreaks, pairs)), threads) as streaks:
            spectra, quick = list(starmap(TileSpectra, pairs)), list(starmap(QuickSharpness, pairs))
            pictures = map(Picture, lights, recordings, spectra, streaks(), quick)
        return cls([Photo(each, each.recording, deviations) for each in pictures], deviations, threads)

    def under(self, recordings: Sequence[Recording]) -> Score:
        """Return the scores of corrections of other recordings of the same photos."""
        pairs = zip((photo.picture for photo in self.photos), recordings, strict=True)
        return Score([Photo(*pair, self.deviations) for pair in pairs], self.deviations, self.threads)

    def gain(self, place: FloatArray, over: Score | None = None) -> float:
        """Return how much likelier spectra and light streaks are than without a correction, of `over` if it is given.

        `over` are the scores of corrections of other recordings of the same photos.
        """
        return self.spectra_gain(place, over) + self.streak_gain(place, over)

    def spectra_gain(self, place: FloatArray, over: Score | None = None) -> float:
        """Return the part of the spectra in :meth:`gain`."""
        given = (over or self).nats(self.nothing)
        assert given is not None, "the log describes the exposures"
        return self.lead(place, given)

    def streak_gain(self, place: FloatArray, over: Score | None = None) -> float:
        """Return the part of the light streaks in :meth:`gain`."""
        return float(sum(map(lead_of, self.streak_nats(place), (over or self).streak_nats(self.nothing))))

    def streak_nats(self, place: FloatArray) -> list[float]:
        """Return how much likelier the light streaks of each photo are than under no motion that explains them."""
        return [photo.streak_nats(row) for photo, row in zip(self.photos, place, strict=True)]

    def falls(self, place: FloatArray, over: Score | None = None) -> FloatArray:
        """Return how much the logarithm of l1 / l2 of each photo falls, shape (N,); `over` is that of :meth:`gain`."""
        return (over or self).sparsities(self.nothing) - self.sparsities(place)

    def sparsities(self, place: FloatArray) -> FloatArray:
        """Return the logarithm of l1 / l2 of each photo by the quick measure, shape (N,)."""
        return np.array([photo.sparsity(row) for photo, row in zip(self.photos, place, strict=True)])

    def over(self, place: FloatArray, other: Score, *, most: float = np.inf) -> float:
        """Return the score of a correction over the recordings that `other` measures, see :meth:`gain`, nats.

        The logarithms of l1 / l2 do not fall by more than `most`, and count only where the spectra agree.
        """
        gain, fall = _finite(self.gain(place, other)), float(self.falls(place, other).sum())
        return gain if gain < 0 else gain + NATS_PER_FALL * min(fall, most)

    def whole_falls(self, places: Sequence[FloatArray]) -> FloatArray:
        """Return how much the logarithm of l1 / l2 of each photo falls in the whole solve, shape (places, N)."""
        for photo in self.photos:
            _ = photo.picture.whole  # planned once, not by each thread
        given, *others = share_map(self.whole_sparsities, [self.nothing, *places], self.threads)
        return given - np.reshape(others, (len(places), len(self.photos)))

    def whole_sparsities(self, place: FloatArray) -> FloatArray:
        """Return the logarithm of l1 / l2 of each photo by the whole solve, shape (N,)."""
        return np.array([photo.whole_sparsity(row) for photo, row in zip(self.photos, place, strict=True)])

    def of(self, place: FloatArray) -> float:
        """Return the score of a correction by its gain and the quick measure."""
        return self._sum(place, float(self.falls(place).sum()) if self.gain(place) >= 0 else 0.0)

    def all(self, places: Sequence[FloatArray]) -> list[float]:
        """Return the score of each of several corrections by their gains and the quick measure."""
        return share_map(self.of, places, self.threads)

    def all_whole(self, places: Sequence[FloatArray]) -> list[float]:
        """Return the score of each of several corrections by their gains and the whole solve."""
        falls = self.whole_falls(places).sum(axis=1).tolist()
        return [self._sum(place, fall) for place, fall in zip(places, falls, strict=True)]

    def cost(self, place: FloatArray) -> float:
        """Return the nats that the numbers of a correction cost."""
        return NATS_PER_NUMBER * float(np.count_nonzero(self.numbers(place)))

    def corrected(self, place: FloatArray) -> Corrected:
        """Return a correction with its score."""
        recordings, fall = self.recordings(place), float(self.falls(place).mean())
        return Corrected(place, recordings, gain=self.gain(place), fall=fall, score=self.of(place))

    def _sum(self, place: FloatArray, fall: float) -> float:
        return self.together(self.gain(place), fall, self.recordings(place))

    def together(self, gain: float, fall: float, recordings: Sequence[Recording]) -> float:
        """Return the score of corrected recordings by their gain and the fall of their sharp pictures."""
        gain = _finite(gain)
        # The sharp picture counts only where the spectra agree. Far from the truth it may be clear because little blur
        # was removed.
        if gain < 0 or (gain < EVIDENCE and mean_lengths(recordings).mean() < SHORTER * self._given_length):
            return gain
        return gain + NATS_PER_FALL * fall

    @once
    def _given_length(self) -> float:
        return float(mean_lengths(self.recordings(self.nothing)).mean())


def _finite(gain: float) -> float:
    """Return a gain, nats; one of a correction with which the log does not describe the exposure is finite, too."""
    return max(gain, -NATS_PER_FALL)


def mean_lengths(recordings: Sequence[Recording]) -> FloatArray:
    """Return the mean length of the paths of each recording, px."""
    return np.array([recording.capture().mean_length for recording in recordings])
