"""Corrections of a recording: the few numbers by which camera, clock and gyro log are usually wrong."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import ReadoutFrame
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import Capture
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray

# Distance of a path from its chord, px, from which an acceleration counts.
LEAST_BEND = 0.25


@dataclass(frozen=True, slots=True)
class Correction:
    """Correction of a recording; zeros leave it as it is.

    Parameters
    ----------
    scale : float, default 0.0
        Logarithm of the factor on the focal length, and so on the size of the blur.
    drift_x, drift_y : float, default 0.0
        Shift of the scene in the picture during the exposure, at constant velocity, in px of the picture as stored. It
        represents any steady motion that the log lacks: translation at one depth, a bias about x or y, optical
        stabilisation.
    offset : float, default 0.0
        Added to the time offset, s.
    readout : float, default 0.0
        Logarithm of the factor on the readout time.
    roll : float, default 0.0
        Bias of the gyroscope about the optical axis, rad/s, subtracted from the rates.
    acceleration_x, acceleration_y : float, default 0.0
        Acceleration of the scene in the picture, px/s^2, which bends the drift: its velocity is the mean one in the
        middle of the exposure.

    Raises
    ------
    InputError
        If a number is not finite.
    """

    scale: float = 0.0
    drift_x: float = 0.0
    drift_y: float = 0.0
    offset: float = 0.0
    readout: float = 0.0
    roll: float = 0.0
    acceleration_x: float = 0.0
    acceleration_y: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, validate.finite(field.name, getattr(self, field.name)))

    @property
    def drift(self) -> tuple[float, float]:
        """The drift, (x, y) in px."""
        return self.drift_x, self.drift_y

    @property
    def acceleration(self) -> tuple[float, float]:
        """The acceleration, (x, y) in px/s^2."""
        return self.acceleration_x, self.acceleration_y


#: Names of the numbers of a :class:`Correction`, in their order.
PARAMETERS = tuple(field.name for field in fields(Correction))
#: Names of those that belong to the recording, which all of its photos share.
SHARED = ("scale", "offset", "readout", "roll")
#: Names of those that belong to the motion of the scene in one photo, which depends on its depth.
DRIFT, ACCELERATION = ("drift_x", "drift_y"), ("acceleration_x", "acceleration_y")


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """Standard deviations of the errors of a recording; 0 for what is known.

    Parameters
    ----------
    scale : float, default 0.15
        Relative error of the focal length. Near scenes blur more than rotation alone predicts.
    drift : float, default 0.0025
        Shift of the scene during the exposure that the log lacks, along each axis, as a share of the picture's longer
        side.
    offset : float, default 0.005
        Error of the time offset, s, where the camera has no `time_offset_sd`.
    readout : float, default 0.15
        Relative error of the readout time, where the camera has no `readout_sd`.
    roll : float, default 0.02
        Bias of the gyroscope about the optical axis, rad/s.
    acceleration : float, default 0.1
        Acceleration of the scene in the picture that the log lacks, along each axis, as a share of the picture's longer
        side per s^2. Only long exposures show it, and only :func:`refine` with known axes searches it.

    Raises
    ------
    InputError
        If a value is negative or not finite, or all are 0.

    Examples
    --------
    The clock is known, the focal length to 5 %:

    >>> import rsdeblur
    >>> rsdeblur.Uncertainty(offset=0, scale=0.05)
    Uncertainty(scale=0.05, drift=0.0025, offset=0.0, readout=0.15, roll=0.02, acceleration=0.1)
    """

    scale: float = 0.15
    drift: float = 0.0025
    offset: float = 5e-3
    readout: float = 0.15
    roll: float = 0.02
    acceleration: float = 0.1

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, validate.finite(field.name, getattr(self, field.name), minimum=0.0))
        if not any(getattr(self, field.name) for field in fields(self)):
            raise InputError("uncertainty is 0 in all its parts, so that there is nothing to refine")

    def deviations(self, camera: Camera, exposure: Exposure) -> FloatArray:
        """Return the standard deviations of the parameters of a :class:`Correction`.

        Parameters
        ----------
        camera, exposure
            The recording. Without a readout, its time is known; short exposures show no acceleration.

        Returns
        -------
        ndarray, shape (8,)
            In the order and the units of :class:`Correction`.
        """
        longer = max(camera.width, camera.height)
        drift, acceleration = self.drift * longer, self.acceleration * longer
        readout = self.readout if camera.readout_time > 0 else 0.0
        if readout > 0 and camera.readout_sd > 0:
            readout = camera.readout_sd / camera.readout_time
        if acceleration * exposure.duration**2 / 8 < LEAST_BEND:
            acceleration = 0.0
        offset = self.offset and (camera.time_offset_sd or self.offset)
        numbers = self.scale, drift, drift, offset, readout, self.roll, acceleration, acceleration
        return np.array(astuple(Correction(*numbers)))


def uncertainty_of(given: Uncertainty | None, free: str | Collection[str] | None, default: Uncertainty) -> Uncertainty:
    """Return what a caller gives as `uncertainty` and `free`: `default`, if nothing, with 0 for what is not free."""
    uncertainty = default if given is None else validate.instance("uncertainty", given, Uncertainty)
    if free is None:
        return uncertainty
    names = [field.name for field in fields(Uncertainty)]
    chosen = [free] if isinstance(free, str) else validate.items("free", free)
    kept = set(names) - {validate.choice("free", name, names) for name in chosen}
    return replace(uncertainty, **dict.fromkeys(kept, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One exposure as recorded: log, camera, time, and translation if it is known; see :func:`rsdeblur.deblur`."""

    log: GyroLog
    camera: Camera
    exposure: Exposure
    translation: Translation | None = None

    def corrected(self, correction: Correction) -> Recording:
        """Return the recording with a correction."""
        camera = self.camera
        fx, fy = (np.exp(correction.scale) * focal for focal in camera.focal_length)
        camera = replace(
            camera,
            focal_length=(fx, fy),
            readout_time=camera.readout_time * np.exp(correction.readout),
            time_offset=camera.time_offset + correction.offset,
        )
        log = self.log
        if correction.roll:
            log = log.minus_bias(camera.imu_to_camera.T @ np.array([0.0, 0.0, correction.roll]))
        translation = self.translation
        px, acceleration = correction.drift, correction.acceleration
        if any(px) or any(acceleration):
            translation = Translation.drift(px, camera, self.exposure, acceleration=acceleration, known=translation)
        return replace(self, log=log, camera=camera, translation=translation)

    def capture(self, scale: float = 1.0) -> Capture:
        """Return the capture in the upright frame, of the picture reduced by a factor `scale`."""
        return ReadoutFrame(self.camera.scaled(scale)).capture(self.log, self.exposure, self.translation)
