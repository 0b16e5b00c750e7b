"""Estimate of the clock offset between gyroscope and camera from blurred photos: the search of `refine`, but wider.

Each candidate offset predicts the PSFs of a photo, and so its spectra. The likeliest offsets are refined with all other
corrections free (:mod:`rsdeblur.estimate.search`), and the one with the highest score is the answer if it is credible.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import share_map
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.estimate.check import ALTERNATIVES, best_alternative
from rsdeblur.estimate.correction import ACCELERATION, DRIFT, PARAMETERS, Correction, Recording, Uncertainty
from rsdeblur.estimate.motion_evidence import MotionEvidence
from rsdeblur.estimate.posterior import UNDESCRIBED, costs_of
from rsdeblur.estimate.refine import grey_lights, longest_of, recordings_of
from rsdeblur.estimate.score import PROOFS, Score
from rsdeblur.estimate.search import (
    ADJUSTMENTS,
    AHEAD_OF_AXES,
    DISAGREE,
    FITTED,
    NOT_CLEAR,
    NOT_SHARPER,
    OTHER_AXES,
    Search,
    adjusted,
    agree,
    rival_lead,
)
from rsdeblur.image.encoded import EncodedImage, upright
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Step of the candidates, s; nearer offsets count as the same answer.
STEP = 4e-3
# What is corrected together with the offset.
MODELS = ("offset",), ("offset", "scale"), ("offset", *DRIFT), ("offset", "scale", *DRIFT, *ACCELERATION)
# What is found together where the readout time is a guess.
MOMENT = "offset", "readout"
# Longest search, and the largest standard deviation of an answer, s.
MOST_SEARCH, MOST_DEVIATION = 120.0, 2.5e-3
# Search, s, from which an answer must lead the alternatives of the check, too: among so many moments there is one whose
# motion resembles any straight blur. With it, none of 40 wrong logs is accepted (`python -m benchmarks.stock`).
WIDE = 0.5
# Nats by which an answer must lead any other one.
LEAST_LEAD = 15.0
NOT_SURE = "other offsets explain the blur as well: the motion is too uniform, or the scene without detail"
AT_END = "the likeliest offset lies at the end of the search, or of the log; widen it"


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class OffsetSearch:
    """Result of :func:`find_time_offset`.

    Parameters
    ----------
    time_offset : float or None
        The camera's new `time_offset`, s; None if the photos do not determine it.
    best : float
        The likeliest offset, s, whether it is reliable or not.
    sd : float
        Its standard deviation, s.
    lead : float
        How much likelier it is than any other one, nats.
    reason : str
        Why `time_offset` is None; empty otherwise.
    offsets : ndarray, shape (n,)
        Candidates of the search, s, increasing.
    scores : ndarray, shape (n,)
        Negative log-likelihood of each by the spectra, in nats above the best.
    camera : Camera
        The camera with the likeliest offset. If its readout time is a guess (`readout_sd`), with the likeliest readout
        time, too, and the offset that goes with it.
    """

    time_offset: float | None
    best: float
    sd: float
    lead: float
    reason: str
    offsets: FloatArray
    scores: FloatArray
    camera: Camera


def find_time_offset(
    image: ArrayLike | Iterable[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposure: Exposure | Sequence[Exposure],
    *,
    search: tuple[float, float] = (-0.06, 0.06),
    transfer: Transfer | Auto = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> OffsetSearch:
    """Find the time offset of the clocks by one or several blurred photos.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C), or iterable of these
        The blurred photo, as for :func:`rsdeblur.deblur`; or several of one recording, which share the offset.
    log, camera
        The motion and the camera.
    exposure : Exposure or sequence of Exposure
        The time of the exposure, of each photo if there are several.
    search : (float, float)
        First and last candidate relative to `camera.time_offset`, s. Candidates that the log does not cover are left
        out; the others may span two minutes.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    threads : int, optional
        Threads that share the work; default all processors.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    OffsetSearch
        Its `time_offset` is None where the photos do not determine it.

    Raises
    ------
    InputError
        If an argument is out of range, or a photo is too small.
    CoverageError, ClockError, GapError
        If the log covers no candidate.

    Notes
    -----
    See :func:`rsdeblur.refine` for what is compared, and for the other corrections that an answer allows for.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.read_gyro("gyro.csv"), rsdeblur.read_camera("camera.toml")  # doctest: +SKIP
    >>> rsdeblur.find_time_offset(image, log, camera, rsdeblur.Exposure(0.25, 0.05)).time_offset  # doctest: +SKIP
    0.0123
    """
    recordings = recordings_of(log, camera, exposure)
    validate.callback("progress", progress)
    first, last = validate.real_array("search", search, (2,), most=validate.MOST_SECONDS).tolist()
    if last - first < 2 * STEP:
        raise InputError(f"search must span at least {2 * STEP:g} s, got {first:g} to {last:g}")
    shifts = reduce(np.intersect1d, (_covered(each, first, last) for each in recordings))
    if len(shifts) == 0:
        raise CoverageError("the log covers the exposures under no offset of the search; widen it, or check the clocks")
    lights = grey_lights(image, transfer, camera, exposure)
    return _Clock(lights, recordings, shifts, threads).answer(progress or (lambda *_: None))


class _Answer(NamedTuple):
    """An offset together with other corrections: `place` (N, 8) of the recordings with the `candidate`.

    `total` is its score over the recordings from which the search begins, nats, by the smaller of both falls; `falls`
    are those of the whole solves over these recordings, shape (N,).
    """

    candidate: int
    score: Score
    place: FloatArray
    total: float
    falls: FloatArray

    @property
    def recordings(self) -> list[Recording]:
        return self.score.recordings(self.place)

    @property
    def offset(self) -> float:
        return self.recordings[0].camera.time_offset


class _Clock:
    """Search for the offset that photos of one recording share."""

    def __init__(
        self,
        lights: Sequence[NDArray[np.float32]],
        recordings: Sequence[Recording],
        shifts: FloatArray,
        threads: int | None,
    ) -> None:
        self._lights, self._given, self._shifts = lights, recordings, shifts
        deviations = Uncertainty().deviations(recordings[0].camera, longest_of(recordings))
        # Measures need a recording that the log describes: the nearest to the one that is given.
        nearest = float(shifts[np.abs(shifts).argmin()])
        self._score = Score.of_photos(lights, self._shifted(nearest), deviations, threads)

    def _shifted(self, shift: float) -> list[Recording]:
        return [each.corrected(Correction(offset=shift)) for each in self._given]

    def answer(self, progress: Progress) -> OffsetSearch:
        """Return the offset, or the likeliest one and why it is not the answer."""
        costs = self._curve(progress)
        answers = [self._corrected(n) for n in self._likely(costs)]
        best = max(answers, key=lambda each: each.total)
        others = [each.total for each in answers if abs(each.offset - best.offset) > STEP]
        lead = best.total - max(others, default=-np.inf)
        best = self._searched(best, progress)
        at, given = PARAMETERS.index("offset"), self._given[0].camera.time_offset
        sd = float(best.score.spread(best.place)[0, at] * best.score.deviations[at])
        reason = AT_END if best.candidate in (0, len(costs) - 1) else self._doubt(best, lead, sd)
        rivals = rival_lead(best.score, best.recordings)
        # What is not sure may still be sure of other axes.
        if reason != AT_END and rivals > (LEAST_LEAD if reason else -AHEAD_OF_AXES):
            reason = OTHER_AXES
        offset, camera = best.offset, self._camera(best)
        return OffsetSearch(None if reason else offset, offset, sd, lead, reason, given + self._shifts, costs, camera)

    def _camera(self, best: _Answer) -> Camera:
        """Return the camera with the offset of an answer, and with the likeliest readout time where that is a guess."""
        # The spectra alone find both: neither is known, so neither needs the proof of a correction.
        camera, score = self._given[0].camera, best.score
        camera = replace(camera, time_offset=best.offset, time_offset_sd=MOST_DEVIATION)
        if not camera.readout_sd:
            return camera
        offset, readout = map(PARAMETERS.index, MOMENT)
        units, places = score.deviations, [best.place]
        for share in (-0.5, 0.0, 0.5):
            place = best.place.copy()
            place[:, readout] += share
            # The middle row stays where the offset has it.
            later = camera.readout_time * np.expm1(share * units[readout]) / 2
            place[:, offset] += later / units[offset]
            with suppress(*UNDESCRIBED):
                places.append(score.descend(place, MOMENT))
        nats = score.nats(best.place)
        assert nats is not None, "the log describes the answer"
        place = max(places, key=lambda place: score.lead(place, nats))
        found = score.recordings(place)[0].camera
        sd = float(score.spread(place)[0, readout] * units[readout]) * found.readout_time
        sd = min(sd, camera.readout_sd)
        return replace(camera, time_offset=found.time_offset, readout_time=found.readout_time, readout_sd=sd)

    def _doubt(self, best: _Answer, lead: float, sd: float) -> str:
        """Return why an offset is not credible, whatever the axes are; empty if it is."""
        if lead < LEAST_LEAD or sd > MOST_DEVIATION:
            return NOT_SURE
        if abs(best.offset - self._given[0].camera.time_offset) <= STEP:
            return ""
        if best.total < PROOFS["usual"].score:
            return NOT_CLEAR
        if float(best.falls.mean()) * np.sqrt(len(best.falls)) < PROOFS["usual"].fall:
            return NOT_SHARPER
        if not agree(best.falls):
            return DISAGREE
        return self._explained_better(best) if self._shifts[-1] - self._shifts[0] > WIDE else ""

    def _explained_better(self, best: _Answer) -> str:
        """Return which alternative explains the photos better than an answer; empty if none does."""
        frames = []
        for light, each in zip(self._lights, best.recordings, strict=True):
            scale = max(light.shape) / max(each.camera.width, each.camera.height)
            frames.append((EncodedImage.of(upright(light, each.camera, scale), "linear"), each.capture(scale)))
        evidence = MotionEvidence.of_burst(frames, threads=self._score.threads)
        if evidence.tiles is None:
            return ""
        name, lead = best_alternative(evidence, self._score.threads)
        return f"the picture is explained better by {ALTERNATIVES[name].hint}" if lead < 0 else ""

    def _curve(self, progress: Progress) -> FloatArray:
        """Return how much less likely than the best the candidates are by the spectra, nats; infinite without a log."""

        def nats(n: int) -> list[FloatArray] | None:
            progress("search", n / len(self._shifts))
            shifted = self._score.under(self._shifted(float(self._shifts[n])))
            return shifted.nats(shifted.nothing)

        costs = costs_of(share_map(nats, range(len(self._shifts)), self._score.threads))
        least: FloatArray = costs - costs.min()
        return least

    def _likely(self, costs: FloatArray) -> list[int]:
        """Return the candidates that are likelier than their neighbours; the likeliest ones, with the best first."""
        padded = np.pad(costs, 1, constant_values=np.inf)
        (minima,) = np.nonzero((costs <= padded[:-2]) & (costs <= padded[2:]) & np.isfinite(costs))
        likely: list[int] = minima[np.argsort(costs[minima])][:FITTED].tolist()
        return likely

    def _corrected(self, n: int) -> _Answer:
        """Return a candidate, corrected by the spectra and adjusted by the sharp pictures."""
        score = self._score.under(self._shifted(float(self._shifts[n])))

        def totals(places: Sequence[FloatArray]) -> list[float]:
            return share_map(lambda place: score.over(place, self._score) - score.cost(place), places, score.threads)

        models = [[name for name in names if name in score.free] for names in MODELS]
        places = share_map(lambda model: score.descend(score.nothing, model), models, score.threads)
        place = places[int(np.argmax(totals(places)))]
        names, steps = ADJUSTMENTS["offset"]
        axes = score.directions(names)
        return self._answer(n, score, adjusted(place, totals, axes, lambda *_: None, steps=steps))

    def _searched(self, answer: _Answer, progress: Progress) -> _Answer:
        """Return an answer with the correction that the whole search finds, if it is credible and better."""
        place, reason = Search(answer.score, guesses=False).best(progress)
        better = self._answer(answer.candidate, answer.score, place)
        return better if not reason and better.total > answer.total else answer

    def _answer(self, candidate: int, score: Score, place: FloatArray) -> _Answer:
        start = self._score
        whole = start.whole_sparsities(start.nothing) - score.whole_sparsities(place)
        total = score.over(place, start, most=float(whole.sum())) - score.cost(place)
        return _Answer(candidate, score, place, total, whole)


def _covered(recording: Recording, first: float, last: float) -> FloatArray:
    """Return the candidates that the log covers, s, at most `MOST_SEARCH`; steps are counted from `first`."""
    log, camera, exposure = recording.log, recording.camera, recording.exposure
    opens, closes = exposure.span(camera)
    # Camera time minus the log's own time.
    offset = camera.time_offset + (log.epoch_ns - exposure.epoch_ns) * 1e-9
    start, end = log.span
    earliest, latest = max(first, closes - end - offset), min(last, opens - start - offset)
    if latest - earliest > MOST_SEARCH:
        raise InputError(f"search must span at most {MOST_SEARCH:g} s of the log, got {first:g} to {last:g}")
    steps = np.arange(np.ceil((earliest - first) / STEP), np.floor((latest - first) / STEP) + 1)
    return first + STEP * steps
