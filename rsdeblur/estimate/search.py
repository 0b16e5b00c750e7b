"""Search for the best credible correction of a recording: spectra and streaks propose, the sharp picture decides.

Places are corrections in units of the standard deviations of the recording's errors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import ACCELERATION, DRIFT, PARAMETERS
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL
from rsdeblur.estimate.worth import Worth, cost
from rsdeblur.motion.arguments import is_held
from rsdeblur.types import FloatArray, Progress

# Parameters of motion that keeps its velocity.
STRAIGHT = tuple(name for name in PARAMETERS if name not in ACCELERATION)
# Groups of parameters that are searched together, and the number of grid values of each. Every search starts from no
# correction and from the best one so far. Grid values reach `WIDEST` standard deviations. The likelier share
# `COMPARED` of the grid, of at least `LEAST_START` nats, is compared by the sharp picture. The best `STARTS` of them
# start searches too. A correction by few numbers is more credible than one by many.
MODELS = (
    (("scale",), 0),
    (("readout",), 4),
    (("offset",), 8),
    (DRIFT, 4),
    (("scale", *DRIFT), 0),
    ((*DRIFT, *ACCELERATION), 0),
    (STRAIGHT, 0),
)
WIDEST, COMPARED, LEAST_START, STARTS = 3.0, 0.5, -20.0, 2
# Number of candidates that are adjusted, if they are worth so many nats, and confirmed. Each model has up to two: its
# best correction, and the best with its numbers alone, which another correction cannot have led astray.
CANDIDATES, LEAST_ADJUSTED = 5, 10.0
# Parameters that the quick measure of the sharp picture adjusts if they are corrected, and the steps along each, in
# standard deviations. At last the whole solve adjusts the others: it finds them more exactly, but on real photos, where
# the scene has several depths, it leads to drifts that are too long. A parabola leads at most so many steps away.
ADJUSTED, QUICK_STEPS, WHOLE_STEPS, MOST_STEPS = ("scale", *DRIFT, *ACCELERATION), (0.6, 0.3), (0.3,), 2.0
# A correction that is accepted may be bent: it must be worth so many nats more, by the quick measure and by the whole
# solve. Steps along the acceleration, and then along drift and acceleration, in standard deviations.
MORE_BY_BENDING, BENDING_STEPS = 10.0, (1.0, 0.5)
# Light streaks search along these parameters, with steps in standard deviations, from the best place of a grid of so
# many values of each drift, or from no correction. The search goes on after the first step only if they are so many
# nats likelier. The spectra join the last two steps.
FOLLOWED, STREAK_STEPS, LEAST_FOLLOWED = ("scale", *DRIFT), (0.8, 0.4, 0.2), 10.0
STREAK_GRID, STREAK_COUNT = DRIFT, 4
# Least worth (nats) of a correction that is accepted, its least fall in the whole solve, and the most standard
# deviations of any parameter. The quick measure must not rise; a fall proves less there, as the largest of many.
LEAST_WORTH, LEAST_FALL, MOST_DEVIATIONS = 30.0, 0.01, 6.0
# Least worth by the smaller of both falls, and least fall in the whole solve, that will do as well.
LEAST_BY_BOTH = 36.0, 0.004
# Least worth and fall for the readout time alone: little else looks like that.
LEAST_OF_READOUT = 15.0, 0.005
# Reasons of a refusal.
NOT_CLEAR = "the picture does not contradict the recording, or not clearly"
TOO_FAR = "the likeliest correction is too far from the recording"
NOT_SHARPER = "the sharp picture does not become clearer"


class Search:
    """Search for the correction that is worth most.

    Parameters
    ----------
    worth : Worth
        Worth of corrections.
    threads : int or None
        Threads that share several places; None means all processors.
    """

    def __init__(self, worth: Worth, threads: int | None) -> None:
        self._worth, self._threads = worth, threads
        #: The corrections that :meth:`best` compared, the best first.
        self.candidates: list[FloatArray] = []

    def best(self, progress: Progress) -> tuple[FloatArray, str]:
        """Return the best credible correction, adjusted by the sharp picture; or the best of all, and what is wrong."""
        candidates = self.candidates = self._candidates(progress)
        likely = [place for place in candidates[:CANDIDATES] if self._worth.of(place) >= LEAST_ADJUSTED]
        near = [place for place in likely if np.abs(place).max() <= MOST_DEVIATIONS]
        if not near:
            return candidates[0], TOO_FAR if likely else NOT_CLEAR
        # The search found the largest of many falls. The whole solve is free of what favoured them by chance.
        falls = [
            min(self._worth.fall(place), whole)
            for place, whole in zip(near, self._worth.whole_falls(near), strict=True)
        ]
        worths = [
            self._worth.gain(place) + NATS_PER_FALL * fall - cost(place)
            for place, fall in zip(near, falls, strict=True)
        ]
        refused = []
        for n in np.argsort(worths)[::-1]:
            axes = [at for at in np.flatnonzero(near[n]).tolist() if PARAMETERS[at] in ADJUSTED]
            place = adjusted(near[n], self._worth.all, axes, progress, steps=QUICK_STEPS)
            reason = self._doubt(place)
            if not reason:
                return self._bent(self._polished(place, progress), progress), reason
            refused.append((place, reason))
        return refused[0]

    def _polished(self, place: FloatArray, progress: Progress) -> FloatArray:
        """Return a credible correction, adjusted by the whole solve; unchanged if it would no longer be credible."""
        axes = [at for at in np.flatnonzero(place).tolist() if PARAMETERS[at] not in ADJUSTED]
        polished = adjusted(place, self._worth.all_whole, axes, progress, steps=WHOLE_STEPS)
        return place if self._doubt(polished) else polished

    def _bent(self, place: FloatArray, progress: Progress) -> FloatArray:
        """Return a credible correction, bent by an acceleration; unchanged if the picture does not show one."""
        if not set(ACCELERATION) <= set(self._worth.posterior.free):
            return place
        least = self._worth.of(place) - cost(place) + MORE_BY_BENDING
        bent = place
        for names, step in zip((ACCELERATION, (*DRIFT, *ACCELERATION)), BENDING_STEPS, strict=True):
            axes = [PARAMETERS.index(name) for name in names if name in self._worth.posterior.free]
            bent = adjusted(bent, self._worth.all, axes, progress, steps=(step,))
            if self._worth.of(bent) - cost(bent) < least:
                return place
        straight, whole = self._worth.all_whole([place, bent])
        more = whole - cost(bent) - straight + cost(place)
        return bent if more >= MORE_BY_BENDING and not self._doubt(bent) else place

    def _doubt(self, place: FloatArray) -> str:
        """Return why an adjusted correction is not credible; nothing if it is."""
        changed = [name for name, value in zip(PARAMETERS, place, strict=True) if value]
        worth, fall = LEAST_OF_READOUT if changed == ["readout"] else (LEAST_WORTH, LEAST_FALL)
        if self._worth.of(place) < worth:
            return NOT_CLEAR
        if np.abs(place).max() > MOST_DEVIATIONS or not is_held(self._worth.posterior.corrected(place).capture()):
            return TOO_FAR
        (whole,) = self._worth.whole_falls([place])
        by_both = self._worth.gain(place) + NATS_PER_FALL * min(whole, self._worth.fall(place))
        sharper = whole >= fall or (by_both >= LEAST_BY_BOTH[0] and whole >= LEAST_BY_BOTH[1])
        return "" if sharper and self._worth.fall(place) >= 0 else NOT_SHARPER

    def _candidates(self, progress: Progress) -> list[FloatArray]:
        """Return the best correction of each model, and the best with its numbers alone; the best of all first."""
        best, worth = self._worth.nothing, 0.0
        found = {best.tobytes(): (worth, best)}
        tried: list[list[str]] = [[]]
        for n, (names, count) in enumerate(MODELS):
            progress("search", n / len(MODELS))
            model, last = [name for name in names if name in self._worth.posterior.free], names is STRAIGHT
            # Descents of the last model take long, so it begins at the best place only, if that is worth it.
            if model in tried or (last and worth < LEAST_ADJUSTED):
                continue
            tried.append(model)
            begin = [best] if last or not best.any() else [self._worth.nothing, best]
            starts = [*begin, *self._starts(model, count)]
            places = share_map(partial(self._worth.posterior.descend, free=model), starts, self._threads)
            worths = np.array(self._worth.all(places)) - [cost(place) for place in places]
            most = int(worths.argmax())
            others = [name not in model for name in PARAMETERS]
            alone = [at for at, place in enumerate(places) if not place[others].any()]
            for at in {most, max(alone, key=worths.__getitem__, default=most)}:
                found[places[at].tobytes()] = float(worths[at]), places[at]
            if worths[most] > worth:
                worth, best = float(worths[most]), places[most]
        for place in self._followed(progress):
            found[place.tobytes()] = self._worth.of(place) - cost(place), place
        return [place for _, place in sorted(found.values(), key=lambda pair: -pair[0])]

    def _starts(self, model: list[str], count: int) -> list[FloatArray]:
        """Return the best of places that are spread over the parameters of a model, `count` values of each."""
        places = _grid(model, count)
        gains = np.array(share_map(self._worth.spectra_gain, list(places), self._threads))
        likely = [n for n in np.argsort(-gains)[: round(COMPARED * len(places))] if gains[n] > LEAST_START]
        falls = share_map(lambda n: self._worth.fall(places[n]), likely, self._threads)
        worths = gains[likely] + NATS_PER_FALL * np.array(falls)
        return [places[likely[n]] for n in np.argsort(-worths)[:STARTS]]

    def _followed(self, progress: Progress) -> list[FloatArray]:
        """Return the correction that light streaks prefer, and what the spectra and they prefer from there."""
        worth, free = self._worth, self._worth.posterior.free
        axes = [PARAMETERS.index(name) for name in FOLLOWED if name in free]
        if not worth.streaks.streaks or not axes:
            return []

        def likely(places: Sequence[FloatArray]) -> list[float]:
            return share_map(lambda place: worth.streak_nats(place) - 0.5 * float(place @ place), places, self._threads)

        def gains(places: Sequence[FloatArray]) -> list[float]:
            return share_map(worth.gain, places, self._threads)

        begin = [worth.nothing, *_grid([name for name in STREAK_GRID if name in free], STREAK_COUNT)]
        first = adjusted(begin[int(np.argmax(likely(begin)))], likely, axes, progress, steps=STREAK_STEPS[:1])
        if worth.streak_gain(first) < LEAST_FOLLOWED:
            return []
        place = adjusted(first, likely, axes, progress, steps=STREAK_STEPS[:2])
        return [place, adjusted(place, gains, axes, progress, steps=STREAK_STEPS[1:])]


def adjusted(
    place: FloatArray,
    worths: Callable[[Sequence[FloatArray]], list[float]],
    axes: Sequence[int],
    progress: Progress,
    *,
    steps: Sequence[float],
) -> FloatArray:
    """Return the best place that a search by parabolas finds, along one axis after another, for each size of step."""
    (most,) = worths([place])
    for n, step in enumerate(steps):
        progress("adjust", n / len(steps))
        for axis in axes:
            aside = step * np.eye(len(place))[axis]
            below, above = worths([place - aside, place + aside])
            bend = 2 * most - below - above
            away = 0.5 * (above - below) / bend if bend > 0 else np.sign(above - below) * MOST_STEPS
            vertex = place + np.clip(away, -MOST_STEPS, MOST_STEPS) * aside
            tried = (most, place), (below, place - aside), (above, place + aside), (worths([vertex])[0], vertex)
            most, place = max(tried, key=lambda pair: pair[0])
    return place


def _grid(names: Sequence[str], count: int) -> FloatArray:
    """Return places that are spread over some parameters, `count` values of each."""
    at = [PARAMETERS.index(name) for name in names]
    places = np.zeros((count ** len(at), len(PARAMETERS)))
    if at:
        values = np.meshgrid(*[np.linspace(-WIDEST, WIDEST, count)] * len(at))
        places[:, at] = np.stack(values, axis=-1).reshape(len(places), len(at))
    return places
