"""Correction of camera, clock and log from the blurred picture itself.

The corrections are searched by the spectra of the reduced picture (:mod:`rsdeblur.estimate.posterior`), which know the
blur but not its phase, and by light streaks (:mod:`rsdeblur.estimate.streaks`), if there are any, which know both.
Several corrections may explain them equally. So those that the search finds are compared by the sharp picture that they
lead to: with the right motion, its gradient is concentrated in few places.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import share_map
from rsdeblur.choices import Auto, Transfer
from rsdeblur.estimate.correction import PARAMETERS, Correction, Recording, Uncertainty, uncertainty_of
from rsdeblur.estimate.periodograms import TILE
from rsdeblur.estimate.posterior import Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, SHORTER, QuickSharpness
from rsdeblur.estimate.regions import drift_by_region, with_factors
from rsdeblur.estimate.rival_axes import OTHER_AXES, rival_lead
from rsdeblur.estimate.sharpness import Sharpness
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.estimate.streaks import LightStreaks, lead_of
from rsdeblur.image.encoded import EncodedImage, check_size, reduced
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.motion.arguments import check_reach, check_recording, is_held
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray, Progress

# Reduction of the picture for its spectra. The finest detail is left out, because cameras denoise and sharpen it; the
# blur is at most so long, px; and the longer side is within these bounds, px.
LEAST_REDUCTION, LONGEST_BLUR = 2.4, 20.0
SPECTRA_SIDES = 320, 480
# Longer side to which larger pictures are reduced first, px: the smoothing that smaller sizes need would take long.
SIDE = 1600

# Groups of parameters that are searched together, and the number of grid values of each. Every search starts from no
# correction and from the best one so far. Grid values reach `WIDEST` standard deviations. The likelier share
# `COMPARED` of the grid, of at least `LEAST_START` nats, is compared by the sharp picture. The best `STARTS` of them
# start searches too. A correction by few numbers is more credible than one by many.
MODELS = (
    (("scale",), 0),
    (("readout",), 4),
    (("offset",), 8),
    (("drift_x", "drift_y"), 4),
    (("scale", "drift_x", "drift_y"), 0),
    (PARAMETERS, 0),
)
WIDEST, COMPARED, LEAST_START, STARTS = 3.0, 0.5, -20.0, 2
# Number of candidates that are adjusted, if they are worth so many nats, and confirmed. Each model has up to two: its
# best correction, and the best with its numbers alone, which another correction cannot have led astray.
CANDIDATES, LEAST_ADJUSTED = 5, 10.0
# Parameters that the quick measure of the sharp picture adjusts if they are corrected, and the steps along each, in
# standard deviations. At last the whole solve adjusts the others: it finds them more exactly, but on real photos, where
# the scene has several depths, it leads to drifts that are too long. A parabola leads at most so many steps away.
ADJUSTED, QUICK_STEPS, WHOLE_STEPS, MOST_STEPS = ("scale", "drift_x", "drift_y"), (0.6, 0.3), (0.3,), 2.0
# Light streaks search along these parameters, with steps in standard deviations, from the best place of a grid of so
# many values of each drift, or from no correction. The search goes on after the first step only if they are so many
# nats likelier. The spectra join the last two steps.
FOLLOWED, STREAK_STEPS, LEAST_FOLLOWED = ("scale", "drift_x", "drift_y"), (0.8, 0.4, 0.2), 10.0
STREAK_GRID, STREAK_COUNT = ("drift_x", "drift_y"), 4
# Nats that a parameter costs, and the least gain that counts.
NATS_PER_PARAMETER, WORST_GAIN = 3.0, -1000.0
# Least worth (nats) of a correction that is accepted, its least fall in the whole solve, and the most standard
# deviations of any parameter. The quick measure must not rise; a fall proves less there, as the largest of many.
LEAST_WORTH, LEAST_FALL, MOST_DEVIATIONS = 30.0, 0.01, 6.0
# Gain (nats) without which the fall does not count where the paths become shorter.
LEAST_OF_SHORTER = 10.0
# Least worth and fall for the readout time alone: little else looks like that.
LEAST_OF_READOUT = 15.0, 0.005
# Nats by which a correction must be likelier than the best one with other axes.
AHEAD_OF_AXES = 3.0
# Worth (nats) of corrections of which half bring the motion nearer to the truth, and by how much more the odds grow
# e-fold: a fit to simulated recordings (docs/developer/decisions/refinement.md).
EVEN_WORTH, WORTH_SCALE = 8.0, 12.0
# Exposures that are shorter, s, show no shake; the drifts of the search would have speeds that no hand has, and PSFs of
# the rows between them that fill the memory.
LEAST_DURATION = 1e-4
# Reasons of a refusal.
TOO_SHORT = "so short an exposure shows no shake"
NOT_CLEAR = "the picture does not contradict the recording, or not clearly"
TOO_FAR = "the likeliest correction is too far from the recording"
NOT_SHARPER = "the sharp picture does not become clearer"


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """Result of :func:`refine`: what to pass to :func:`rsdeblur.deblur`.

    Parameters
    ----------
    log, camera, exposure, translation
        The recording, corrected where the correction is accepted, as given otherwise.
    accepted : bool
        Whether the correction is accepted.
    reason : str
        Why it is not; empty otherwise.
    values : Correction
        The most likely correction, accepted or not.
    sd : Correction
        Standard deviations of its numbers; those of the :class:`Uncertainty` where the picture does not determine them.
    confidence : float
        How likely the correction brings the motion nearer to the truth, in [0, 1]; 0 where other axes fit as well.
    gain : float
        How much likelier the correction is than none, nats.
    fall : float
        Fall of the logarithm of l1 / l2 of the sharp picture's gradient.
    regions : ndarray, shape (R, C), or None
        Factors on the drift in equal regions of the picture as stored, where things at several depths are visible;
        `translation` then has a map of depths.
    """

    log: GyroLog
    camera: Camera
    exposure: Exposure
    translation: Translation | None
    accepted: bool
    reason: str
    values: Correction
    sd: Correction
    confidence: float
    gain: float
    fall: float
    regions: FloatArray | None = None


def refine(
    image: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    translation: Translation | None = None,
    uncertainty: Uncertainty | None = None,
    free: str | Collection[str] | None = None,
    transfer: Transfer | Auto = "auto",
    known_axes: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Refinement:
    """Correct focal length, clock, readout and motion by the blurred picture.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C)
        The blurred picture, as for :func:`rsdeblur.deblur`.
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    translation : Translation, optional
        Translation of the camera, if it is known.
    uncertainty : Uncertainty, optional
        How far the recording may be wrong; default `Uncertainty()`.
    free : str or collection of str, optional
        Which of "scale", "drift", "offset", "readout" and "roll" may be corrected; default all.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    known_axes : bool, default False
        Whether `imu_to_camera` is certain, as where an accelerometer confirms it
        (:meth:`rsdeblur.AccelerationLog.gravity_angle`): then no other axes are tried.
    threads : int, optional
        Threads that share the work, from 1 to 1024; default all processors. Any number gives the same bits.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    Refinement
        The recording as given where the picture does not contradict it, or not clearly.

    Raises
    ------
    InputError
        If an argument is out of range, or the picture cannot hold the blur.
    CoverageError, ClockError, GapError
        If the log does not describe the exposure.

    Notes
    -----
    One picture does not calibrate a camera: offset, readout time, focal length and drift explain one another in part.
    The blur is right long before they are. Use the result for this picture, and :func:`rsdeblur.find_time_offset` or
    several pictures for a camera file.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.read_gyro("gyro.csv"), rsdeblur.read_camera("camera.toml")  # doctest: +SKIP
    >>> exposure = rsdeblur.Exposure(0.25, 0.05)  # doctest: +SKIP
    >>> found = rsdeblur.refine(image, log, camera, exposure)  # doctest: +SKIP
    >>> rsdeblur.deblur(image, found.log, found.camera, found.exposure)  # doctest: +SKIP
    """
    check_recording(log, camera, exposure, translation)
    validate.callback("progress", progress)
    validate.boolean("known_axes", known_axes)
    uncertainty = uncertainty_of(uncertainty, free, Uncertainty())
    light = grey_light(image, transfer, camera)
    recording = Recording(log, camera, exposure, translation)
    deviations = uncertainty.deviations(camera)
    check_reach(recording.capture())
    if min(camera.width, camera.height) < TILE:
        return _unrefined(recording, deviations, f"the picture is smaller than {TILE} px")
    if exposure.duration < LEAST_DURATION:
        return _unrefined(recording, deviations, TOO_SHORT)
    spectra = TileSpectra(light, recording, side=spectra_side(recording), soft=True, white=False, threads=1)
    quick = QuickSharpness(light, recording)
    posterior = Posterior(spectra, recording, deviations)
    streaks = LightStreaks(light, recording)
    judge = _Judge(posterior, quick, streaks, lambda: Sharpness(light, recording, robust=True), threads)
    best, reason = judge.best(progress or (lambda *_: None))
    found = posterior.corrected(best)
    # With wrong axes, a correction may make the motion more like the right one, but never right.
    doubtful = not (reason or known_axes)
    if doubtful:
        lead = rival_lead(spectra, quick, found, recording, deviations, streaks=streaks, threads=threads)
        reason = OTHER_AXES if lead > -AHEAD_OF_AXES else ""
    values, regions = Correction(*(best * deviations).tolist()), None
    if not reason and translation is None:
        regions = drift_by_region(posterior, quick, judge.whole, recording, values, threads=threads)
        if regions is not None:
            found = with_factors(recording, values, regions, quick.centres)
            regions = ReadoutFrame(camera).back(regions)
    used = recording if reason else found
    return Refinement(
        used.log,
        used.camera,
        used.exposure,
        used.translation,
        accepted=not reason,
        reason=reason,
        values=values,
        sd=Correction(*(posterior.spread(best) * deviations).tolist()),
        confidence=0.0 if reason == OTHER_AXES else judge.confidence(best),
        gain=judge.gain(best),
        fall=judge.fall(best),
        regions=regions,
    )


def _unrefined(recording: Recording, deviations: FloatArray, reason: str) -> Refinement:
    """Return the recording as given."""
    given = recording.log, recording.camera, recording.exposure, recording.translation
    sd = Correction(*deviations.tolist())
    nothing = Correction()
    return Refinement(*given, accepted=False, reason=reason, values=nothing, sd=sd, confidence=0.0, gain=0.0, fall=0.0)


def grey_light(image: ArrayLike, transfer: Transfer | Auto, camera: Camera) -> NDArray[np.float32]:
    """Return the mean linear light of a picture's channels, reduced to `SIDE` px.

    Raises
    ------
    InputError
        If it is not a picture, or not of the camera's size.
    """
    encoded = EncodedImage.of(image, transfer)
    check_size(encoded.shape, camera)
    return reduced(encoded.grey(slice(None)), camera, SIDE)[0]


def spectra_side(recording: Recording) -> int:
    """Return the longer side to which a picture is reduced for its spectra, px."""
    camera = recording.camera
    longer, shorter = max(camera.width, camera.height), min(camera.width, camera.height)
    length = recording.capture().mean_length
    low, high = (max(side, TILE * longer / shorter + 1) for side in SPECTRA_SIDES)
    return int(np.clip(longer / max(LEAST_REDUCTION, length / LONGEST_BLUR), low, high))


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


class _Judge:
    """Worth of corrections: by the spectra, and by the sharp picture that they lead to.

    `whole` plans whole solves, which most pictures do not need.
    """

    def __init__(
        self,
        posterior: Posterior,
        quick: QuickSharpness,
        streaks: LightStreaks,
        whole: Callable[[], Sharpness],
        threads: int | None,
    ) -> None:
        self._posterior, self._quick, self._plan_whole, self._threads = posterior, quick, whole, threads
        self._nothing, self._streaks = np.zeros(len(PARAMETERS)), streaks
        self._streak_nats: dict[bytes, float] = {}
        self._sparsities: dict[bytes, float] = {}
        self._whole_sparsities: dict[bytes, float] = {}

    @cached_property
    def whole(self) -> Sharpness:
        """The measure of whole solves."""
        return self._plan_whole()

    def gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra and the light streaks are than without a correction, nats."""
        return self._posterior_gain(place) + self._led(place)

    def _posterior_gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra are than without a correction, nats."""
        return self._posterior.gain(place, self._nothing)

    def _led(self, place: FloatArray) -> float:
        """Return how much likelier the light streaks are than without a correction, nats."""
        return lead_of(self._nats_of_streaks(place), self._nats_of_streaks(self._nothing))

    def _nats_of_streaks(self, place: FloatArray) -> float:
        key = place.tobytes()
        if key not in self._streak_nats:
            self._streak_nats[key] = self._streaks.nats(self._posterior.corrected(place))
        return self._streak_nats[key]

    def fall(self, place: FloatArray) -> float:
        """Return how much the logarithm of l1 / l2 falls."""
        return self._sparsity(self._nothing) - self._sparsity(place)

    def confidence(self, place: FloatArray) -> float:
        """Return how likely a correction brings the motion nearer to the truth."""
        return 1.0 / (1.0 + float(np.exp((EVEN_WORTH - self._worth(place)) / WORTH_SCALE))) if place.any() else 0.0

    def _sparsity(self, place: FloatArray) -> float:
        key = place.tobytes()
        if key not in self._sparsities:
            self._sparsities[key] = self._quick.of(self._posterior.corrected(place))
        return self._sparsities[key]

    def best(self, progress: Progress) -> tuple[FloatArray, str]:
        """Return the best credible correction, adjusted by the sharp picture; or the best of all, and what is wrong."""
        candidates = self._candidates(progress)
        likely = [place for place in candidates[:CANDIDATES] if self._worth(place) >= LEAST_ADJUSTED]
        near = [place for place in likely if np.abs(place).max() <= MOST_DEVIATIONS]
        if not near:
            return candidates[0], TOO_FAR if likely else NOT_CLEAR
        # The search found the largest of many falls. The whole solve is free of what favoured them by chance.
        falls = [min(self.fall(place), whole) for place, whole in zip(near, self._whole_falls(near), strict=True)]
        worths = [
            self.gain(place) + NATS_PER_FALL * fall - _cost(place) for place, fall in zip(near, falls, strict=True)
        ]
        refused = []
        for n in np.argsort(worths)[::-1]:
            axes = [at for at in np.flatnonzero(near[n]).tolist() if PARAMETERS[at] in ADJUSTED]
            place = adjusted(near[n], self._worths, axes, progress, steps=QUICK_STEPS)
            reason = self._doubt(place)
            if not reason:
                return self._polished(place, progress), reason
            refused.append((place, reason))
        return refused[0]

    def _polished(self, place: FloatArray, progress: Progress) -> FloatArray:
        """Return a credible correction, adjusted by the whole solve; unchanged if it would no longer be credible."""
        axes = [at for at in np.flatnonzero(place).tolist() if PARAMETERS[at] not in ADJUSTED]
        polished = adjusted(place, self._whole_worths, axes, progress, steps=WHOLE_STEPS)
        return place if self._doubt(polished) else polished

    def _doubt(self, place: FloatArray) -> str:
        """Return why an adjusted correction is not credible; nothing if it is."""
        changed = [name for name, value in zip(PARAMETERS, place, strict=True) if value]
        worth, fall = LEAST_OF_READOUT if changed == ["readout"] else (LEAST_WORTH, LEAST_FALL)
        if self._worth(place) < worth:
            return NOT_CLEAR
        if np.abs(place).max() > MOST_DEVIATIONS or not is_held(self._posterior.corrected(place).capture()):
            return TOO_FAR
        (whole,) = self._whole_falls([place])
        return NOT_SHARPER if whole < fall or self.fall(place) < 0 else ""

    def _candidates(self, progress: Progress) -> list[FloatArray]:
        """Return the best correction of each model, and the best with its numbers alone; the best of all first."""
        best, worth = self._nothing, 0.0
        found = {best.tobytes(): (worth, best)}
        for n, (names, count) in enumerate(MODELS):
            progress("search", n / len(MODELS))
            model, last = [name for name in names if name in self._posterior.free], names is PARAMETERS
            # Descents of the last model take long, so it begins at the best place only, if that is worth it.
            if not model or (last and worth < LEAST_ADJUSTED):
                continue
            begin = [best] if last or not best.any() else [self._nothing, best]
            starts = [*begin, *self._starts(model, count)]
            places = share_map(partial(self._posterior.descend, free=model), starts, self._threads)
            worths = np.array(self._worths(places)) - [_cost(place) for place in places]
            most = int(worths.argmax())
            others = [name not in model for name in PARAMETERS]
            alone = [at for at, place in enumerate(places) if not place[others].any()]
            for at in {most, max(alone, key=worths.__getitem__, default=most)}:
                found[places[at].tobytes()] = float(worths[at]), places[at]
            if worths[most] > worth:
                worth, best = float(worths[most]), places[most]
        for place in self._followed(progress):
            found[place.tobytes()] = self._worth(place) - _cost(place), place
        return [place for _, place in sorted(found.values(), key=lambda pair: -pair[0])]

    def _followed(self, progress: Progress) -> list[FloatArray]:
        """Return the correction that light streaks prefer, and what the spectra and they prefer from there."""
        axes = [PARAMETERS.index(name) for name in FOLLOWED if name in self._posterior.free]
        if not self._streaks.streaks or not axes:
            return []

        def likely(places: Sequence[FloatArray]) -> list[float]:
            return share_map(
                lambda place: self._nats_of_streaks(place) - 0.5 * float(place @ place), places, self._threads
            )

        def gains(places: Sequence[FloatArray]) -> list[float]:
            return share_map(self.gain, places, self._threads)

        begin = [self._nothing, *_grid([name for name in STREAK_GRID if name in self._posterior.free], STREAK_COUNT)]
        first = adjusted(begin[int(np.argmax(likely(begin)))], likely, axes, progress, steps=STREAK_STEPS[:1])
        if self._led(first) < LEAST_FOLLOWED:
            return []
        place = adjusted(first, likely, axes, progress, steps=STREAK_STEPS[:2])
        return [place, adjusted(place, gains, axes, progress, steps=STREAK_STEPS[1:])]

    def _starts(self, model: list[str], count: int) -> list[FloatArray]:
        """Return the best of places that are spread over the parameters of a model, `count` values of each."""
        places = _grid(model, count)
        gains = np.array(share_map(self._posterior_gain, list(places), self._threads))
        likely = [n for n in np.argsort(-gains)[: round(COMPARED * len(places))] if gains[n] > LEAST_START]
        falls = share_map(lambda n: self.fall(places[n]), likely, self._threads)
        worths = gains[likely] + NATS_PER_FALL * np.array(falls)
        return [places[likely[n]] for n in np.argsort(-worths)[:STARTS]]

    def _worths(self, places: Sequence[FloatArray]) -> list[float]:
        return share_map(self._worth, places, self._threads)

    def _worth(self, place: FloatArray) -> float:
        return self._sum(place, self.fall(place) if self.gain(place) >= 0 else 0.0)

    def _sum(self, place: FloatArray, fall: float) -> float:
        """Return the worth of a correction by its spectra and a fall of its sharp picture."""
        gain = max(self.gain(place), WORST_GAIN)
        # The sharp picture counts only where the spectra agree. Far from the truth it may be clear because little blur
        # was removed.
        if gain < 0 or (gain < LEAST_OF_SHORTER and self._length(place) < SHORTER * self._length(self._nothing)):
            return gain
        return gain + NATS_PER_FALL * fall

    def _length(self, place: FloatArray) -> float:
        """Return the mean length of the paths, px."""
        return self._posterior.corrected(place).capture().mean_length

    def _whole_worths(self, places: Sequence[FloatArray]) -> list[float]:
        return [self._sum(place, fall) for place, fall in zip(places, self._whole_falls(places), strict=True)]

    def _whole_falls(self, places: Sequence[FloatArray]) -> list[float]:
        """Return how much the logarithm of l1 / l2 falls in the whole solve."""
        known, whole = self._whole_sparsities, self.whole
        new = {each.tobytes(): each for each in (self._nothing, *places) if each.tobytes() not in known}
        values = share_map(lambda each: whole.of(self._posterior.corrected(each)), list(new.values()), self._threads)
        known.update(zip(new, values, strict=True))
        return [known[self._nothing.tobytes()] - known[place.tobytes()] for place in places]


def _grid(names: Sequence[str], count: int) -> FloatArray:
    """Return places that are spread over some parameters, `count` values of each."""
    at = [PARAMETERS.index(name) for name in names]
    places = np.zeros((count ** len(at), len(PARAMETERS)))
    if at:
        values = np.meshgrid(*[np.linspace(-WIDEST, WIDEST, count)] * len(at))
        places[:, at] = np.stack(values, axis=-1).reshape(len(places), len(at))
    return places


def _cost(place: FloatArray) -> float:
    """Return the nats that the numbers of a correction cost."""
    return NATS_PER_PARAMETER * float(np.count_nonzero(place))
