"""Drift by region: near things move further in the picture than far ones.

The drift of a correction holds for one depth. Here each region of a coarse grid gets a factor on it, such that the
spectra of its tiles are likely, its sharp picture is clear, and neighbouring regions are alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_map
from rsdeblur.deconv.tiling import hat_weights
from rsdeblur.estimate.correction import Correction, Recording
from rsdeblur.estimate.posterior import Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, QuickSharpness
from rsdeblur.estimate.sharpness import Sharpness
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Factors that are tried, and the index of the one that changes nothing.
FACTORS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0])
SAME = 4
# Nats that two neighbours cost for the square of their difference, and the largest square that counts: depth has edges.
NATS_PER_SQUARE, MOST_SQUARE = 1.0, 4.0
# Most changes of all regions in turn; they settle after a few.
MOST_SWEEPS = 20
# Points of the map of depths from one region to the next, and the least factor there: depths are finite.
STEPS, LEAST_FACTOR = 2, 0.02
# Least gain (nats) and least fall of l1 / l2 of the whole solve. On 16 captures of one depth, the gain reached 22 nats
# and the fall 0.005.
LEAST_GAIN, LEAST_FALL = 20.0, 0.006


def drift_by_region(
    posterior: Posterior,
    quick: QuickSharpness,
    whole: Sharpness,
    recording: Recording,
    correction: Correction,
    *,
    threads: int | None,
) -> FloatArray | None:
    """Return the factors on a corrected drift in equal regions of the upright picture.

    Parameters
    ----------
    posterior, quick, whole
        How likely recordings are by the spectra of the picture, and how clear it becomes with them.
    recording : Recording
        The recording as given.
    correction : Correction
        Its correction, which is credible.
    threads : int or None
        Threads that share the work; None means all processors.

    Returns
    -------
    ndarray, shape (R, C), or None
        None where one factor explains the picture as well, or the correction has no drift.
    """
    if not (correction.drift_x or correction.drift_y):
        return None
    moved = [recording.corrected(_scaled(correction, factor)) for factor in FACTORS.tolist()]
    nats = share_map(posterior.spectra.score, moved, threads)
    falls = np.stack(share_map(quick.tiles, moved, threads))
    falls = NATS_PER_FALL * (falls - falls[SAME])
    region = _nearest(posterior.spectra.centres, quick.centres)
    costs = np.zeros((len(FACTORS), quick.centres[0].size * quick.centres[1].size))
    for cost, fall, each in zip(costs, falls, nats, strict=True):
        cost += fall - np.bincount(region, posterior.leads(each, nats[SAME]), len(cost))
    labels, cost = _alike(costs.reshape(len(FACTORS), len(quick.centres[0]), -1))
    if -cost < LEAST_GAIN:
        return None
    factors = FACTORS[labels]
    pair = recording.corrected(correction), with_factors(recording, correction, factors, quick.centres)
    before, after = share_map(whole.of, pair, threads)
    return factors if before - after > LEAST_FALL else None


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
    px = np.array([correction.drift_x, correction.drift_y]) / still.middle_depth
    return replace(rest, translation=Translation.drift(px, rest.camera, rest.exposure, known=still))


def _scaled(correction: Correction, factor: float) -> Correction:
    return replace(correction, drift_x=factor * correction.drift_x, drift_y=factor * correction.drift_y)


def _nearest(places: tuple[FloatArray, FloatArray], centres: tuple[FloatArray, FloatArray]) -> NDArray[np.intp]:
    """Return the region of each of the tiles that lie at all pairs of `places`."""
    row, col = (np.abs(np.subtract.outer(at, own)).argmin(axis=1) for at, own in zip(places, centres, strict=True))
    region: NDArray[np.intp] = np.add.outer(row * len(centres[1]), col).ravel()
    return region


def _alike(costs: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Return the labels (R, C) whose costs (L, R, C), with those of differences between neighbours, are least.

    Regions of either colour of a chequerboard change in turn, from several starts.
    """
    count, rows, cols = costs.shape
    apart = NATS_PER_SQUARE * np.minimum(np.square(np.subtract.outer(FACTORS, FACTORS)), MOST_SQUARE)
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
