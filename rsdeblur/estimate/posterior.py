"""Corrections of a recording that a picture's spectra make likely: search and descent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import ClockError, CoverageError, GapError
from rsdeblur.estimate.correction import PARAMETERS, Correction, Recording
from rsdeblur.estimate.spectra import Fit, TileSpectra
from rsdeblur.types import FloatArray

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
# Samples of the search, a power of 2, all within this many standard deviations, and the best that descents begin from.
SAMPLES, WIDEST, STARTS = 32, 2.0, 2
# Samples closer than this are not both starts, standard deviations.
APART = 0.7

# Step of numerical derivatives, longest steps of the descents, change at which they end: standard deviations.
STEP, FIRST_TRUST, MOST_TRUST, SETTLED = 0.05, 0.7, 1.5, 0.03
# Gain at which descents end.
LEAST_STEP_GAIN = 0.02
# Fits and recordings that are kept: more than threads that descend at a time.
RECENT = 16
# Bound of the derivatives of the logarithm of the power, where it nearly vanishes.
STEEPEST = 8.0


class Posterior:
    """How likely corrections are, given a picture's spectra and how uncertain the recording is.

    Corrections are given in standard deviations of the prior, as arrays in the order of `PARAMETERS`.

    Parameters
    ----------
    spectra : TileSpectra
        Spectra of the picture.
    recording : Recording
        Recording as given.
    deviations : ndarray, shape (8,)
        Standard deviations of the errors of the recording, in the units of :class:`Correction`; 0 for what is known.
    """

    def __init__(self, spectra: TileSpectra, recording: Recording, deviations: FloatArray) -> None:
        self.spectra, self._recording, self._deviations = spectra, recording, deviations
        self._tiles = TILES_AS_ONE * max(spectra.tiles, LEAST_TILES)
        self._nats: dict[bytes, FloatArray | None] = {}
        # Descents ask for the fit of their last place again; several measures, for the recording of theirs.
        self._fit, self._corrected = lru_cache(RECENT)(self._fit_at), lru_cache(RECENT)(self._corrected_at)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are not known."""
        return tuple(np.array(PARAMETERS)[self._deviations > 0].tolist())

    def corrected(self, place: FloatArray) -> Recording:
        """Return the recording with the correction at `place`."""
        return self._corrected(place.tobytes())

    def _corrected_at(self, key: bytes) -> Recording:
        return self._recording.corrected(Correction(*(np.frombuffer(key) * self._deviations).tolist()))

    def nats(self, place: FloatArray) -> FloatArray | None:
        """Return the nats of all tiles; None if the log does not describe the exposure."""
        key = place.tobytes()
        if key not in self._nats:
            try:
                self._nats[key] = self._fit(key).nats
            except UNDESCRIBED:
                self._nats[key] = None
        return self._nats[key]

    def _fit_at(self, key: bytes) -> Fit:
        """Return the fit of the spectra at a place, given as bytes."""
        return self.spectra.fit(self.corrected(np.frombuffer(key)))

    def gain(self, place: FloatArray, over: FloatArray) -> float:
        """Return how much more likely one correction is than another, in nats; infinite if one has no score."""
        others = self.nats(over)
        if others is None:
            return np.inf
        return self.lead(place, others) + 0.5 * float(over @ over)

    def lead(self, place: FloatArray, others: FloatArray) -> float:
        """Return how much more likely a correction is than a motion with the nats `others`, whose prior is ignored."""
        nats = self.nats(place)
        if nats is None:
            return -np.inf
        return float(self.leads(nats, others).sum() - 0.5 * place @ place)

    def leads(self, nats: FloatArray, others: FloatArray) -> FloatArray:
        """Return how much more likely each tile is with one motion than with another, given the nats of both.

        Tiles are correlated, and none counts for much more than the bound.
        """
        bounded: FloatArray = MOST_NATS * np.tanh((others - nats) / MOST_NATS) / self._tiles
        return bounded

    def search(self, free: Sequence[str]) -> list[FloatArray]:
        """Return the local maxima that descents reach with some parameters free, from no correction and from samples.

        Parameters
        ----------
        free : sequence of str
            Names of parameters whose standard deviations are positive.
        """
        from scipy.special import ndtr, ndtri
        from scipy.stats import qmc  # takes 0.5 s to import

        at = [PARAMETERS.index(name) for name in free]
        low = ndtr(-WIDEST)
        quantiles = qmc.Sobol(len(at), seed=0).random(SAMPLES).clip(low, 1 - low)
        places = np.zeros((SAMPLES + 1, len(PARAMETERS)))
        places[1:, at] = ndtri(quantiles)
        starts = [np.zeros(len(PARAMETERS))]
        best = starts[0]
        for _ in range(2):
            # The gains of tiles are bounded, so the order may depend on what they are compared with.
            gains = np.array([self.gain(place, best) for place in places])
            best = places[gains.argmax()]
        for place in places[np.argsort(-gains)]:
            if len(starts) <= STARTS and all(np.abs(place - start).max() > APART for start in starts):
                starts.append(place)
        return [self.descend(start, free) for start in starts if self.nats(start) is not None]

    def spread(self, place: FloatArray) -> FloatArray:
        """Return the standard deviations of all parameters at a place, as shares of those of the prior."""
        spread = np.zeros(len(PARAMETERS))
        if not self.free:
            return spread
        at = np.array([PARAMETERS.index(name) for name in self.free])
        precision = self.information(place, at)[1] + np.eye(len(at))
        spread[at] = np.sqrt(np.diag(np.linalg.inv(precision)))
        return spread

    def descend(self, place: FloatArray, free: Sequence[str], *, steps: int = 6) -> FloatArray:
        """Return the local maximum that Fisher scoring reaches with some parameters free, the others as they are."""
        return climb(place, free, self.information, self.gain, steps=steps)

    def information(self, place: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient and Fisher information of the tiles together for the parameters `at`, without the prior."""
        fit = self._fit(place.tobytes())
        slopes = np.array([self._slope(place, index, fit.expected) for index in at.tolist()])
        gradient, information = self.spectra.information(fit, slopes)
        # A tile that alone would gain more than the bound has less weight.
        solved = np.linalg.solve(information + TILES_AS_ONE * np.eye(len(at)), gradient[..., None])[..., 0]
        weight = 1.0 / (1.0 + 0.5 * (solved * gradient).sum(axis=1) / MOST_NATS)
        weight /= self._tiles
        return weight @ gradient, np.tensordot(weight, information, 1)

    def _slope(self, place: FloatArray, index: int, expected: NDArray[np.float32]) -> NDArray[np.float32]:
        for step in (STEP, -STEP):
            moved = place.copy()
            moved[index] += step
            try:
                slope: NDArray[np.float32] = np.log(self.spectra.expected(self.corrected(moved)) / expected) / step
            except UNDESCRIBED:
                continue
            return slope.clip(-STEEPEST, STEEPEST)
        return np.zeros_like(expected)


def climb(
    place: FloatArray,
    free: Sequence[str],
    information: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
    gain: Callable[[FloatArray, FloatArray], float],
    *,
    steps: int,
) -> FloatArray:
    """Return the local maximum that damped steps of bounded length reach.

    Parameters
    ----------
    place : ndarray
        Where to begin, in standard deviations.
    free : sequence of str
        Names of the parameters that may change.
    information : callable
        Takes a place and the indices of parameters, and returns gradient and information, without the prior.
    gain : callable
        Takes a place and another one, and returns how much more likely the first is, nats.
    steps : int
        Most steps.
    """
    at = np.array([PARAMETERS.index(name) for name in free])
    damping, trust = 0.01, FIRST_TRUST
    for _ in range(steps):
        gradient, matrix = information(place, at)
        gained, step = 0.0, np.zeros_like(place)
        while trust > SETTLED and not gained > 0:
            step[at] = -np.linalg.solve(damped(matrix, damping), gradient + place[at])
            step *= min(1.0, trust / max(float(np.abs(step).max()), 1e-9))
            gained = gain(place + step, place)
            damping, trust = (damping / 4, trust * 1.3) if gained > 0 else (max(6 * damping, 0.05), trust / 2)
        if not gained > 0:
            break
        place, damping, trust = place + step, max(damping, 1e-3), min(trust, MOST_TRUST)
        if np.abs(step).max() < SETTLED or gained < LEAST_STEP_GAIN:
            break
    return place


def damped(information: FloatArray, damping: float) -> FloatArray:
    """Return an information matrix with the prior's, damped as Levenberg and Marquardt do."""
    matrix: FloatArray = information + np.eye(len(information)) + damping * np.diag(np.diag(information) + 1)
    return matrix
