"""Drift by region: near things move further in the picture than far ones.

The drift of a correction holds for one depth. Here each region of a coarse grid gets a factor on it, such that the
spectra of its tiles are likely, its sharp picture is clear, and neighbouring regions are alike. A drift that is right
for a part of the picture may explain the whole of it worse than a drift, a clock offset or a focal length that is right
nowhere. So factors are found for all corrections that the search proposes, before they are compared.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_map
from rsdeblur.deconv.tiling import hat_weights
from rsdeblur.estimate.correction import ACCELERATION, DRIFT, PARAMETERS, Correction, Recording
from rsdeblur.estimate.score import EVIDENCE, PROOFS, Corrected, Score
from rsdeblur.estimate.search import ADJUSTMENTS, MOST_DEVIATIONS, adjusted
from rsdeblur.estimate.sharpness import NATS_PER_FALL
from rsdeblur.image.encoded import ReadoutFrame
from rsdeblur.motion.arguments import is_held
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Factors that are tried, and those with which corrections are compared first.
FACTORS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0])
FEW_FACTORS = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0])
# Two neighbours cost the square of their difference, nats, at most so many: depth has edges.
MOST_SQUARE = 4.0
# Points of the map of depths from one region to the next, and the least factor there: depths are finite.
STEPS, LEAST_FACTOR = 2, 0.02
# Least gain by the factors (nats), and how much more than one drift they must score.
LEAST_GAIN, MORE_SCORE = 20.0, 5.0


class DriftByRegion:
    """Search for a correction with a drift for each region of one photo, whose recording has no translation."""

    def __init__(self, score: Score) -> None:
        (photo,) = score.photos
        self._score, self._photo, self._centres = score, photo, photo.picture.quick.centres
        # The region of each tile of the spectra.
        pairs = zip(photo.picture.spectra.centres, self._centres, strict=True)
        row, col = (np.abs(np.subtract.outer(at, own)).argmin(axis=1) for at, own in pairs)
        self._region = np.add.outer(row * len(self._centres[1]), col).ravel()

    def best(self, places: Sequence[FloatArray], over: FloatArray | None) -> Corrected | None:
        """Return the best of several corrections, adjusted, with its factors; None where one factor does as well.

        `places` have the shape (1, 8). The result must exceed `over`, the best credible correction by one drift, if
        there is one.
        """
        score = self._score
        best, most = None, -np.inf if over is None else score.of(over) - score.cost(over)
        for place in self._different(places):
            factors, gain = self._factors(place, FEW_FACTORS)
            total = score.of(place) - score.cost(place) + gain
            if gain >= EVIDENCE and total > most:
                best, most = (place, factors), total
        if best is None:
            return None
        found, gain = self._adjusted(*best)
        held = np.abs(found.place).max() <= MOST_DEVIATIONS and is_held(found.recordings[0].capture())
        return found if gain >= LEAST_GAIN and held and self._is_credible(found, over) else None

    def _is_credible(self, found: Corrected, over: FloatArray | None) -> bool:
        """Return whether a correction is clearly better than `over` by the whole solve, which no search has misled."""
        score = self._score
        fall = self._photo.whole_sparsity(score.nothing[0]) - self._photo.picture.whole.of(found.recordings[0])
        if over is None:
            return found.score >= PROOFS["regions"].score and fall >= PROOFS["regions"].fall
        least = float(score.whole_falls([over]).sum())
        gained = found.gain - score.cost(found.place) - score.gain(over) + score.cost(over)
        return fall >= least and gained + NATS_PER_FALL * (fall - least) >= MORE_SCORE

    def _different(self, places: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the credible corrections with a drift, without those that differ less than the last step."""
        drift, (_, (*_, least)) = [name in DRIFT for name in PARAMETERS], ADJUSTMENTS["quick"]
        different: list[FloatArray] = []
        for place in places:
            credible = np.abs(place).max() <= MOST_DEVIATIONS and self._score.of(place) >= EVIDENCE
            if place[:, drift].any() and credible and all(np.abs(place - one).max() >= least for one in different):
                different.append(place)
        return different

    def _adjusted(self, place: FloatArray, factors: FloatArray) -> tuple[Corrected, float]:
        """Return a correction and its factors, adjusted in turn, and the nats gained by the factors."""
        names, steps = ADJUSTMENTS["quick"]
        axes, gain = self._score.directions(names, place), 0.0
        for step in steps:
            place = adjusted(place, partial(self._scores, factors), axes, lambda *_: None, steps=(step,))
            factors, gain = self._factors(place, FACTORS)
        return self.corrected(factors, place), gain

    def _scores(self, factors: FloatArray, places: Sequence[FloatArray]) -> list[float]:
        """Return the score of each of several corrections with the same factors."""
        return share_map(lambda place: self.corrected(factors, place).score, places, self._score.threads)

    def corrected(self, factors: FloatArray, place: FloatArray) -> Corrected:
        """Return a correction with factors on its drift, and its score."""
        score = self._score
        found = [with_factors(self._photo.recording, self._correction(place), factors, self._centres)]
        moved = score.under(found)
        gain = moved.gain(score.nothing, score) - score.prior(place)
        fall = float(moved.falls(score.nothing, score).sum())
        total = score.together(gain, fall, found)
        return Corrected(place, found, gain=gain, fall=fall, score=total, factors=factors)

    def _correction(self, place: FloatArray) -> Correction:
        return Correction(*(place[0] * self._score.deviations).tolist())

    def _factors(self, place: FloatArray, factors: FloatArray) -> tuple[FloatArray, float]:
        """Return the best of some factors in each region, shape (R, C), and the nats gained over a factor of 1."""
        correction, photo = self._correction(place), self._photo
        # With a factor of 1, it is the correction itself.
        own, tiles = photo.nats(place[0]), photo.tiles(place[0])
        assert own is not None, "the log describes the exposure"
        others = np.flatnonzero(factors != 1)
        moved = [photo.recording.corrected(_scaled(correction, factor)) for factor in factors[others].tolist()]
        fits = share_map(photo.picture.spectra.fit, moved, self._score.threads)
        falls = NATS_PER_FALL * (np.stack(share_map(photo.picture.quick.tiles, moved, self._score.threads)) - tiles)
        costs = np.zeros((len(factors), len(tiles)))
        for n, fall, fit in zip(others.tolist(), falls, fits, strict=True):
            costs[n] = fall - np.bincount(self._region, photo.leads(fit.nats, own), len(fall))
        labels, total = _alike(costs.reshape(len(factors), len(self._centres[0]), -1), factors)
        return factors[labels], -total


def with_factors(
    recording: Recording, correction: Correction, factors: FloatArray, centres: tuple[FloatArray, FloatArray]
) -> Recording:
    """Return a recording without translation, corrected with factors on the drift in regions of the upright picture.

    `centres` are those of the rows and columns of regions, as shares of the picture's height and width.
    """
    rest = recording.corrected(_scaled(correction, 0.0))
    down, across = (hat_weights(at * STEPS * len(at), STEPS * len(at) + 1) for at in centres)
    depth = ReadoutFrame(rest.camera).back(1.0 / np.maximum(down.T @ factors @ across, LEAST_FACTOR))
    still = replace(Translation.drift((0.0, 0.0), rest.camera, rest.exposure), depth=depth)
    # A factor of 1 belongs to a depth of 1.
    px, acceleration = (np.array(each) / still.middle_depth for each in (correction.drift, correction.acceleration))
    moved = Translation.drift(px, rest.camera, rest.exposure, acceleration=acceleration, known=still)
    return replace(rest, translation=moved)


def _scaled(correction: Correction, factor: float) -> Correction:
    return replace(correction, **{name: factor * getattr(correction, name) for name in (*DRIFT, *ACCELERATION)})


def _alike(costs: FloatArray, factors: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Return the labels (R, C), of `factors`, whose costs (L, R, C), with those between neighbours, are least."""
    # Regions of either colour of a chequerboard change in turn, from several starts.
    count, rows, cols = costs.shape
    apart = np.minimum(np.square(np.subtract.outer(factors, factors)), MOST_SQUARE)
    even = np.add.outer(np.arange(rows), np.arange(cols)) % 2 == 0

    def of_neighbours(labels: NDArray[np.intp]) -> FloatArray:
        total = np.zeros_like(costs)
        total[:, 1:] += apart[:, labels[:-1]]
        total[:, :-1] += apart[:, labels[1:]]
        total[:, :, 1:] += apart[:, labels[:, :-1]]
        total[:, :, :-1] += apart[:, labels[:, 1:]]
        return total

    def settled(labels: NDArray[np.intp]) -> NDArray[np.intp]:
        # They settle after a few changes of all.
        for _ in range(costs.size):
            before = labels
            for colour in (even, ~even):
                best: NDArray[np.intp] = (costs + of_neighbours(labels)).argmin(axis=0)
                labels = np.where(colour, best, labels)
            if np.array_equal(labels, before):
                break
        return labels

    def cost(labels: NDArray[np.intp]) -> float:
        # Each pair of neighbours is counted from both sides.
        total = costs + 0.5 * of_neighbours(labels)
        return float(np.take_along_axis(total, labels[None], axis=0).sum())

    starts = [np.full((rows, cols), label) for label in range(count)]
    found = min(map(settled, [*starts, costs.argmin(axis=0)]), key=cost)
    return found, cost(found)
