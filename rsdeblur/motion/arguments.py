"""Checks of the objects that describe an exposure, at the door of the functions that take them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rsdeblur._util import validate
from rsdeblur.errors import InputError
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation

if TYPE_CHECKING:
    from rsdeblur.motion.paths import Capture


def check_recording(log: object, camera: object, exposure: object, translation: object = None) -> None:
    """Raise `InputError` unless the arguments are a log, a camera, an exposure and, unless None, a translation."""
    validate.instance("log", log, GyroLog)
    validate.instance("camera", camera, Camera)
    validate.instance("exposure", exposure, Exposure)
    if translation is not None:
        validate.instance("translation", translation, Translation)


def check_reach(capture: Capture, *, spare: int = 0) -> None:
    """Raise `InputError` unless the picture can hold the blur and `spare` px around it."""
    if not is_held(capture, spare=spare):
        height, width = capture.camera.height, capture.camera.width
        down, across = (reach + spare for reach in capture.probe.extent)
        raise InputError(
            f"the blur reaches {across:.3g} px sideways and {down:.3g} px up and down from its centre, more than "
            f"the picture of {width}x{height} px can hold; are the rates in rad/s, the focal length in px, times in s?"
        )


def is_held(capture: Capture, *, spare: int = 0) -> bool:
    """Return whether the picture can hold the blur and `spare` px around it; false if its paths are not finite."""
    down, across = (reach + spare for reach in capture.probe.extent)
    return bool(2 * down + 1 <= capture.camera.height and 2 * across + 1 <= capture.camera.width)
