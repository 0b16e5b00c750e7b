"""Calibration of camera, clock and IMU from several blurred photos, which need not show the same things.

What the photos say is the posterior of :mod:`rsdeblur.estimate.posterior` and the sharp picture, as in
:func:`rsdeblur.refine`. That corrects a recording whose mounting is known. Here the mounting and the direction of the
readout are not, so all are compared first. What one photo leaves open, several decide: a mounting that explains the
blur of all of them by chance is rare.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.calibration.result import CONFIDENT, Calibration, Estimate, confidence, left_handed, mounting_name
from rsdeblur.choices import READOUT_DIRECTIONS, Auto, Transfer
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.estimate.correction import DRIFT, PARAMETERS, SHARED, Recording, Uncertainty
from rsdeblur.estimate.posterior import costs_of
from rsdeblur.estimate.refine import grey_lights
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.sharpness import NATS_PER_FALL
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.axes import rotations
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Least number of photos, and the longest search, s.
LEAST_PHOTOS, MOST_SEARCH = 3, 1.0
# How uncertain a camera's start values are.
START = Uncertainty(scale=0.3, offset=0.015, readout=0.5, roll=0.01, acceleration=0.0)
# Number of the best mountings that are fitted.
FITTED = 4
# Readout times and changes of the middle row's time from which the fit of each direction may begin, s.
READOUTS, BESIDE = (8e-3, 20e-3), (-10e-3, -5e-3, 0.0, 5e-3, 10e-3)
# Least lead of a mounting over any other one, nats over all photos.
LEAST_LEAD = 10.0
# Numbers of the result: name, unit, error that all photos share because phones denoise and sharpen, and the largest
# deviation with which it counts as determined; both in s, or shares of the number.
NUMBERS = {
    "offset": ("time_offset", "s", 2e-3, 4e-3),
    "scale": ("focal_length", "px", 0.015, 0.05),
    "readout": ("readout_time", "s", 0.25, 0.35),
}
# Such an error of the length of the blur, px.
SOFTNESS_ERROR = 0.6


def calibrate_photos(
    images: Iterable[ArrayLike],
    exposures: Sequence[Exposure],
    log: GyroLog | Sequence[GyroLog],
    camera: Camera,
    *,
    search: tuple[float, float] = (-0.03, 0.03),
    transfer: Transfer | Auto = "auto",
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate a camera from several blurred photos and the gyro log.

    Mounting, clock offset, focal length, readout time and direction follow from the blur, so the photos may show
    different things, at any distance in time. Five photos with different motion usually suffice. A clip is more
    precise: :func:`calibrate`.

    Parameters
    ----------
    images : iterable of array_like, shape (H, W) or (H, W, C)
        The blurred photos, as for :func:`rsdeblur.deblur`. They are taken one by one.
    exposures : sequence of Exposure
        Time of each photo.
    log : GyroLog or sequence of GyroLog
        Motion of the camera: one log, or one for each photo.
    camera : Camera
        Start values. Size, lens distortion, principal point and `timestamp_marks` are kept as they are. The focal
        length may be wrong by a factor of 1.35; mounting and readout need not be known.
    search : (float, float)
        First and last offset relative to `camera.time_offset`, s.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    Calibration
        Camera for :func:`rsdeblur.deblur`, each number with its standard deviation.

    Raises
    ------
    InputError
        If an argument is out of range, a photo does not have the camera's size, there is not one exposure for each
        photo, or there are fewer than three.
    CoverageError, ClockError, GapError
        If a log does not describe an exposure with the start's offset.

    Notes
    -----
    Half a turn about the optical axis changes neither the spectra nor, without roll, anything but the phase of the
    blur; so the spectra propose mountings, and the concentration of the gradient of the sharp pictures decides as well.
    See :func:`rsdeblur.refine` for both measures.

    Examples
    --------
    >>> import rsdeblur
    >>> start = rsdeblur.Camera(4000, 3000, 3100.0)  # doctest: +SKIP
    >>> found = rsdeblur.calibrate_photos(photos, exposures, log, start)  # doctest: +SKIP
    >>> found.mounting, found.values["focal_length"]  # doctest: +SKIP
    ('YxZ', Estimate(value=3050.1, sd=21.5, unit='px'))
    """
    validate.callback("progress", progress)
    first, last = validate.real_array("search", search, (2,)).tolist()
    if not 0 <= last - first <= MOST_SEARCH:
        raise InputError(f"search must span 0 to {MOST_SEARCH:g} s, got {first:g} to {last:g}")
    exposures = exposure_list(exposures)
    logs = list(log) if isinstance(log, Sequence) else [log] * len(exposures)
    if len(logs) != len(exposures):
        raise InputError(f"give one log, or one for each photo, got {len(logs)} logs and {len(exposures)} exposures")
    if len(exposures) < LEAST_PHOTOS:
        raise InputError(f"give at least {LEAST_PHOTOS} photos, got {len(exposures)}")
    recordings = []
    for each, exposure in zip(logs, exposures, strict=True):
        check_recording(each, camera, exposure)
        recordings.append(Recording(each, camera, exposure))
    lights = grey_lights(images, transfer, camera, exposures)
    return _Photos(lights, recordings, progress or (lambda *_: None)).calibration((first, last))


class _Fit(NamedTuple):
    """A correction fitted to the photos, the recordings with it, and log l1 / l2 of each sharp picture's gradient."""

    score: Score
    place: FloatArray
    recordings: list[Recording]
    clear: FloatArray

    @property
    def camera(self) -> Camera:
        """The corrected camera."""
        return self.recordings[0].camera

    def leads(self, other: _Fit) -> FloatArray:
        """Return how much more likely each photo is than with another fit, read along the same axis, nats."""
        score, place = self.score, self.place
        spectra = score.photo_leads(place, other.score.nats(other.place) or [])
        # The prior of the fit is shared out among the photos.
        return spectra - score.prior(place) / len(place) + NATS_PER_FALL * (other.clear - self.clear)


class _Photos:
    """The photos, and the steps from no knowledge of mounting, clock and readout to a calibration."""

    def __init__(self, lights: list[NDArray[np.float32]], recordings: list[Recording], progress: Progress) -> None:
        self._lights, self._recordings, self._progress = lights, recordings, progress
        self._start = recordings[0].camera
        slowest = replace(self._start, readout_time=READOUTS[-1], readout_sd=0.0)
        self._deviations = START.deviations(slowest, recordings[0].exposure)
        self._scores: dict[bool, Score] = {}

    def _score(self, recordings: Sequence[Recording]) -> Score:
        """Return the scores of corrections of recordings of the photos."""
        camera = recordings[0].camera
        key = camera.horizontal_readout
        if key not in self._scores:
            # The start's offset, for which the logs describe the exposures.
            start = replace(self._start, readout_direction=camera.readout_direction)
            given = [replace(each, camera=start) for each in self._recordings]
            self._scores[key] = Score.of_photos(self._lights, given, self._deviations, None)
        return self._scores[key].under(recordings)

    def _mounted_by(self, camera: Camera) -> Score:
        return self._score([replace(recording, camera=camera) for recording in self._recordings])

    def _fit(self, camera: Camera, free: Sequence[str] = SHARED) -> _Fit:
        """Fit corrections of a camera."""
        score = self._mounted_by(camera)
        place = score.descend(score.nothing, free) if free else score.nothing
        return _Fit(score, place, score.recordings(place), score.sparsities(place))

    def _ranked(self, cameras: Sequence[Camera]) -> list[Camera]:
        """Return the cameras under which the logs describe the exposures, the likeliest by the spectra first."""
        scores = map(self._mounted_by, cameras)
        costs = costs_of([score.nats(score.nothing) for score in scores])
        if not np.isfinite(costs).any():
            raise CoverageError(
                "the logs cover the exposures under no offset of the search; widen it, or check the clocks"
            )
        return [cameras[n] for n in np.argsort(costs, kind="stable") if np.isfinite(costs[n])]

    def calibration(self, search: tuple[float, float]) -> Calibration:
        """Search, fit and judge."""
        mounted = self._mounted(search)
        # What all are compared with, in either frame: without a readout, all directions are one.
        still = self._fit(_read_in(mounted[0], 0.0)).camera
        references = [self._fit(replace(still, readout_direction=each), ()) for each in READOUT_DIRECTIONS]
        found, rows = [], []
        for n, camera in enumerate(mounted):
            self._progress("readout", n / len(mounted))
            fits = [self._directed(replace(camera, readout_direction=each)) for each in READOUT_DIRECTIONS]
            found.append(fits)
            rows.append([fit.leads(other) for fit, other in zip(fits, references, strict=True)])
        leads = np.array(rows)  # nats of each photo, shape (mountings, directions, photos)
        place, direction = np.unravel_index(leads.sum(axis=2).argmax(), leads.shape[:2])
        best = np.array([every[every.sum(axis=1).argmax()] for every in leads])
        # Of left-handed logs the paths are reversed, whose spectra are the same.
        fits = [fits[rows.sum(axis=1).argmax()] for fits, rows in zip(found, leads, strict=True)]
        every = np.concatenate([best, best - [self._reversed(fit) for fit in fits]])
        first, rival = np.argsort(-every.sum(axis=1))[:2].tolist()
        sure = confidence(every[first] - np.delete(every, first, axis=0), LEAST_LEAD)
        names = [mounting_name(sign * camera.imu_to_camera) for sign in (1, -1) for camera in mounted]
        count, name = len(self._recordings), names[first]
        result = Calibration(False, "", self._start, confidence=sure, photos=count, mounting=name)
        if sure < CONFIDENT:
            one, other = (names[n] + " (left-handed)" * (n >= len(mounted)) for n in (first, rival))
            reason = f"the photos do not decide between the axes {one} and {other}; give more photos, with other motion"
            return replace(result, reason=reason + ", or a clip")
        if first >= len(mounted):
            return replace(result, reason=left_handed(name))
        # A direction that is not determined is the start's where that may be right.
        others = leads[place, direction] - leads[place]
        known = READOUT_DIRECTIONS.index(self._start.readout_direction)
        directed = confidence(np.delete(others, direction, axis=0), 0.0) >= CONFIDENT
        if confidence(others[[known]], 0.0) < CONFIDENT:
            direction = known
        camera, values = self._determined(found[place][direction], directed=directed)
        return replace(result, accepted=True, camera=camera, directed=directed, values=values)

    def _mounted(self, search: tuple[float, float]) -> list[Camera]:
        """Return the start with the likeliest mountings, each with its likeliest offset, the likeliest first."""
        self._progress("search", 0.0)
        start = self._start
        offsets = start.time_offset + np.linspace(*search, int(np.ceil((search[1] - search[0]) / 8e-3)) + 1)
        pairs = product((*rotations(), start.imu_to_camera), offsets.tolist())
        best: dict[tuple[float, ...], Camera] = {}
        for camera in self._ranked([replace(start, imu_to_camera=axes, time_offset=time) for axes, time in pairs]):
            best.setdefault(tuple(camera.imu_to_camera.flat), camera)
        cameras = list(best.values())
        # Half a turn about the optical axis leaves the spectra of a blur without roll as they are.
        turned = np.diag([-1.0, -1.0, 1.0]) @ cameras[0].imu_to_camera
        return cameras[:FITTED] + [each for each in cameras[FITTED:] if np.allclose(each.imu_to_camera, turned)]

    def _directed(self, camera: Camera) -> _Fit:
        """Return the fit with a camera's mounting and direction of the readout."""
        begins = [_read_in(camera, time, beside) for time, beside in product(READOUTS, BESIDE)]
        return self._fit(self._ranked(begins)[0])

    def _reversed(self, fit: _Fit) -> FloatArray:
        """Return how much more likely each photo is with a fit than with every path reversed, as a mirrored log has."""
        logs = [GyroLog(each.log.t, -each.log.omega, each.log.epoch_ns) for each in fit.recordings]
        mirrored = [replace(each, log=log) for each, log in zip(fit.recordings, logs, strict=True)]
        score = self._score(mirrored)
        return NATS_PER_FALL * (score.sparsities(score.nothing) - fit.clear)

    def _determined(self, fit: _Fit, *, directed: bool) -> tuple[Camera, dict[str, Estimate]]:
        """Return the camera, with the start's value of all that the photos do not determine, and the numbers."""
        # Without its direction, nothing is known of the readout.
        worst = "" if directed else "readout"
        free: tuple[str, ...] = (*SHARED, *DRIFT)
        while True:
            free = tuple(name for name in free if name != worst)
            fit = self._fit(_without(fit.camera, worst, self._start), free)
            deviations = fit.score.spread(fit.place, free)[0] * self._deviations
            softness = SOFTNESS_ERROR / np.mean([each.capture().mean_length for each in fit.recordings])
            # s or shares, with the errors that all photos share.
            errors = {
                name: float(np.linalg.norm([deviations[PARAMETERS.index(name)], error, softness * (name == "scale")]))
                for name, (_, _, error, _) in NUMBERS.items()
            }
            excess = {name: errors[name] / NUMBERS[name][-1] for name in NUMBERS if name in free}
            worst = max(excess, key=lambda name: excess[name], default="")
            if excess.get(worst, 0.0) <= 1.0:
                break
        camera = fit.camera
        focal, readout = camera.focal_length[0], camera.readout_time
        if "readout" not in free:
            # The photos determine when the middle row was exposed; the timestamp marks another one.
            errors["offset"] = float(np.hypot(errors["offset"], _middle(camera) * START.readout * readout))
        sizes = {"offset": (camera.time_offset, 1.0), "scale": (focal, focal), "readout": (readout, readout)}
        return camera, {
            result: Estimate(sizes[name][0], sizes[name][1] * errors[name] if name in free else None, unit)
            for name, (result, unit, *_) in NUMBERS.items()
        }


def _read_in(camera: Camera, readout_time: float, later: float = 0.0) -> Camera:
    """Return a camera with another readout time; its middle row is exposed at the same time, or so much `later`, s."""
    offset = camera.time_offset + _middle(camera) * (readout_time - camera.readout_time) + later
    return replace(camera, time_offset=offset, time_offset_sd=0.0, readout_time=readout_time, readout_sd=0.0)


def _middle(camera: Camera) -> float:
    """Return the share of the readout time from the row that a timestamp marks to the middle one."""
    return 0.5 - TIMESTAMP_SHARES[camera.timestamp_marks]


def _without(camera: Camera, name: str, start: Camera) -> Camera:
    """Return a camera with the start's value of a number, if one is named; see `_read_in` for the readout time."""
    if name == "scale":
        return replace(camera, focal_length=start.focal_length)
    if name == "offset":
        return replace(camera, time_offset=start.time_offset, time_offset_sd=start.time_offset_sd)
    return replace(_read_in(camera, start.readout_time), readout_sd=start.readout_sd) if name else camera
