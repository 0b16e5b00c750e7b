"""Checks of the objects that describe an exposure, at the door of the functions that take them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

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


def exposure_list(exposures: Iterable[Exposure], name: str = "exposures") -> list[Exposure]:
    """Return exposures as a list; raise `InputError`, which names the argument, unless every item is an Exposure."""
    if isinstance(exposures, Mapping):
        raise InputError(f"{name} must be a sequence of Exposure, got {validate.shown(exposures)}")
    given = validate.items(name, exposures)
    return [validate.instance(f"{name}[{n}]", each, Exposure) for n, each in enumerate(given)]


def check_traceable(camera: Camera, translation: Translation | None) -> None:
    """Raise `InputError` unless paths can be traced: readout along y, and a translation only with a lens below 180."""
    if camera.horizontal_readout and camera.readout_time > 0:
        raise InputError(f"the camera is read {camera.readout_direction}; trace paths with camera.turned()")
    corners = np.stack(np.meshgrid([0.0, camera.width - 1], [0.0, camera.height - 1]), axis=-1)
    if translation is not None and not (camera.rays(corners)[..., 2] > 0).all():
        raise InputError(
            "a translation needs a scene at one depth, which a lens that sees 180 degrees or more cannot show whole; "
            "use no translation"
        )


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
