"""What corrections of a recording are worth: by spectra, by light streaks, and by the sharp pictures they lead to.

Places are corrections in units of the standard deviations of the recording's errors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import PARAMETERS, Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, SHORTER, QuickSharpness
from rsdeblur.estimate.sharpness import Sharpness
from rsdeblur.estimate.streaks import LightStreaks, lead_of
from rsdeblur.types import FloatArray

# Nats that a parameter costs, and the least gain that counts.
NATS_PER_PARAMETER, WORST_GAIN = 3.0, -1000.0
# Gain (nats) without which the fall does not count where the paths become shorter.
LEAST_OF_SHORTER = 10.0
# Worth (nats) of corrections of which half bring the motion nearer to the truth, and by how much more the odds grow
# e-fold: a fit to simulated recordings (docs/developer/decisions.md).
EVEN_WORTH, WORTH_SCALE = 8.0, 12.0


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """Corrected recording, and what the correction is worth.

    Parameters
    ----------
    place : ndarray, shape (8,)
        The correction; with factors, its drift holds where they are 1.
    recording : Recording
        The corrected recording.
    gain, fall : float
        See :class:`rsdeblur.Refinement`.
    worth : float
        Worth, nats.
    factors : ndarray, shape (R, C), or None
        Factors on the drift in equal regions of the upright picture.
    """

    place: FloatArray
    recording: Recording
    gain: float
    fall: float
    worth: float
    factors: FloatArray | None = None

    @property
    def confidence(self) -> float:
        """How likely the correction brings the motion nearer to the truth."""
        return 1.0 / (1.0 + float(np.exp((EVEN_WORTH - self.worth) / WORTH_SCALE))) if self.place.any() else 0.0


class Worth:
    """Worth of corrections, in nats; what was measured of a place is kept.

    Parameters
    ----------
    posterior : Posterior
        What the spectra and the uncertainty of the recording say.
    quick : QuickSharpness
        The quick measure of the sharp picture.
    streaks : LightStreaks
        The light streaks of the picture.
    whole : callable
        Plans whole solves, which most pictures do not need.
    threads : int or None
        Threads that share several places; None means all processors.
    """

    def __init__(
        self,
        posterior: Posterior,
        quick: QuickSharpness,
        streaks: LightStreaks,
        whole: Callable[[], Sharpness],
        threads: int | None,
    ) -> None:
        self.posterior, self.streaks = posterior, streaks
        self.nothing = np.zeros(len(PARAMETERS))
        self._quick, self._plan_whole, self._threads = quick, whole, threads
        self._streak_nats: dict[bytes, float] = {}
        self._tiles: dict[bytes, FloatArray] = {}
        self._whole_sparsities: dict[bytes, float] = {}

    @cached_property
    def whole(self) -> Sharpness:
        """The measure of whole solves."""
        return self._plan_whole()

    def gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra and the light streaks are than without a correction."""
        return self.spectra_gain(place) + self.streak_gain(place)

    def spectra_gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra are than without a correction."""
        return self.posterior.gain(place, self.nothing)

    def streak_gain(self, place: FloatArray) -> float:
        """Return how much likelier the light streaks are than without a correction."""
        return lead_of(self.streak_nats(place), self.streak_nats(self.nothing))

    def streak_nats(self, place: FloatArray) -> float:
        """Return how much likelier the light streaks are than under no motion that explains them."""
        key = place.tobytes()
        if key not in self._streak_nats:
            self._streak_nats[key] = self.streaks.nats(self.posterior.corrected(place))
        return self._streak_nats[key]

    def fall(self, place: FloatArray) -> float:
        """Return how much the logarithm of l1 / l2 falls."""
        return self._sparsity(self.nothing) - self._sparsity(place)

    def _sparsity(self, place: FloatArray) -> float:
        try:
            return float(self.tiles(place).sum())
        except UNDESCRIBED:
            return np.inf

    def tiles(self, place: FloatArray) -> FloatArray:
        """Return :meth:`rsdeblur.estimate.quick_sharpness.QuickSharpness.tiles` of a place."""
        key = place.tobytes()
        if key not in self._tiles:
            self._tiles[key] = self._quick.tiles(self.posterior.corrected(place))
        return self._tiles[key]

    def whole_falls(self, places: Sequence[FloatArray]) -> list[float]:
        """Return how much the logarithm of l1 / l2 falls in the whole solve."""
        known, whole = self._whole_sparsities, self.whole
        new = {each.tobytes(): each for each in (self.nothing, *places) if each.tobytes() not in known}
        values = share_map(lambda each: whole.of(self.posterior.corrected(each)), list(new.values()), self._threads)
        known.update(zip(new, values, strict=True))
        return [known[self.nothing.tobytes()] - known[place.tobytes()] for place in places]

    def of(self, place: FloatArray) -> float:
        """Return the worth of a correction by its gain and the quick measure."""
        return self._sum(place, self.fall(place) if self.gain(place) >= 0 else 0.0)

    def all(self, places: Sequence[FloatArray]) -> list[float]:
        """Return the worth of each of several corrections by their gains and the quick measure."""
        return share_map(self.of, places, self._threads)

    def all_whole(self, places: Sequence[FloatArray]) -> list[float]:
        """Return the worth of each of several corrections by their gains and the whole solve."""
        return [self._sum(place, fall) for place, fall in zip(places, self.whole_falls(places), strict=True)]

    def one_drift(self, place: FloatArray) -> Corrected:
        """Return a correction with what it is worth."""
        return Corrected(
            place, self.posterior.corrected(place), gain=self.gain(place), fall=self.fall(place), worth=self.of(place)
        )

    def by_region(self, place: FloatArray, recording: Recording, factors: FloatArray) -> Corrected:
        """Return a correction whose drift differs from region to region, with what it is worth.

        Parameters
        ----------
        place : ndarray, shape (8,)
            The correction.
        recording : Recording
            The recording that it leads to.
        factors : ndarray, shape (R, C)
            Factors on its drift.
        """
        nats = self.posterior.nats(self.nothing)
        assert nats is not None, "the log describes the exposure"
        leads = self.posterior.leads(self.posterior.spectra.score(recording), nats)
        led = lead_of(self.streaks.nats(recording), self.streak_nats(self.nothing))
        gain = float(leads.sum() - 0.5 * place @ place) + led
        fall = self._sparsity(self.nothing) - self._quick.of(recording)
        worth = self._together(gain, fall, recording)
        return Corrected(place, recording, gain=gain, fall=fall, worth=worth, factors=factors)

    def whole_fall(self, recording: Recording) -> float:
        """Return how much the logarithm of l1 / l2 falls in the whole solve with a recording."""
        self.whole_falls([])
        return self._whole_sparsities[self.nothing.tobytes()] - self.whole.of(recording)

    def _sum(self, place: FloatArray, fall: float) -> float:
        """Return the worth of a correction by its gain and a fall of its sharp picture."""
        return self._together(self.gain(place), fall, self.posterior.corrected(place))

    def _together(self, gain: float, fall: float, recording: Recording) -> float:
        """Return the worth of a corrected recording by its gain and the fall of its sharp picture."""
        gain = max(gain, WORST_GAIN)
        # The sharp picture counts only where the spectra agree. Far from the truth it may be clear because little blur
        # was removed.
        if gain < 0 or (gain < LEAST_OF_SHORTER and _length(recording) < SHORTER * self._given_length):
            return gain
        return gain + NATS_PER_FALL * fall

    @cached_property
    def _given_length(self) -> float:
        return _length(self.posterior.corrected(self.nothing))


def _length(recording: Recording) -> float:
    """Return the mean length of the paths, px."""
    return recording.capture().mean_length


def cost(place: FloatArray) -> float:
    """Return the nats that the numbers of a correction cost."""
    return NATS_PER_PARAMETER * float(np.count_nonzero(place))
