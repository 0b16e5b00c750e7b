"""Correction of camera, clock and log from the blurred picture itself.

The corrections are searched by the spectra of the reduced picture (:mod:`rsdeblur.estimate.posterior`), which know the
blur but not its phase, and by light streaks (:mod:`rsdeblur.estimate.streaks`), if there are any, which know both.
Several corrections may explain them equally. So those that the search finds are compared by the sharp picture that they
lead to: with the right motion, its gradient is concentrated in few places.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import beside
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.estimate.correction import Correction, Recording, Uncertainty, uncertainty_of
from rsdeblur.estimate.periodograms import TILE
from rsdeblur.estimate.posterior import Posterior
from rsdeblur.estimate.quick_sharpness import QuickSharpness
from rsdeblur.estimate.regions import LEAST_GAIN, DriftByRegion
from rsdeblur.estimate.rival_axes import OTHER_AXES, rival_lead
from rsdeblur.estimate.search import Search
from rsdeblur.estimate.sharpness import Sharpness
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.estimate.streaks import LightStreaks
from rsdeblur.estimate.worth import Corrected, Worth
from rsdeblur.image.encoded import EncodedImage, check_size, reduced
from rsdeblur.image.frame import ReadoutFrame
from rsdeblur.motion.arguments import check_reach, check_recording
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

# Nats by which a correction must be likelier than the best one with other axes.
AHEAD_OF_AXES = 3.0
# The same for a correction by region where one drift is not ahead: factors bring nats that other axes do not have.
AHEAD_BY_FACTORS = AHEAD_OF_AXES + LEAST_GAIN
# Exposures that are shorter, s, show no shake; the drifts of the search would have speeds that no hand has, and PSFs of
# the rows between them that fill the memory.
LEAST_DURATION = 1e-4
# Reason of a refusal.
TOO_SHORT = "so short an exposure shows no shake"


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
        Which of "scale", "drift", "offset", "readout", "roll" and "acceleration" may be corrected; default all.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    known_axes : bool, default False
        Whether `imu_to_camera` is certain, as where an accelerometer confirms it
        (:meth:`rsdeblur.AccelerationLog.gravity_angle`): then no other axes are tried. Only then is an acceleration
        searched, in exposures that are long enough.
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
    if not known_axes:
        uncertainty = _without_acceleration(uncertainty)
    light = grey_light(image, transfer, camera)
    recording = Recording(log, camera, exposure, translation)
    deviations = uncertainty.deviations(camera, exposure)
    check_reach(recording.capture())
    if min(camera.width, camera.height) < TILE:
        return _unrefined(recording, deviations, f"the picture is smaller than {TILE} px")
    if exposure.duration < LEAST_DURATION:
        return _unrefined(recording, deviations, TOO_SHORT)
    found, reason, spread = _correction(
        light, recording, deviations, known_axes=known_axes, threads=threads, progress=progress or (lambda *_: None)
    )
    used = recording if reason else found.recording
    return Refinement(
        used.log,
        used.camera,
        used.exposure,
        used.translation,
        accepted=not reason,
        reason=reason,
        values=Correction(*(found.place * deviations).tolist()),
        sd=Correction(*(spread * deviations).tolist()),
        confidence=0.0 if reason == OTHER_AXES else found.confidence,
        gain=found.gain,
        fall=found.fall,
        regions=None if found.factors is None else ReadoutFrame(camera).back(found.factors),
    )


def _correction(
    light: NDArray[np.float32],
    recording: Recording,
    deviations: FloatArray,
    *,
    known_axes: bool,
    threads: int | None,
    progress: Progress,
) -> tuple[Corrected, str, FloatArray]:
    """Return the most likely correction, why it is refused (nothing if it is not), and how uncertain it is.

    The uncertainty is that of the place, in standard deviations of the recording's errors.
    """
    with beside(partial(LightStreaks, light, recording), threads) as found_streaks:
        spectra = TileSpectra(light, recording, side=spectra_side(recording), soft=True, white=False, threads=1)
        quick = QuickSharpness(light, recording)
        streaks = found_streaks()
    posterior = Posterior(spectra, recording, deviations)
    worth = Worth(posterior, quick, streaks, lambda: Sharpness(light, recording, robust=True), threads)
    search = Search(worth, threads)
    best, reason = search.best(progress)
    found = worth.one_drift(best)

    def rivalled(corrected: Recording, ahead: float) -> bool:
        # With wrong axes, a correction may make the motion more like the right one, but never right.
        lead = rival_lead(spectra, quick, corrected, recording, deviations, streaks=streaks, threads=threads)
        return lead > -ahead

    ahead = AHEAD_OF_AXES
    if not (reason or known_axes) and rivalled(found.recording, ahead):
        reason, ahead = OTHER_AXES, AHEAD_BY_FACTORS
    if recording.translation is None:
        by_region = DriftByRegion(worth, quick, recording, deviations, threads)
        regional = by_region.best([best, *search.candidates], over=None if reason else best)
        if regional is not None and (known_axes or not (reason and rivalled(regional.recording, ahead))):
            found, reason = regional, ""
    return found, reason, posterior.spread(found.place)


def _without_acceleration(uncertainty: Uncertainty) -> Uncertainty:
    """Return an uncertainty for axes that are not known: with two numbers more, wrong ones explain many pictures."""
    try:
        return replace(uncertainty, acceleration=0.0)
    except InputError:
        raise InputError("only an acceleration is free, which is refined with known_axes=True only") from None


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
