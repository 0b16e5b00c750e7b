"""Correction of camera, clock and log by one or several blurred photos.

The corrections are searched by the spectra of the reduced photos (:mod:`rsdeblur.estimate.posterior`), which know the
blur but not its phase, and by light streaks (:mod:`rsdeblur.estimate.streaks`), if there are any, which know both.
Several corrections may explain them equally. So those that the search finds are compared by the sharp picture that they
lead to: with the right motion, its gradient is concentrated in few places.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.estimate.correction import Correction, Recording, Uncertainty, uncertainty_of
from rsdeblur.estimate.regions import LEAST_GAIN, DriftByRegion
from rsdeblur.estimate.score import Corrected, Score, mean_lengths
from rsdeblur.estimate.search import AHEAD_OF_AXES, OTHER_AXES, Search, rival_lead
from rsdeblur.image.encoded import EncodedImage, ReadoutFrame, check_size, reduced
from rsdeblur.motion.arguments import check_reach, check_recording, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.tuning.noise import TILE
from rsdeblur.types import FloatArray, Progress

# Longer side to which larger pictures are reduced first, px: the smoothing that smaller sizes need would take long.
SIDE = 1600

# Nats by which a correction by region must be ahead of other axes where one drift is not: factors bring nats that those
# do not have.
AHEAD_BY_FACTORS = AHEAD_OF_AXES + LEAST_GAIN
# Exposures that are shorter, s, show no shake; the drifts of the search would have speeds that no hand has, and PSFs of
# the rows between them that fill the memory.
LEAST_DURATION = 1e-4
# Drift over the mean length of the paths from which axes that nothing confirms are in doubt: it may replace the motion.
MOST_DRIFT = 1 / 3
# Photos that are enough to correct a recording.
REFINED_FRAMES = 6
# How far the recording of several photos may be wrong, by default.
SEVERAL = Uncertainty(offset=8e-3)
# Reason of a refusal.
TOO_SHORT = "so short an exposure shows no shake"


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """Result of :func:`refine` for one photo: what to pass to :func:`rsdeblur.deblur`.

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
        How likely the correction brings the motion nearer to the truth, in [0, 1]; 0 where other axes fit as well, or a
        drift makes up a third of the motion of one photo and nothing confirms the axes.
    gain : float
        How much likelier the correction is than none, nats.
    fall : float
        Fall of the logarithm of l1 / l2 of the sharp picture's gradient; of several photos, the mean.
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


@overload
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
) -> Refinement: ...
@overload
def refine(
    image: Iterable[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposure: Sequence[Exposure],
    *,
    translation: Translation | None = None,
    uncertainty: Uncertainty | None = None,
    free: str | Collection[str] | None = None,
    transfer: Transfer | Auto = "auto",
    known_axes: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> list[Refinement]: ...
def refine(
    image: ArrayLike | Iterable[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposure: Exposure | Sequence[Exposure],
    *,
    translation: Translation | None = None,
    uncertainty: Uncertainty | None = None,
    free: str | Collection[str] | None = None,
    transfer: Transfer | Auto = "auto",
    known_axes: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Refinement | list[Refinement]:
    """Correct focal length, clock, readout and motion by one or several blurred photos.

    Several photos of one recording share its focal length, clock, readout time and roll bias; each has a drift and an
    acceleration of its own.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C), or iterable of these
        The blurred photo, as for :func:`rsdeblur.deblur`; or several, which are taken one by one. Six that are spread
        over a clip are plenty.
    log, camera
        The motion and the camera.
    exposure : Exposure or sequence of Exposure
        The time of the exposure, of each photo if there are several.
    translation : Translation, optional
        Translation of the camera, if it is known.
    uncertainty : Uncertainty, optional
        How far the recording may be wrong; default `Uncertainty()`, and for several photos, which distinguish an offset
        from a motion of the hand, `Uncertainty(offset=8e-3)`.
    free : str or collection of str, optional
        Which of "scale", "drift", "offset", "readout", "roll" and "acceleration" may be corrected; default all.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    known_axes : bool, default False
        Whether `imu_to_camera` is certain, as where an accelerometer confirms it
        (:meth:`rsdeblur.motion.AccelerationLog.gravity_angle`): then no other axes are tried. One photo alone is
        searched for an acceleration only then, in exposures that are long enough.
    threads : int, optional
        Threads that share the work, from 1 to 1024; default all processors. Any number gives the same bits.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    Refinement or list of Refinement
        The recording of each photo: as given where the photos do not contradict it, or not clearly.

    Raises
    ------
    InputError
        If an argument is out of range, or a picture cannot hold the blur.
    CoverageError, ClockError, GapError
        If the log does not describe the exposure.

    Notes
    -----
    One picture does not calibrate a camera: offset, readout time, focal length and drift explain one another in part.
    The blur is right long before they are. Use the result for this picture, and :func:`rsdeblur.calibrate_photos` for a
    camera file.

    Examples
    --------
    >>> import rsdeblur
    >>> log, camera = rsdeblur.read_gyro("gyro.csv"), rsdeblur.read_camera("camera.toml")  # doctest: +SKIP
    >>> exposure = rsdeblur.Exposure(0.25, 0.05)  # doctest: +SKIP
    >>> found = rsdeblur.refine(image, log, camera, exposure)  # doctest: +SKIP
    >>> rsdeblur.deblur(image, found.log, found.camera, found.exposure)  # doctest: +SKIP
    """
    recordings = recordings_of(log, camera, exposure, translation)
    validate.callback("progress", progress)
    validate.boolean("known_axes", known_axes)
    several = len(recordings) > 1
    uncertainty = uncertainty_of(uncertainty, free, SEVERAL if several else Uncertainty())
    if not (known_axes or several):
        uncertainty = _without_acceleration(uncertainty)
    lights = grey_lights(image, transfer, camera, exposure)
    longest = longest_of(recordings)
    deviations = uncertainty.deviations(camera, longest)
    for recording in recordings:
        check_reach(recording.capture())
    reason = f"the picture is smaller than {TILE} px" if min(camera.width, camera.height) < TILE else ""
    if not reason and longest.duration < LEAST_DURATION:
        reason = TOO_SHORT
    if reason:
        nothing = np.zeros((len(recordings), len(deviations)))
        found, spread = Corrected(nothing, recordings, gain=0.0, fall=0.0, score=0.0), nothing + 1.0
    else:
        score = Score.of_photos(lights, recordings, deviations, threads)
        found, reason = _found(score, known_axes=known_axes, progress=progress or (lambda *_: None))
        spread = score.spread(found.place)
    drifts = np.abs([complex(*Correction(*(place * deviations).tolist()).drift) for place in found.place])
    drifted = not (reason or known_axes or several) and bool((drifts > MOST_DRIFT * mean_lengths(recordings)).any())
    refinements = []
    for n, used in enumerate(recordings if reason else found.recordings):
        refinements.append(
            Refinement(
                *(used.log, used.camera, used.exposure, used.translation),
                accepted=not reason,
                reason=reason,
                values=Correction(*(found.place[n] * deviations).tolist()),
                sd=Correction(*(spread[n] * deviations).tolist()),
                confidence=0.0 if drifted or reason == OTHER_AXES else found.confidence,
                gain=found.gain,
                fall=found.fall,
                regions=None if found.factors is None else ReadoutFrame(camera).back(found.factors),
            )
        )
    return refinements[0] if isinstance(exposure, Exposure) else refinements


def _found(score: Score, *, known_axes: bool, progress: Progress) -> tuple[Corrected, str]:
    """Return the most likely correction, and why it is refused (empty if it is not)."""
    search = Search(score)
    best, reason = search.best(progress)
    found, ahead = score.corrected(best), AHEAD_OF_AXES
    # With wrong axes, a correction may make the motion more like the right one, but never right.
    if not (reason or known_axes) and rival_lead(score, found.recordings) > -ahead:
        reason, ahead = OTHER_AXES, AHEAD_BY_FACTORS
    if len(score.photos) == 1 and score.photos[0].recording.translation is None:
        regional = DriftByRegion(score).best([best, *search.candidates], over=None if reason else best)
        if regional and (known_axes or not reason or rival_lead(score, regional.recordings) <= -ahead):
            found, reason = regional, ""
    return found, reason


def _without_acceleration(uncertainty: Uncertainty) -> Uncertainty:
    """Return an uncertainty for axes that are not known: with two numbers more, wrong ones explain many pictures."""
    try:
        return replace(uncertainty, acceleration=0.0)
    except InputError:
        raise InputError("only an acceleration is free, which is refined with known_axes=True only") from None


def recordings_of(
    log: GyroLog, camera: Camera, exposure: Exposure | Sequence[Exposure], translation: Translation | None = None
) -> list[Recording]:
    """Return the recording of each photo; InputError if there is none, or one does not have the right types."""
    exposures = [exposure] if isinstance(exposure, Exposure) else exposure_list(exposure, "exposure")
    if not exposures:
        raise InputError("exposure must be an Exposure, or a sequence with one for each image, got none")
    for each in exposures:
        check_recording(log, camera, each, translation)
    return [Recording(log, camera, each, translation) for each in exposures]


def longest_of(recordings: Sequence[Recording]) -> Exposure:
    """Return the longest exposure."""
    return max((each.exposure for each in recordings), key=lambda each: each.duration)


def grey_lights(
    image: ArrayLike | Iterable[ArrayLike],
    transfer: Transfer | Auto,
    camera: Camera,
    exposure: Exposure | Sequence[Exposure],
) -> list[NDArray[np.float32]]:
    """Return the mean linear light of the channels of each photo, which must fit its exposure, reduced to `SIDE` px."""
    single = isinstance(exposure, Exposure)
    images = [image] if single else validate.items("image", cast("Iterable[ArrayLike]", image))
    lights = []
    for each in cast("Iterable[ArrayLike]", images):
        encoded = EncodedImage.of(each, transfer)
        check_size(encoded.shape, camera)
        lights.append(reduced(encoded.grey(slice(None)), camera, SIDE)[0])
    count = 1 if isinstance(exposure, Exposure) else len(exposure)
    if len(lights) != count:
        raise InputError(f"give one exposure for each image, got {len(lights)} images and {count} exposures")
    return lights
