"""Drift by region: near things move further in the picture than far ones.

The drift of a correction holds for one depth. Here each region of a coarse grid gets a factor on it, such that the
spectra of its tiles are likely, its sharp picture is clear, and neighbouring regions are alike. A drift that is right
for a part of the picture may explain the whole of it worse than a drift, a clock offset or a focal length that is right
nowhere. So factors are found for all corrections that the search proposes, before they are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_map
from rsdeblur.deconv.tiling import hat_weights
from rsdeblur.estimate.correction import ACCELERATION, DRIFT, PARAMETERS, Correction, Recording
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, QuickSharpness
from rsdeblur.estimate.search import (
    ADJUSTED,
    LEAST_ADJUSTED,
    LEAST_FALL,
    MOST_DEVIATIONS,
    QUICK_STEPS,
    adjusted,
)
from rsdeblur.estimate.worth import Corrected, Worth, cost
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.motion.arguments import is_held
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Factors that are tried, and those with which corrections are compared first.
FACTORS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0])
FEW_FACTORS = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0])
# Corrections that differ less than this, standard deviations, are one.
APART = 0.3
# Nats that two neighbours cost for the square of their difference, and the largest square that counts: depth has edges.
NATS_PER_SQUARE, MOST_SQUARE = 1.0, 4.0
# Most changes of all regions in turn; they settle after a few.
MOST_SWEEPS = 20
# Points of the map of depths from one region to the next, and the least factor there: depths are finite.
STEPS, LEAST_FACTOR = 2, 0.02
# Least gain by the factors (nats), with the few ones and with all, and how much more than one drift they must be worth.
LEAST_OF_FEW, LEAST_GAIN, MORE_WORTH = 10.0, 20.0, 5.0
# Least worth (nats) where no correction by one drift is accepted. Of 220 right recordings, two are worth 34 and 50.
LEAST_ALONE = 70.0


class DriftByRegion:
    """Search for a correction with a drift for each region.

    Parameters
    ----------
    worth : Worth
        Worth of corrections.
    quick : QuickSharpness
        The quick measure of the sharp picture.
    recording : Recording
        The recording as given, without a translation.
    deviations : ndarray, shape (8,)
        Standard deviations of its errors.
    threads : int or None
        Threads that share the work; None means all processors.
    """

    def __init__(
        self,
        worth: Worth,
        quick: QuickSharpness,
        recording: Recording,
        deviations: FloatArray,
        threads: int | None,
    ) -> None:
        self._worth, self._quick, self._recording = worth, quick, recording
        self._deviations, self._threads = deviations, threads
        self._region = _nearest(worth.posterior.spectra.centres, quick.centres)

    def best(self, places: Sequence[FloatArray], over: FloatArray | None) -> Corrected | None:
        """Return the best of several corrections, adjusted, with its factors.

        Parameters
        ----------
        places : sequence of ndarray, shape (8,)
            Corrections.
        over : ndarray, shape (8,), or None
            The best credible correction by one drift, which it must exceed; None if there is none.

        Returns
        -------
        Corrected or None
            None where one factor explains the picture as well.
        """
        best, most = None, -np.inf if over is None else self._worth.of(over) - cost(over)
        for place in self._different(places):
            factors, gain = self._factors(place, FEW_FACTORS)
            worth = self._worth.of(place) - cost(place) + gain
            if gain >= LEAST_OF_FEW and worth > most:
                best, most = (place, factors), worth
        if best is None:
            return None
        found, gain = self._adjusted(*best)
        held = np.abs(found.place).max() <= MOST_DEVIATIONS and is_held(found.recording.capture())
        return found if gain >= LEAST_GAIN and held and self._is_credible(found, over) else None

    def _is_credible(self, found: Corrected, over: FloatArray | None) -> bool:
        """Return whether a correction is clearly better than `over` by the whole solve, which no search has misled."""
        fall = self._worth.whole_fall(found.recording)
        if over is None:
            return found.worth >= LEAST_ALONE and fall >= LEAST_FALL
        (least,) = self._worth.whole_falls([over])
        more = found.gain - cost(found.place) - self._worth.gain(over) + cost(over) + NATS_PER_FALL * (fall - least)
        return fall >= least and more >= MORE_WORTH

    def _different(self, places: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the credible corrections with a drift, without those that are nearly the same."""
        drift = [name in DRIFT for name in PARAMETERS]
        different: list[FloatArray] = []
        for place in places:
            credible = np.abs(place).max() <= MOST_DEVIATIONS and self._worth.of(place) >= LEAST_ADJUSTED
            if place[drift].any() and credible and all(np.abs(place - one).max() >= APART for one in different):
                different.append(place)
        return different

    def _adjusted(self, place: FloatArray, factors: FloatArray) -> tuple[Corrected, float]:
        """Return a correction and its factors, adjusted in turn, and the nats gained by the factors."""
        axes = [at for at in np.flatnonzero(place).tolist() if PARAMETERS[at] in ADJUSTED]
        gain = 0.0
        for step in QUICK_STEPS:
            place = adjusted(place, partial(self._worths, factors), axes, lambda *_: None, steps=(step,))
            factors, gain = self._factors(place, FACTORS)
        return self._worth.by_region(place, self._moved(place, factors), factors), gain

    def _worths(self, factors: FloatArray, places: Sequence[FloatArray]) -> list[float]:
        """Return the worth of each of several corrections with the same factors."""

        def worth(place: FloatArray) -> float:
            return self._worth.by_region(place, self._moved(place, factors), factors).worth

        return share_map(worth, places, self._threads)

    def _correction(self, place: FloatArray) -> Correction:
        return Correction(*(place * self._deviations).tolist())

    def _moved(self, place: FloatArray, factors: FloatArray) -> Recording:
        return with_factors(self._recording, self._correction(place), factors, self._quick.centres)

    def _factors(self, place: FloatArray, factors: FloatArray) -> tuple[FloatArray, float]:
        """Return the best of some factors in each region, shape (R, C), and the nats gained over a factor of 1."""
        correction, posterior = self._correction(place), self._worth.posterior
        # With a factor of 1, it is the correction itself.
        own, tiles = posterior.nats(place), self._worth.tiles(place)
        assert own is not None, "the log describes the exposure"
        others = np.flatnonzero(factors != 1)
        moved = [self._recording.corrected(_scaled(correction, factor)) for factor in factors[others].tolist()]
        nats = share_map(posterior.spectra.score, moved, self._threads)
        falls = NATS_PER_FALL * (np.stack(share_map(self._quick.tiles, moved, self._threads)) - tiles)
        costs = np.zeros((len(factors), len(tiles)))
        for n, fall, each in zip(others.tolist(), falls, nats, strict=True):
            costs[n] = fall - np.bincount(self._region, posterior.leads(each, own), len(fall))
        labels, total = _alike(costs.reshape(len(factors), len(self._quick.centres[0]), -1), factors)
        return factors[labels], -total


def with_factors(
    recording: Recording, correction: Correction, factors: FloatArray, centres: tuple[FloatArray, FloatArray]
) -> Recording:
    """Return the corrected recording with factors on its drift.

    Parameters
    ----------
    recording, correction
        The recording as given, without a translation, and its correction.
    factors : ndarray, shape (R, C)
        Factors in regions of the upright picture.
    centres : (ndarray, ndarray)
        Centres of their rows and columns, as shares of the picture's height and width.
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


def _nearest(places: tuple[FloatArray, FloatArray], centres: tuple[FloatArray, FloatArray]) -> NDArray[np.intp]:
    """Return the region of each of the tiles that lie at all pairs of `places`."""
    row, col = (np.abs(np.subtract.outer(at, own)).argmin(axis=1) for at, own in zip(places, centres, strict=True))
    region: NDArray[np.intp] = np.add.outer(row * len(centres[1]), col).ravel()
    return region


def _alike(costs: FloatArray, factors: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Return the labels (R, C) whose costs (L, R, C), with those of differences between neighbours, are least.

    Labels are indices of `factors`.

    Regions of either colour of a chequerboard change in turn, from several starts.
    """
    count, rows, cols = costs.shape
    apart = NATS_PER_SQUARE * np.minimum(np.square(np.subtract.outer(factors, factors)), MOST_SQUARE)
    even = np.add.outer(np.arange(rows), np.arange(cols)) % 2 == 0

    def of_neighbours(labels: NDArray[np.intp]) -> FloatArray:
        total = np.zeros_like(costs)
        total[:, 1:] += apart[:, labels[:-1]]
        total[:, :-1] += apart[:, labels[1:]]
        total[:, :, 1:] += apart[:, labels[:, :-1]]
        total[:, :, :-1] += apart[:, labels[:, 1:]]
        return total

    def settled(labels: NDArray[np.intp]) -> NDArray[np.intp]:
        for _ in range(MOST_SWEEPS):
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
