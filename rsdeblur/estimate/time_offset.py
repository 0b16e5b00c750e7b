"""Estimate of the clock offset between gyroscope and camera from one blurred picture.

Nothing is deblurred. A blur leaves its spectrum in the picture, with zeros where that of the PSF has zeros. Each
candidate offset predicts a PSF for every tile of the picture, and so the power of each tile at each frequency. The
offset under which the measured spectra are likeliest wins. The rolling shutter helps: every band tests another stretch
of the log.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.estimate.correction import Correction, Recording, Uncertainty
from rsdeblur.estimate.posterior import PhotoLikelihood, Posterior
from rsdeblur.estimate.quick_sharpness import QuickSharpness
from rsdeblur.estimate.rival_axes import OTHER_AXES
from rsdeblur.estimate.sharpness import Sharpness
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.image.encoded import EncodedImage, check_size
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Longer side of the reduced picture in the coarse and in the fine search, px, and the steps there, s.
COARSE_SIDE, COARSE_STEP = 320, 4e-3
FINE_SIDE, FINE_STEP = 480, 1e-3
# Minima of the coarse curve that the fine search examines.
MINIMA = 6
# Longest search, and largest offset, s.
MOST_SEARCH, LARGEST_OFFSET = 120.0, 1e9
# Offsets nearer than this count as the same answer, s.
SAME = 4e-3
# Largest spread of the offsets of several pictures that agree, s. One picture may err by 2 ms, rarely by 5.
MOST_SPREAD = 6e-3

# Resamplings of the tiles from which the confidence follows, and the least confidence of an answer.
RESAMPLES, CONFIDENT = 200, 0.8
# Least lead over any other answer, in nats over the whole picture. A constant rate of rotation gives every offset the
# same PSF, and then nothing leads.
LEAST_LEAD = 30.0
# Other axes of the gyro: turned about the optical axis by a quarter or a half, as by another preset; one reversed; or x
# and y exchanged. Half a turn leaves the power spectrum of each path as it is, so the sharp picture decides.
RIVALS = np.array(
    [
        [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    ]
)
# Samples of the steady motions that an offset is compared with, a power of 2, all within this many standard deviations,
# and the best that descents begin from; samples closer than the last number, standard deviations, are not both starts.
SAMPLES, WIDEST, STARTS, APART = 32, 2.0, 2, 0.7
# Coarse candidates for which rivals are tried: they take five times as long as the search.
MOST_RIVAL = 100
DISAGREE = "the pictures are sure of different offsets: do all exposures belong to this log, or do the clocks drift?"
# Least fall of the logarithm of l1 / l2, see :mod:`rsdeblur.estimate.sharpness`.
LEAST_FALL = 0.005
# The same under the motion turned by half a turn; right motions reach 0.000.
LEAST_TURN = 0.01
# Nats of all tiles that such a fall is worth in an answer that is sure otherwise.
TOTAL_NATS_PER_FALL = 3e4


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class OffsetSearch:
    """Result of :func:`find_time_offset`.

    Parameters
    ----------
    time_offset : float or None
        The camera's new `time_offset`, s; None if the picture does not determine it.
    best : float
        The likeliest offset, s, whether it is reliable or not.
    confidence : float
        Share, in [0, 1], of resamplings of the picture's tiles that give the same answer.
    reason : str
        Why `time_offset` is None; empty otherwise.
    offsets : ndarray, shape (n,)
        Candidates of the fine search, s, increasing.
    scores : ndarray, shape (n,)
        Negative log-likelihood of each, in nats above the best.
    """

    time_offset: float | None
    best: float
    confidence: float
    reason: str
    offsets: FloatArray
    scores: FloatArray


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class SharedOffset:
    """Result of :func:`find_shared_time_offset`.

    Parameters
    ----------
    joint : OffsetSearch
        The answer of all pictures together; its `time_offset` is None if they do not determine it, or disagree.
    pictures : tuple of OffsetSearch
        The answer of each picture alone, among the candidates of the joint search. Those without a `time_offset`
        determine none alone.
    """

    joint: OffsetSearch
    pictures: tuple[OffsetSearch, ...]


def find_time_offset(
    image: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    search: tuple[float, float] = (-0.06, 0.06),
    transfer: Transfer | Auto = "auto",
    progress: Progress | None = None,
) -> OffsetSearch:
    """Find the time offset under which the picture's spectra are likeliest.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C)
        The blurred picture, as for :func:`rsdeblur.deblur`.
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    search : (float, float)
        First and last candidate relative to `camera.time_offset`, s. Candidates that the log does not cover are left
        out; the others may span two minutes.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    OffsetSearch
        Its `time_offset` is None where different tiles of the picture give different answers.

    Raises
    ------
    InputError
        If an argument is out of range, or the picture is too small.
    CoverageError, ClockError, GapError
        If the log covers no candidate.

    Notes
    -----
    A periodogram is distributed exponentially about its mean, so its negative log-likelihood is
    `sum log V + P / V` (Whittle 1953) with `V = a S |H|^2 + b N`: S the scene's spectrum, whose gradients are taken as
    white, N the noise's, and a, b free in every tile.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.read_gyro("gyro.csv"), rsdeblur.read_camera("camera.toml")  # doctest: +SKIP
    >>> rsdeblur.find_time_offset(image, log, camera, rsdeblur.Exposure(0.25, 0.05)).time_offset  # doctest: +SKIP
    0.0123
    """
    check_recording(log, camera, exposure)
    validate.callback("progress", progress)
    return _find([EncodedImage.of(image, transfer)], [Recording(log, camera, exposure)], search, progress).joint


def find_shared_time_offset(
    images: Sequence[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    search: tuple[float, float] = (-0.06, 0.06),
    transfer: Transfer | Auto = "auto",
    progress: Progress | None = None,
) -> SharedOffset:
    """Find the time offset that several pictures of one recording share.

    Their log-likelihoods are added, so pictures that determine nothing alone may do so together; those that are sure
    of different offsets are named.

    Parameters
    ----------
    images : sequence of array_like, shape (H, W) or (H, W, C)
        The blurred pictures.
    log, camera
        The motion and the camera.
    exposures : sequence of Exposure
        The time of the exposure of each picture.
    search, transfer, progress
        As for :func:`find_time_offset`. Candidates that the log does not cover for each picture are left out.

    Returns
    -------
    SharedOffset
        The joint answer, and those of the pictures.

    Raises
    ------
    InputError
        If an argument is out of range, a picture is too small, or `images` is empty.
    CoverageError, ClockError, GapError
        If the log covers no candidate.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.read_gyro("gyro.csv"), rsdeblur.read_camera("camera.toml")  # doctest: +SKIP
    >>> found = rsdeblur.find_shared_time_offset([one, two], log, camera, exposures)  # doctest: +SKIP
    >>> found.joint.time_offset, [picture.best for picture in found.pictures]  # doctest: +SKIP
    (0.0123, [0.0121, 0.0125])
    """
    images, exposures = list(validate.items("images", images)), exposure_list(exposures)
    if not 0 < len(images) == len(exposures):
        raise InputError(f"give one exposure for each picture, got {len(images)} images and {len(exposures)} exposures")
    for exposure in exposures:
        check_recording(log, camera, exposure)
    validate.callback("progress", progress)
    encoded = [EncodedImage.of(image, transfer) for image in images]
    return _find(encoded, [Recording(log, camera, exposure) for exposure in exposures], search, progress)


def _find(
    encoded: Sequence[EncodedImage],
    recordings: Sequence[Recording],
    search: tuple[float, float],
    progress: Progress | None,
) -> SharedOffset:
    """Find the time offset of pictures of one camera, together and each alone."""
    first, last = validate.real_array("search", search, (2,), most=LARGEST_OFFSET).tolist()
    if last - first < 2 * COARSE_STEP:
        raise InputError(f"search must span at least {2 * COARSE_STEP:g} s, got {first:g} to {last:g}")
    camera = recordings[0].camera
    covered = reduce(np.intersect1d, (_covered(r.log, camera, r.exposure, first, last) for r in recordings))
    whole = covered if len(covered) else np.zeros(1, dtype=np.intp)
    for image in encoded:
        check_size(image.shape, camera)
    lights = [image.grey(slice(None)) for image in encoded]
    coarse = _Curve(lights, recordings, first, side=COARSE_SIDE)
    coarse.extend(whole, lambda done: progress and progress("coarse", done))
    fine = _Curve(lights, recordings, first, side=FINE_SIDE)
    candidates = _windows(np.concatenate([coarse.minima(part)[:MINIMA] for part in coarse.parts]), whole[-1])
    while len(candidates):
        fine.extend(candidates, lambda done: progress and progress("fine", done))
        # A minimum may lie beside the window that the coarse curve chose.
        beside = [_windows(fine.minima(part)[:1], whole[-1]) for part in fine.parts if fine.at_edge(part)]
        candidates = np.setdiff1d(np.concatenate([candidates[:0], *beside]), fine.tried)
    joint, *alone = (fine.result(part) for part in fine.parts)
    reason = joint.reason
    sure = [picture.time_offset for picture in alone if picture.time_offset is not None]
    if np.ptp(sure or [0.0]) > MOST_SPREAD:
        reason = DISAGREE
    elif not reason and abs(joint.best - camera.time_offset) > SAME:
        parts = zip(lights, fine.spectra, recordings, strict=True)
        against = [objection for part in parts if (objection := _objection(*part, joint.best))]
        # Of several pictures, one may move in a way that explains its blur.
        reason = against[0] if 2 * len(against) > len(recordings) else ""
    if reason != DISAGREE and _has_other_axes(lights, recordings, coarse, joint, sure=not reason):
        reason = OTHER_AXES
    joint = replace(joint, time_offset=None if reason else joint.best, reason=reason)
    return SharedOffset(joint, tuple(alone) or (joint,))


def _covered(log: GyroLog, camera: Camera, exposure: Exposure, first: float, last: float) -> NDArray[np.intp]:
    """Return the coarse candidates that the log may cover, in fine steps from `first`; at least the first one.

    Raises
    ------
    InputError
        If they span more than `MOST_SEARCH`.
    """
    opens, closes = exposure.span(camera)
    # Camera time minus the log's own time, for the first candidate.
    offset = camera.time_offset + first + (log.epoch_ns - exposure.epoch_ns) * 1e-9
    start, end = log.span
    earliest, latest = max(closes - end - offset, 0.0), min(opens - start - offset, last - first)
    if latest - earliest > MOST_SEARCH:
        raise InputError(f"search must span at most {MOST_SEARCH:g} s of the log, got {first:g} to {last:g}")
    if latest <= earliest:
        return np.zeros(1, dtype=np.intp)
    step = round(COARSE_STEP / FINE_STEP)
    # One more at either end, so that rounding loses none; those beyond the log are left out later.
    lowest = max(int(earliest / COARSE_STEP) - 1, 0) * step
    highest = min(int(latest / FINE_STEP) + 2 * step, round((last - first) / FINE_STEP))
    return np.arange(lowest, highest + 1, step)


def _windows(places: NDArray[np.intp], last: int) -> NDArray[np.intp]:
    """Return all fine steps from 0 to `last` that are within a coarse step of one of `places`."""
    reach = round(COARSE_STEP / FINE_STEP)
    near = np.unique(places[:, None] + np.arange(-reach, reach + 1))
    return near[(near >= 0) & (near <= last)]


def _objection(light: NDArray[np.float32], spectra: TileSpectra, recording: Recording, time_offset: float) -> str:
    """Return why another time offset is not credible; nothing if it is."""
    shifted = recording.corrected(Correction(offset=time_offset - recording.camera.time_offset))
    sharpness = Sharpness(light, recording)
    reached = sharpness.of(shifted)
    if reached > sharpness.of(recording) - LEAST_FALL:
        return "the picture does not become sharper with it"
    uncertainty = Uncertainty(offset=0.0, readout=0.0, roll=0.0, acceleration=0.0)
    deviations = uncertainty.deviations(recording.camera, recording.exposure)
    posterior = Posterior([PhotoLikelihood(spectra, recording, deviations)], deviations)
    nats = [spectra.score(shifted)]
    for place in _maxima(posterior):
        if posterior.lead(place, nats) > 0 or sharpness.of(posterior.recordings(place)[0]) < reached:
            return "a steady motion that the log lacks, as of a hand that swings, explains the picture as well"
    return ""


def _maxima(posterior: Posterior) -> list[FloatArray]:
    """Return the local maxima that descents reach, from no correction and from the best samples."""
    from scipy.special import ndtr, ndtri
    from scipy.stats import qmc  # takes 0.5 s to import

    steps, low = posterior.directions(posterior.free), ndtr(-WIDEST)
    quantiles = qmc.Sobol(len(steps), seed=0).random(SAMPLES).clip(low, 1 - low)
    places = [posterior.nothing, *(np.tensordot(each, steps, 1) for each in ndtri(quantiles))]
    best, gains = posterior.nothing, np.zeros(len(places))
    for _ in range(2):
        # The gains of tiles are bounded, so the order may depend on what they are compared with.
        gains = np.array([posterior.gain(place, best) for place in places])
        best = places[int(gains.argmax())]
    starts = [posterior.nothing]
    for n in np.argsort(-gains):
        if len(starts) <= STARTS and all(np.abs(places[n] - start).max() > APART for start in starts):
            starts.append(places[n])
    return [posterior.descend(start, posterior.free) for start in starts if posterior.nats(start) is not None]


def _has_other_axes(
    lights: Sequence[NDArray[np.float32]],
    recordings: Sequence[Recording],
    coarse: _Curve,
    joint: OffsetSearch,
    *,
    sure: bool,
) -> bool:
    """Return whether other axes of the gyro explain the pictures better, at any offset.

    An answer that is `sure` otherwise fails if a rival is likelier and as sharp, or so much likelier or sharper that it
    makes up for the other. Else both must hold, because edges of a scene alone may prefer wrong axes.
    """
    if sure:
        shift = Correction(offset=joint.best - recordings[0].camera.time_offset)
        moved = [recording.corrected(shift) for recording in recordings]
        turns = [QuickSharpness(light, each).half_turn(each) for light, each in zip(lights, moved, strict=True)]
        if np.median(turns) > LEAST_TURN:
            return True
    if len(coarse.tried) > MOST_RIVAL:
        return False
    nats, own = coarse.lowest()
    measures = [QuickSharpness(light, each) for light, each in zip(lights, own, strict=True)]

    def wins(turn: FloatArray) -> bool:
        camera = recordings[0].camera
        camera = replace(camera, imu_to_camera=turn @ camera.imu_to_camera)
        score, rivals = coarse.under(camera).lowest()
        falls = [measure.of(a) - measure.of(b) for measure, a, b in zip(measures, own, rivals, strict=True)]
        lead, fall = nats - score, float(np.median(falls))
        if not sure:
            return lead > LEAST_LEAD and fall > LEAST_TURN
        return lead + TOTAL_NATS_PER_FALL * fall > LEAST_LEAD

    return any(map(wins, RIVALS))


class _Curve:
    """Scores of the tiles of all pictures for the candidates tried so far.

    Candidate k is the offset `first + k FINE_STEP`. `parts` are ranges of tiles: of all pictures, and of each if there
    are several.
    """

    def __init__(
        self, lights: Sequence[NDArray[np.float32]], recordings: Sequence[Recording], first: float, *, side: int
    ) -> None:
        self._lights, self._side = lights, side
        pairs = zip(lights, recordings, strict=True)
        self.spectra = [TileSpectra(light, recording, side=side) for light, recording in pairs]
        self._recordings, self._first = recordings, first
        ends = np.cumsum([0, *(spectra.tiles for spectra in self.spectra)]).tolist()
        self.parts = [slice(0, ends[-1])]
        if len(lights) > 1:
            self.parts += [slice(*pair) for pair in pairwise(ends)]
        self._scores: dict[int, FloatArray] = {}
        self.tried: list[int] = []

    def extend(self, places: NDArray[np.intp], progress: Callable[[float], object]) -> None:
        """Score candidates; those that the log does not cover are left out.

        Raises
        ------
        CoverageError
            If the log covers none of all candidates so far.
        """
        uncovered: CoverageError | None = None
        for i, place in enumerate(places.tolist()):
            progress(i / len(places))
            self.tried.append(place)
            shift = Correction(offset=self._first + place * FINE_STEP)
            moved = (recording.corrected(shift) for recording in self._recordings)
            try:
                scores = [spectra.score(each) for spectra, each in zip(self.spectra, moved, strict=True)]
                self._scores[place] = np.concatenate(scores)
            except CoverageError as error:
                uncovered = error
        if uncovered and not self._scores:
            raise uncovered

    def under(self, camera: Camera) -> _Curve:
        """Return the scores of the same candidates under another camera."""
        recordings = [replace(recording, camera=camera) for recording in self._recordings]
        curve = _Curve(self._lights, recordings, self._first, side=self._side)
        curve.extend(np.array(self.tried), lambda _: None)
        return curve

    def _table(self, part: slice) -> tuple[NDArray[np.intp], FloatArray]:
        places = np.array(sorted(self._scores))
        return places, np.array([self._scores[place][part] for place in places.tolist()])

    def minima(self, part: slice) -> NDArray[np.intp]:
        """Return the places of the local minima of a part, the deepest first."""
        places, tiles = self._table(part)
        total = np.pad(tiles.sum(axis=1), 1, constant_values=np.inf)
        (minima,) = np.nonzero((total[1:-1] <= total[:-2]) & (total[1:-1] <= total[2:]))
        return places[minima[np.argsort(total[1:-1][minima])]]

    def lowest(self) -> tuple[float, list[Recording]]:
        """Return the score of the best candidate, nats, and the recordings with its offset."""
        totals = {place: float(tiles.sum()) for place, tiles in self._scores.items()}
        place = min(totals, key=totals.__getitem__)
        shift = Correction(offset=self._first + place * FINE_STEP)
        return totals[place], [recording.corrected(shift) for recording in self._recordings]

    def at_edge(self, part: slice) -> bool:
        """Return whether a neighbour of the best candidate of a part has no score."""
        best = int(self.minima(part)[0])
        return best - 1 not in self._scores or best + 1 not in self._scores

    def result(self, part: slice) -> OffsetSearch:
        """Return the best candidate of a part, with its confidence from resampling the tiles."""
        places, tiles = self._table(part)
        total = tiles.sum(axis=1)
        at = int(total.argmin())
        edge = self.at_edge(part)
        origin = self._recordings[0].camera.time_offset + self._first
        best = origin + float(places[at] + (0.0 if edge else _vertex(total[at - 1 : at + 2]))) * FINE_STEP
        far = np.abs(places - places[at]) * FINE_STEP > SAME
        # Bootstrap: as many draws as there are tiles, with repetition, stand for another picture of the same motion.
        count = tiles.shape[1]
        draws = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), RESAMPLES)
        resampled = draws @ tiles.T
        lead = np.min(resampled[:, far], axis=1, initial=np.inf) - resampled[:, ~far].min(axis=1)
        confidence = float(np.mean(lead > LEAST_LEAD))
        reason = ""
        if edge:
            reason = "the likeliest offset lies at the end of the search, or of the log; widen it"
        elif confidence < CONFIDENT:
            reason = "parts of the picture disagree: the motion is too uniform, or the scene without detail"
        time_offset = None if reason else best
        return OffsetSearch(
            time_offset, best, confidence, reason, origin + places * np.float64(FINE_STEP), total - total[at]
        )


def _vertex(scores: FloatArray) -> float:
    """Return the offset, in steps, from the middle of three scores to the vertex of the parabola through them."""
    before, here, after = scores
    bend = before - 2 * here + after
    return 0.5 * float((before - after) / bend) if bend > 0 else 0.0
