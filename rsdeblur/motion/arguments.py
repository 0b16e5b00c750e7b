"""Check of the objects that describe an exposure, at the door of the functions that take them."""

from __future__ import annotations

from rsdeblur._util import validate
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation


def check_recording(log: object, camera: object, exposure: object, translation: object = None) -> None:
    """Raise `InputError` unless the arguments are a log, a camera, an exposure and, unless None, a translation."""
    validate.instance("log", log, GyroLog)
    validate.instance("camera", camera, Camera)
    validate.instance("exposure", exposure, Exposure)
    if translation is not None:
        validate.instance("translation", translation, Translation)
