"""Search for the best credible correction of a recording: spectra and streaks propose, the sharp pictures decide.

Corrections are places of a :class:`rsdeblur.estimate.posterior.Posterior`. :func:`rival_lead` compares what was found
with other mountings of the gyro, which may explain the photos better.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import product, zip_longest

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import ACCELERATION, DRIFT, PARAMETERS, SHARED, Recording
from rsdeblur.estimate.posterior import UNDESCRIBED
from rsdeblur.estimate.score import EVIDENCE, HOPELESS, NATS_PER_NUMBER, PROOFS, Score, mean_lengths
from rsdeblur.estimate.sharpness import NATS_PER_FALL, SHORTER
from rsdeblur.motion.arguments import is_held
from rsdeblur.motion.axes import rotations
from rsdeblur.types import FloatArray, Progress

# Parameters of motion that keeps its velocity.
STRAIGHT = tuple(name for name in PARAMETERS if name not in ACCELERATION)
# Groups of parameters that are searched together, and the number of grid values of each. Every search starts from no
# correction and from the best one so far. Grid values reach `WIDEST` standard deviations. The likelier share
# `COMPARED` of the grid, unless it is hopeless, is compared by the sharp picture. The best `STARTS` of them
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
WIDEST, COMPARED, STARTS = 3.0, 0.5, 2
# Distance of the grid values of the logarithm of a readout time that is a guess: photos show it to within as much.
SPACING = 0.1
# Number of candidates that are adjusted and confirmed. Each model has up to two: its best correction, and the best with
# its numbers alone, which another correction cannot have led astray.
CANDIDATES = 5
# A parabola leads at most so many steps away.
MOST_STEPS = 2.0
# The most standard deviations of any parameter of a correction that is accepted.
MOST_DEVIATIONS = 6.0
# Reasons of a refusal.
NOT_CLEAR = "the picture does not contradict the recording, or not clearly"
TOO_FAR = "the likeliest correction is too far from the recording"
NOT_SHARPER = "the sharp picture does not become clearer"
DISAGREE = "the photos disagree"
OTHER_AXES = "other axes of the gyro explain the picture as well: are imu_to_camera and the readout direction right?"
# Nats by which a correction must be likelier than the best one with other axes: those of a number.
AHEAD_OF_AXES = NATS_PER_NUMBER
# All mountings are compared by the spectra at some clock offsets. The likeliest mountings are fitted, with these
# parameters free, and compared by the sharp picture: there, and at those offsets that are not hopeless, because the fit
# knows the spectra alone.
FREE = ("scale", "offset")
# Likeliest mountings, or clock offsets, that are fitted.
FITTED = 4


# Parameters along which parabolas adjust a correction, and their steps, standard deviations.
ADJUSTMENTS = {
    # The quick measure of the sharp picture adjusts those of these that are corrected. At last the whole solve adjusts
    # the others: it finds them more exactly, but on real photos, where the scene has several depths, it leads to drifts
    # that are too long. The last step is for guesses, whose deviation is wide.
    "quick": (("scale", *DRIFT, *ACCELERATION), (0.6, 0.3)),
    "whole": (("offset", "readout", "roll"), (0.3, 0.1)),
    # A correction that is accepted may be bent. The first step is along the acceleration alone.
    "bent": ((*DRIFT, *ACCELERATION), (1.0, 0.5)),
    # Light streaks begin at the best place of the grid of drifts, or at no correction. The spectra join the last steps.
    "streaks": (("scale", *DRIFT), (0.8, 0.4, 0.2)),
    # The spectra hardly change within a step of the candidates of `find_time_offset`.
    "offset": (("offset",), (0.4, 0.2)),
}


class Search:
    """Search for the correction with the highest score.

    With `guesses`, numbers whose deviation the camera states need not be proved wrong, but others must lead clearly.
    """

    def __init__(self, score: Score, *, guesses: bool = True) -> None:
        self._score = score
        camera = score.photos[0].recording.camera
        stated = {"readout": camera.readout_sd, "offset": camera.time_offset_sd}
        self._guesses = {name for name, sd in stated.items() if guesses and sd > 0}
        #: The corrections that :meth:`best` compared, the best first.
        self.candidates: list[FloatArray] = []

    def best(self, progress: Progress) -> tuple[FloatArray, str]:
        """Return the best credible correction, adjusted by the sharp pictures; or the best one, and what is wrong."""
        score = self._score
        candidates = self.candidates = self._candidates(progress)
        likely = [place for place in candidates[:CANDIDATES] if score.of(place) >= EVIDENCE]
        near = [place for place in likely if np.abs(place).max() <= MOST_DEVIATIONS]
        if not near:
            return candidates[0], TOO_FAR if likely else NOT_CLEAR
        # The search found the largest of many falls. The whole solve is free of what favoured them by chance.
        whole = score.whole_falls(near)
        scores = [
            self._by_both(place, falls) - score.cost(place) + EVIDENCE * (changed(place) <= self._guesses)
            for place, falls in zip(near, whole, strict=True)
        ]
        refused, (names, steps) = [], ADJUSTMENTS["quick"]
        for n in np.argsort(scores)[::-1]:
            place = adjusted(near[n], score.all, score.directions(names, near[n]), progress, steps=steps)
            reason = self._doubt(place)
            if not reason:
                return self._bent(self._polished(place, progress), progress), reason
            refused.append((place, reason))
        return refused[0]

    def _by_both(self, place: FloatArray, whole: FloatArray) -> float:
        """Return the score of a correction, if the smaller of both falls of each photo counts."""
        smaller = np.minimum(whole, self._score.falls(place))
        return self._score.gain(place) + NATS_PER_FALL * float(smaller.sum())

    def _polished(self, place: FloatArray, progress: Progress) -> FloatArray:
        """Return a credible correction, adjusted by the whole solve; unchanged if it would no longer be credible."""
        names, (step, last) = ADJUSTMENTS["whole"]
        directions, steps = self._score.directions(names, place), (step, last) if self._guesses else (step,)
        polished = adjusted(place, self._score.all_whole, directions, progress, steps=steps)
        return place if self._doubt(polished) else polished

    def _bent(self, place: FloatArray, progress: Progress) -> FloatArray:
        """Return a credible correction, bent by an acceleration; unchanged if the picture does not show one."""
        score = self._score
        if not set(ACCELERATION) <= set(score.free):
            return place
        least = score.of(place) - score.cost(place) + EVIDENCE
        bent, (both, steps) = place, ADJUSTMENTS["bent"]
        for names, step in zip((ACCELERATION, both), steps, strict=True):
            bent = adjusted(bent, score.all, score.directions(names), progress, steps=(step,))
            if score.of(bent) - score.cost(bent) < least:
                return place
        straight, whole = score.all_whole([place, bent])
        more = whole - score.cost(bent) - straight + score.cost(place)
        return bent if more >= EVIDENCE and not self._doubt(bent) else place

    def _doubt(self, place: FloatArray) -> str:
        """Return why an adjusted correction is not credible; empty if it is."""
        score, names, smaller = self._score, changed(place), PROOFS["smaller"]
        least = PROOFS["guess" if names <= self._guesses else "readout" if names == {"readout"} else "usual"]
        if score.of(place) < least.score:
            return NOT_CLEAR
        recordings = score.recordings(place)
        if np.abs(place).max() > MOST_DEVIATIONS or not all(is_held(each.capture()) for each in recordings):
            return TOO_FAR
        (whole,), quick = score.whole_falls([place]), score.falls(place)
        # The mean of several falls is as certain as a single larger one.
        mean, count = float(whole.mean()), len(whole)
        proof = mean * np.sqrt(count)
        sharper = proof >= least.fall or (self._by_both(place, whole) >= smaller.score and proof >= smaller.fall)
        # The quick measure must not rise; a fall proves less there, as the largest of many.
        if not sharper or quick.sum() < 0:
            return NOT_SHARPER
        return "" if agree(whole) else DISAGREE

    def _candidates(self, progress: Progress) -> list[FloatArray]:
        """Return the best correction of each model, and the best with its numbers alone; the best of all first."""
        score = self._score
        best, most = score.nothing, 0.0
        found = {best.tobytes(): (most, best)}
        tried: list[list[str]] = [[]]
        for n, (names, count) in enumerate(MODELS):
            progress("search", n / len(MODELS))
            model, last = [name for name in names if name in score.free], names is STRAIGHT
            # Descents of the last model take long, so it begins at the best place only, if that is worth it.
            if model in tried or (last and most < EVIDENCE):
                continue
            tried.append(model)
            begin = [best] if last or not best.any() else [score.nothing, best]
            starts = [*begin, *self._starts(model, count)]
            places = share_map(partial(score.descend, free=model), starts, self._score.threads)
            scores = np.array(score.all(places)) - [score.cost(place) for place in places]
            top = int(scores.argmax())
            others = [name not in model for name in PARAMETERS]
            alone = [at for at, place in enumerate(places) if not place[:, others].any()]
            for at in {top, max(alone, key=scores.__getitem__, default=top)}:
                found[places[at].tobytes()] = float(scores[at]), places[at]
            if scores[top] > most:
                most, best = float(scores[top]), places[top]
        for place in self._followed(progress):
            found[place.tobytes()] = score.of(place) - score.cost(place), place
        return [place for _, place in sorted(found.values(), key=lambda pair: -pair[0])]

    def _starts(self, model: Sequence[str], count: int) -> list[FloatArray]:
        """Return the best of places that are spread over the parameters of a model, `count` values of each."""
        score = self._score
        if len(score.photos) > 1 and not set(model) & set(SHARED):
            # Numbers that belong to the photo: photos do not depend on each other.
            each_alone = (Score([photo], score.deviations, score.threads) for photo in score.photos)
            alone = [Search(each)._starts(model, count) for each in each_alone]
            return [np.concatenate(rows) for rows in zip_longest(*alone, fillvalue=score.nothing[:1])]
        places = self._grid(model, count)
        gains = np.array(share_map(score.spectra_gain, places, self._score.threads))
        likely = [n for n in np.argsort(-gains)[: round(COMPARED * len(places))] if gains[n] > HOPELESS]
        falls = share_map(lambda n: float(score.falls(places[n]).sum()), likely, self._score.threads)
        scores = gains[likely] + NATS_PER_FALL * np.array(falls)
        return [places[likely[n]] for n in np.argsort(-scores)[:STARTS]]

    def _grid(self, model: Sequence[str], count: int) -> list[FloatArray]:
        """Return places that are spread over the parameters of a model, `count` values of each; none if it is empty."""
        steps = self._score.directions(model)
        if list(model) == ["readout"] and "readout" in self._guesses:
            count = int(2 * WIDEST * self._score.deviations[PARAMETERS.index("readout")] / SPACING) + 2
        values = product(np.linspace(-WIDEST, WIDEST, count), repeat=len(steps))
        return [self._score.nothing + np.tensordot(each, steps, 1) for each in values] if steps else []

    def _followed(self, progress: Progress) -> list[FloatArray]:
        """Return the correction that light streaks prefer, and what the spectra and they prefer from there."""
        score, (names, steps) = self._score, ADJUSTMENTS["streaks"]
        axes = score.directions(names)
        if len(score.photos) > 1 or not axes or not score.photos[0].picture.streaks.streaks:
            return []

        def likely(places: Sequence[FloatArray]) -> list[float]:
            return share_map(
                lambda place: sum(score.streak_nats(place)) - score.prior(place), places, self._score.threads
            )

        def gains(places: Sequence[FloatArray]) -> list[float]:
            return share_map(score.gain, places, self._score.threads)

        begin = [score.nothing, *self._grid(DRIFT, dict(MODELS)[DRIFT])]
        first = adjusted(begin[int(np.argmax(likely(begin)))], likely, axes, progress, steps=steps[:1])
        if score.streak_gain(first) < EVIDENCE:
            return []
        place = adjusted(first, likely, axes, progress, steps=steps[:2])
        return [place, adjusted(place, gains, axes, progress, steps=steps[1:])]


def changed(place: FloatArray) -> set[str]:
    """Return the names of the parameters that a place changes."""
    return {PARAMETERS[at] for at in np.nonzero(place)[1].tolist()}


def agree(falls: FloatArray) -> bool:
    """Return whether the mean of the falls of photos, shape (N,), is over twice its standard error; True of one."""
    # A photo that becomes far clearer than the others does not contradict them.
    count, falls = len(falls), np.minimum(falls, 2 * np.median(falls))
    return count == 1 or bool(falls.mean() > 2 * falls.std(ddof=1) / np.sqrt(count))


def adjusted(
    place: FloatArray,
    scores: Callable[[Sequence[FloatArray]], list[float]],
    directions: Sequence[FloatArray],
    progress: Progress,
    *,
    steps: Sequence[float],
) -> FloatArray:
    """Return the best place that a search by parabolas finds, along one direction after another, for each step size."""
    (most,) = scores([place])
    for n, step in enumerate(steps):
        progress("adjust", n / len(steps))
        for direction in directions:
            aside = step * direction
            below, above = scores([place - aside, place + aside])
            bend = 2 * most - below - above
            away = 0.5 * (above - below) / bend if bend > 0 else np.sign(above - below) * MOST_STEPS
            vertex = place + np.clip(away, -MOST_STEPS, MOST_STEPS) * aside
            tried = (most, place), (below, place - aside), (above, place + aside), (scores([vertex])[0], vertex)
            most, place = max(tried, key=lambda pair: pair[0])
    return place


def rival_lead(score: Score, found: Sequence[Recording]) -> float:
    """Return by how many nats the photos are likelier with the best other mounting than with corrected recordings."""
    corrected, lengths = score.under(found), mean_lengths(found)
    steps = score.directions(["offset"])
    shares = (-1.0, -0.5, 0.0, 0.5, 1.0)
    places = [score.nothing + share * WIDEST * steps[0] for share in shares] if steps else [score.nothing]
    free = [name for name in FREE if name in score.free]

    def tried(turn: FloatArray) -> tuple[Score, list[float]]:
        """Return the scores with another mounting, and the leads of its spectra at the places of all offsets."""
        given = [photo.recording for photo in score.photos]
        turned = replace(given[0].camera, imu_to_camera=turn @ given[0].camera.imu_to_camera)
        rival = score.under([replace(each, camera=turned) for each in given])
        return rival, [rival.spectra_gain(place, corrected) for place in places]

    def evidence(rival: Score, place: FloatArray) -> float:
        falls = rival.falls(place, corrected)
        # With shorter paths, the corrected recording may be clearer because it removes less blur: that counts little.
        shorter = lengths < SHORTER * mean_lengths(rival.recordings(place))
        falls = np.where(shorter, falls.clip(-PROOFS["usual"].fall), falls)
        return rival.gain(place, corrected) + NATS_PER_FALL * float(falls.sum())

    def whole_lead(rival: Score, leads: Sequence[float]) -> float:
        compared = [place for place, lead in zip(places, leads, strict=True) if lead >= HOPELESS]
        if free:
            with suppress(*UNDESCRIBED):
                compared.append(rival.descend(places[int(np.argmax(leads))], free))
        return max((evidence(rival, place) for place in compared), default=-np.inf)

    # Left-handed axes have the spectra of right-handed ones.
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    rivals = sorted(share_map(tried, turns, score.threads), key=lambda rival: -max(rival[1]))
    return max(share_map(lambda rival: whole_lead(*rival), rivals[:FITTED], score.threads))
