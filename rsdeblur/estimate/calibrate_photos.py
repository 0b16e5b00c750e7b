"""Calibration of camera, clock and IMU from several blurred photos, which need not show the same things.

The blur of each photo is compared with what the log predicts, by the spectra of its tiles and by the sharp picture, as
in :mod:`rsdeblur.estimate.refine`. What one photo leaves open, several decide: a mounting that explains the blur of all
of them by chance is rare.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import READOUT_DIRECTIONS, Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.estimate.calibrate import Estimate
from rsdeblur.estimate.correction import PARAMETERS, Recording
from rsdeblur.estimate.mounting import CONFIDENT, RESAMPLES, mounting_name
from rsdeblur.estimate.photo_fit import START, PhotoFit, PhotoSet
from rsdeblur.estimate.refine import grey_lights
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.axes import rotations
from rsdeblur.motion.camera import TIMESTAMP_SHARES, Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray, Progress

# Least number of photos.
LEAST_PHOTOS = 3
# Step of the offsets with which mountings are compared, s, and the mountings that are then fitted.
STEP, FITTED, BEGINS = 8e-3, 4, 2
# Readout times that are tried in all directions, s, and offsets of the middle row around the fitted one.
READOUTS = (5e-3, 10e-3, 20e-3, 30e-3)
BESIDE = np.arange(-12e-3, 13e-3, 4e-3)
# Other focal lengths that are tried, as multiples of the fitted one.
ZOOMS = 0.8, 0.9, 1.1, 1.25
# Longest search, s.
MOST_SEARCH = 1.0
# Half a turn about the optical axis, which leaves the spectra of a blur without roll as they are.
HALF_TURN = np.diag([-1.0, -1.0, 1.0])
# Least lead over any other mounting, nats over all photos, and the least share of resamplings of a readout direction
# that is not ruled out.
LEAST_LEAD, LEAST_SHARE = 10.0, 0.05
# Numbers of the result among the corrections, and their units.
NUMBERS = "offset", "scale", "readout"
UNITS = {"offset": "s", "scale": "px", "readout": "s"}
# Errors that all photos share, because phones denoise and sharpen: of the offset in s, of the focal length and of the
# readout time as shares, and of the length of the blur in px.
OFFSET_ERROR, SCALE_ERROR, READOUT_ERROR, SOFTNESS_ERROR = 2e-3, 0.015, 0.25, 0.6
# Largest deviations of numbers that count as determined: s, shares.
MOST_ERRORS = {"offset": 4e-3, "scale": 0.05, "readout": 0.35}


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class PhotoCalibration:
    """Result of :func:`calibrate_photos`.

    Parameters
    ----------
    accepted : bool
        Whether the fit is trustworthy.
    reason : str
        Why it is not; empty otherwise.
    camera : Camera
        The calibrated camera; the start's if the fit is refused.
    confidence : float
        Share, in [0, 1], of resamplings of the photos that give the same mounting.
    photos : int
        Number of photos.
    mounting : str
        Orientation string of the mounting, like ``"YxZ"``.
    directed : bool
        Whether the photos determine the direction of the readout; otherwise it is assumed.
    values : dict of str to Estimate
        ``time_offset``, ``focal_length`` and ``readout_time``; empty if the fit is refused.
    """

    accepted: bool
    reason: str
    camera: Camera
    confidence: float
    photos: int
    mounting: str
    directed: bool
    values: dict[str, Estimate]


def calibrate_photos(
    images: Iterable[ArrayLike],
    exposures: Sequence[Exposure],
    log: GyroLog | Sequence[GyroLog],
    camera: Camera,
    *,
    search: tuple[float, float] = (-0.03, 0.03),
    transfer: Transfer | Auto = "auto",
    progress: Progress | None = None,
) -> PhotoCalibration:
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
    PhotoCalibration
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
    return _Search(PhotoSet(lights, recordings), progress or (lambda *_: None)).calibration((first, last))


class _Reading(NamedTuple):
    """Fits with all readout directions.

    Parameters
    ----------
    fits : list of PhotoFit
        The fits, in the order of `READOUT_DIRECTIONS`.
    leads : ndarray, shape (4, photos)
        How much more likely each photo is with each of them than with some camera without readout, nats.
    shares : ndarray, shape (4,)
        Share of resamplings of the photos in which each is the best.
    """

    fits: list[PhotoFit]
    leads: FloatArray
    shares: FloatArray

    @property
    def best(self) -> int:
        """Number of the best one."""
        return int(self.leads.sum(axis=1).argmax())

    @property
    def directed(self) -> bool:
        """Whether the photos determine the direction."""
        return bool(self.shares[self.best] >= CONFIDENT)


class _Search:
    """The steps from no knowledge of mounting, clock and readout to a calibration."""

    def __init__(self, photos: PhotoSet, progress: Progress) -> None:
        self._photos, self._progress = photos, progress

    def calibration(self, search: tuple[float, float]) -> PhotoCalibration:
        """Search, fit and judge."""
        fits = self._mounted(search)
        photos, first = self._photos, fits[0].camera
        # What all are compared with, in either frame: without a readout, all directions are one.
        still = _read_in(first, 0.0)
        leads = np.array([self._leads(fit, still) for fit in fits])
        order = np.argsort(leads.sum(axis=1))[::-1]
        # Where the lead is small, the nearest rival gets the right readout as well.
        close = _confidence([leads[order[0]] - leads[n] for n in order[1:]]) < CONFIDENT
        readings = {int(n): self._read(fits[n], still) for n in order[: 1 + close]}
        for n, reading in readings.items():
            fits[n], leads[n] = reading.fits[reading.best], reading.leads[reading.best]
        # A left-handed log has the spectra of the reversed paths.
        mirrored = leads - [photos.clearer(fit, fit, mirrored=True) for fit in fits]
        matrices = [sign * fit.camera.imu_to_camera for sign in (1, -1) for fit in fits]
        found, confidence, reason = _decided(matrices, np.concatenate([leads, mirrored]))
        camera, values, directed = photos.start, dict[str, Estimate](), False
        if not reason:
            reading = readings[found] if found in readings else self._read(fits[found], still)
            camera, values = self._determined(reading)
            directed = reading.directed
        return PhotoCalibration(
            accepted=not reason,
            reason=reason,
            camera=camera,
            confidence=confidence,
            photos=len(photos),
            mounting=mounting_name(matrices[found]),
            directed=directed,
            values=values,
        )

    def _mounted(self, search: tuple[float, float]) -> list[PhotoFit]:
        """Return the fits with the likeliest mountings."""
        photos, start = self._photos, self._photos.start
        own = start.imu_to_camera
        every = rotations()
        if not any(np.array_equal(own, matrix) for matrix in every):
            every.append(own)
        offsets = start.time_offset + np.linspace(*search, int(np.ceil((search[1] - search[0]) / STEP)) + 1)
        cameras = [
            replace(start, imu_to_camera=matrix, time_offset=float(offset)) for matrix in every for offset in offsets
        ]
        ranked = [cameras[place] for place in photos.best(cameras)]
        matrices = list({each.imu_to_camera.tobytes(): each.imu_to_camera for each in ranked}.values())
        # Half a turn of the best is a rival, whatever its spectra.
        turned = HALF_TURN @ matrices[0]
        rivals = matrices[:FITTED] + [matrix for matrix in matrices[FITTED:] if np.allclose(matrix, turned)]
        fits = []
        for n, matrix in enumerate(rivals):
            self._progress("search", n / len(rivals))
            begins = [each for each in ranked if np.array_equal(each.imu_to_camera, matrix)][:BEGINS]
            fits.append(photos.likeliest([photos.fit(camera) for camera in begins]))
        return fits

    def _leads(self, fit: PhotoFit, still: Camera) -> FloatArray:
        """Return how much more likely each photo is with a fit than with a camera, nats."""
        still = replace(still, readout_direction=fit.camera.readout_direction)
        return self._photos.leads(fit, self._photos.fit(still, ()))

    def _read(self, fit: PhotoFit, still: Camera) -> _Reading:
        """Return fits with all readout directions from a fit on, compared with a camera."""
        photos, fits = self._photos, []
        for n, direction in enumerate(READOUT_DIRECTIONS):
            self._progress("readout", n / len(READOUT_DIRECTIONS))
            camera = replace(fit.camera, readout_direction=direction)
            cameras = [_read_in(camera, time).delayed(beside) for time, beside in product(READOUTS, BESIDE)]
            fits.append(photos.fit(cameras[photos.best(cameras)[0]]))
        leads = np.array([self._leads(each, still) for each in fits])
        best = (_resampled(len(photos)) @ leads.T).argmax(axis=1)
        return _Reading(fits, leads, np.bincount(best, minlength=len(fits)) / len(best))

    def _likely(self, reading: _Reading) -> tuple[list[PhotoFit], FloatArray]:
        """Return the fits that are not ruled out, and their shares: first the best, or the start's if it is likely."""
        photos, fits, shares = self._photos, reading.fits, reading.shares
        known = READOUT_DIRECTIONS.index(photos.start.readout_direction)
        at = known if shares[known] > LEAST_SHARE and not reading.directed else reading.best
        likely = [at, *(n for n in range(len(fits)) if n != at and shares[n] > LEAST_SHARE)]
        kept = []
        for each in (fits[n] for n in likely):
            # Far from the right focal length, the fit may have ended at a local maximum.
            cameras = [_zoomed(each.camera, zoom).delayed(beside) for zoom, beside in product(ZOOMS, BESIDE)]
            kept.append(photos.likeliest([each, photos.fit(cameras[photos.best(cameras)[0]])]))
        return kept, shares[likely] / shares[likely].sum()

    def _determined(self, reading: _Reading) -> tuple[Camera, dict[str, Estimate]]:
        """Return the camera, with the start's value of all that the photos do not determine, and the numbers."""
        start = self._photos.start
        fits, weights = self._likely(reading)
        # Without its direction, nothing is known of the readout.
        worst = "" if reading.directed else "readout"
        while True:
            if worst:
                free = tuple(name for name in fits[0].free if name != worst)
                fits = [self._photos.fit(_without(each.camera, worst, start), free) for each in fits]
            values = self._values(fits, weights)
            excess = [_excess(name, each) for name, each in values.items()]
            worst = NUMBERS[int(np.argmax(excess))]
            if max(excess) <= 1.0:
                break
        camera = fits[0].camera
        offset = values["offset"]
        if offset.sd is not None and not values["readout"].determined:
            # The photos determine when the middle row was exposed; the timestamp marks another one.
            late = _middle(camera) * START.readout * camera.readout_time
            offset = replace(offset, sd=np.hypot(offset.sd, late))
        return camera, {
            "time_offset": offset,
            "focal_length": values["scale"],
            "readout_time": values["readout"],
        }

    def _values(self, fits: list[PhotoFit], weights: FloatArray) -> dict[str, Estimate]:
        """Return the numbers of the first fit; their deviations include the spread of the other fits."""
        places = [PARAMETERS.index(name) for name in NUMBERS]
        found = np.array([_numbers(each.camera) for each in fits])
        spread = np.square(found - found[0])
        for each, squares in zip(fits, spread, strict=True):
            deviations = each.posterior.spread(each.place, each.free)[0]
            squares += np.square((deviations * self._photos.deviations)[places])
        camera, free = fits[0].camera, fits[0].free
        scale_error = np.hypot(SCALE_ERROR, SOFTNESS_ERROR / self._photos.blur(fits[0]))
        sd = np.sqrt(weights @ spread + np.square([OFFSET_ERROR, scale_error, READOUT_ERROR]))
        focal, readout_time = camera.focal_length[0], camera.readout_time
        numbers = zip(NUMBERS, (camera.time_offset, focal, readout_time), (1.0, focal, readout_time), sd, strict=True)
        return {
            name: Estimate(value, unit * each if name in free else None, UNITS[name])
            for name, value, unit, each in numbers
        }


def _decided(matrices: list[FloatArray], leads: FloatArray) -> tuple[int, float, str]:
    """Return the place of the best of some mountings, its confidence, and why it cannot be trusted.

    Parameters
    ----------
    matrices : list of ndarray, shape (3, 3)
        The mountings; those that mirror are of left-handed logs.
    leads : ndarray, shape (n, photos)
        Nats of each photo with each of them.
    """
    best, nearest = np.argsort(leads.sum(axis=1))[:-3:-1]
    confidence = _confidence([leads[best] - each for n, each in enumerate(leads) if n != best])
    left = [bool(np.linalg.det(matrices[n]) < 0) for n in (best, nearest)]
    names = [mounting_name(matrices[n]) for n in (best, nearest)]
    reason = ""
    if confidence < CONFIDENT:
        name, other = (name + ", left-handed," * is_left for name, is_left in zip(names, left, strict=True))
        reason = f"the photos do not decide between the axes {name} and {other}".rstrip(",")
        reason += "; give more photos, with other motion, or a clip"
    elif left[0]:
        reason = (
            f"the log has left-handed axes: read it with --orientation {names[0]} (orientation={names[0]!r}), and "
            "calibrate again"
        )
    return int(best), confidence, reason


def _numbers(camera: Camera) -> tuple[float, float, float]:
    """Return the time offset and the logarithms of focal length and readout time."""
    return camera.time_offset, np.log(camera.focal_length[0]), np.log(max(camera.readout_time, 1e-9))


def _zoomed(camera: Camera, zoom: float) -> Camera:
    fx, fy = camera.focal_length
    return replace(camera, focal_length=(zoom * fx, zoom * fy))


def _read_in(camera: Camera, readout_time: float) -> Camera:
    """Return a camera with another readout time; the middle row keeps its time on the log's clock."""
    later = camera.delayed(_middle(camera) * (readout_time - camera.readout_time))
    return replace(later, readout_time=readout_time)


def _middle(camera: Camera) -> float:
    """Return the share of the readout time from the row that a timestamp marks to the middle one."""
    return 0.5 - TIMESTAMP_SHARES[camera.timestamp_marks]


def _without(camera: Camera, name: str, start: Camera) -> Camera:
    """Return a camera with the start's value of a number; see `_read_in` for the readout time."""
    if name == "scale":
        return replace(camera, focal_length=start.focal_length)
    if name == "offset":
        return replace(camera, time_offset=start.time_offset)
    return _read_in(camera, start.readout_time)


def _excess(name: str, estimate: Estimate) -> float:
    """Return the standard deviation of a number over its limit; 0 if it was not fitted."""
    limit = MOST_ERRORS[name] * (1.0 if name == "offset" else estimate.value)
    return 0.0 if estimate.sd is None else estimate.sd / limit


def _resampled(count: int) -> NDArray[np.int64]:
    """Return how often each of `count` photos is drawn in each resampling, shape (RESAMPLES, count)."""
    draws: NDArray[np.int64] = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), RESAMPLES)
    return draws


def _confidence(leads: Sequence[FloatArray]) -> float:
    """Return the share of resamplings of the photos in which all sums of leads exceed the least one."""
    sums = _resampled(len(leads[0])) @ np.transpose(leads)
    return float(np.mean(sums.min(axis=1) > LEAST_LEAD))
