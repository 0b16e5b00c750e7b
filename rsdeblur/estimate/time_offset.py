"""Estimate of the clock offset between gyroscope and camera from blurred photos: the search of `refine`, but wider.

Each candidate offset predicts the PSFs of a photo, and so its spectra. The likeliest offsets are refined with all other
corrections free (:mod:`rsdeblur.estimate.search`), and the one with the highest score is the answer if it is credible.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import share_map
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.estimate.correction import PARAMETERS, Correction, Recording, Uncertainty
from rsdeblur.estimate.posterior import UNDESCRIBED, costs_of
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL
from rsdeblur.estimate.refine import AHEAD_OF_AXES, exposures_of, grey_lights
from rsdeblur.estimate.rival_axes import OTHER_AXES, rival_lead
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.search import (
    DISAGREE,
    LEAST_AGREEMENT,
    LEAST_FALL,
    LEAST_SCORE,
    NOT_CLEAR,
    NOT_SHARPER,
    Search,
)
from rsdeblur.motion.arguments import check_recording
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Step of the candidates, s, and the number of likeliest ones that the sharp pictures compare and that are refined.
STEP, COMPARED, REFINED = 4e-3, 6, 2
# Longest search, and largest offset, s.
MOST_SEARCH, LARGEST_OFFSET = 120.0, 1e9
# Offsets nearer than this count as the same answer, and the largest standard deviation of an answer, s.
SAME, MOST_DEVIATION = 4e-3, 4e-3
# Nats by which an answer must lead any other one.
LEAST_LEAD = 10.0
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
    """

    time_offset: float | None
    best: float
    sd: float
    lead: float
    reason: str
    offsets: FloatArray
    scores: FloatArray


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
    exposures = exposures_of(exposure)
    for each in exposures:
        check_recording(log, camera, each)
    validate.callback("progress", progress)
    first, last = validate.real_array("search", search, (2,), most=LARGEST_OFFSET).tolist()
    if last - first < 2 * STEP:
        raise InputError(f"search must span at least {2 * STEP:g} s, got {first:g} to {last:g}")
    recordings = [Recording(log, camera, each) for each in exposures]
    shifts = reduce(np.intersect1d, (_covered(each, first, last) for each in recordings))
    if len(shifts) == 0:
        raise CoverageError("the log covers the exposures under no offset of the search; widen it, or check the clocks")
    lights = grey_lights(image, transfer, camera, exposure)
    return _Clock(lights, recordings, shifts, threads).answer(progress or (lambda *_: None))


class _Answer(NamedTuple):
    """An offset, refined together with all other corrections.

    Parameters
    ----------
    offset, sd : float
        The offset and its standard deviation, s.
    total : float
        Score over the recordings from which the search begins, nats.
    falls : ndarray, shape (N,)
        Falls of the logarithms of l1 / l2 of the whole solves over these recordings.
    score : Score
        Scores of corrections of the recordings with this candidate.
    recordings : list of Recording
        The corrected recordings.
    """

    offset: float
    sd: float
    total: float
    falls: FloatArray
    score: Score
    recordings: list[Recording]


class _Clock:
    """Search for the offset that photos of one recording share."""

    def __init__(
        self,
        lights: Sequence[NDArray[np.float32]],
        recordings: Sequence[Recording],
        shifts: FloatArray,
        threads: int | None,
    ) -> None:
        self._given, self._shifts, self._threads = recordings, shifts, threads
        longest = max((each.exposure for each in recordings), key=lambda each: each.duration)
        # With two numbers more, wrong axes explain many photos.
        self._deviations = Uncertainty(acceleration=0.0).deviations(recordings[0].camera, longest)
        # Measures need a recording that the log describes: the nearest to the one that is given.
        nearest = float(shifts[np.abs(shifts).argmin()])
        self._score = Score.of_photos(lights, self._shifted(nearest), self._deviations, threads)

    def _shifted(self, shift: float) -> list[Recording]:
        return [each.corrected(Correction(offset=shift)) for each in self._given]

    def answer(self, progress: Progress) -> OffsetSearch:
        """Return the offset, or the likeliest one and why it is not the answer."""
        costs = self._curve(progress)
        likely = self._likely(costs)[:REFINED]
        answers = [self._refined(n, progress) for n in likely]
        best = max(answers, key=lambda each: each.total)
        others = [each.total for each in answers if abs(each.offset - best.offset) > SAME]
        lead = best.total - max(others, default=-np.inf)
        at_end = likely[answers.index(best)] in (0, len(costs) - 1)
        reason = AT_END if at_end else self._doubt(best, lead)
        origin = self._given[0].camera.time_offset
        return OffsetSearch(
            time_offset=None if reason else best.offset,
            best=best.offset,
            sd=best.sd,
            lead=lead,
            reason=reason,
            offsets=origin + self._shifts,
            scores=costs,
        )

    def _doubt(self, best: _Answer, lead: float) -> str:
        """Return why an offset is not credible; empty if it is."""
        if lead < LEAST_LEAD or best.sd > MOST_DEVIATION:
            return NOT_SURE
        if abs(best.offset - self._given[0].camera.time_offset) > SAME:
            if best.total < LEAST_SCORE:
                return NOT_CLEAR
            count = len(best.falls)
            if float(best.falls.mean()) * np.sqrt(count) < LEAST_FALL:
                return NOT_SHARPER
            if count > 1 and best.falls.mean() < LEAST_AGREEMENT * best.falls.std(ddof=1) / np.sqrt(count):
                return DISAGREE
        rivals = rival_lead(best.score, best.recordings, self._deviations, threads=self._threads)
        return OTHER_AXES if rivals > -AHEAD_OF_AXES else ""

    def _curve(self, progress: Progress) -> FloatArray:
        """Return how much less likely than the best the candidates are by the spectra, nats; infinite without a log."""
        photos = self._score.photos

        def score(n: int) -> list[FloatArray] | None:
            progress("search", n / len(self._shifts))
            pairs = zip(photos, self._shifted(float(self._shifts[n])), strict=True)
            try:
                return [photo.likelihood.spectra.score(each) for photo, each in pairs]
            except UNDESCRIBED:
                return None

        every = share_map(score, range(len(self._shifts)), self._threads)
        described = [each for each in every if each is not None]
        costs = np.full(len(every), np.inf)
        costs[[each is not None for each in every]] = sum(
            costs_of(np.array(photo)) for photo in zip(*described, strict=True)
        )
        least: FloatArray = costs - costs.min()
        return least

    def _likely(self, costs: FloatArray) -> list[int]:
        """Return the candidates that are likelier than their neighbours; the best by spectra and pictures first."""
        padded = np.pad(costs, 1, constant_values=np.inf)
        (minima,) = np.nonzero((costs <= padded[:-2]) & (costs <= padded[2:]) & np.isfinite(costs))
        minima = minima[np.argsort(costs[minima])][:COMPARED]

        def total(n: int) -> float:
            pairs = zip(self._score.photos, self._shifted(float(self._shifts[n])), strict=True)
            return float(costs[n]) + NATS_PER_FALL * sum(photo.measures.quick.of(each) for photo, each in pairs)

        return [int(minima[n]) for n in np.argsort(share_map(total, minima.tolist(), self._threads))]

    def _refined(self, n: int, progress: Progress) -> _Answer:
        """Return a candidate, refined together with all other corrections."""
        start = self._score
        score = start.under(self._shifted(float(self._shifts[n])), self._deviations)
        place, reason = Search(score, self._threads).best(progress)
        if reason:
            # No other correction is credible.
            place = score.posterior.descend(score.nothing, ["offset"])
        recordings = score.posterior.recordings(place)
        offset = PARAMETERS.index("offset")
        return _Answer(
            recordings[0].camera.time_offset,
            float(score.posterior.spread(place)[0, offset] * self._deviations[offset]),
            total=score.over(place, start) - score.cost(place),
            falls=start.whole_sparsities(start.nothing) - score.whole_sparsities(place),
            score=score,
            recordings=recordings,
        )


def _covered(recording: Recording, first: float, last: float) -> FloatArray:
    """Return the candidates that the log covers, s; steps are counted from `first`.

    Raises
    ------
    InputError
        If they span more than `MOST_SEARCH`.
    """
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
