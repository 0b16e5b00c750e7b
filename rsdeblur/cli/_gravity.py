"""Axes that an accelerometer contradicts: gravity points to the bottom of a picture that is viewed upright."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from rsdeblur.cli._inputs import file_state, log_axes, log_format
from rsdeblur.errors import RsdeblurError, RsdeblurWarning

if TYPE_CHECKING:
    from rsdeblur.cli._options import Recording
    from rsdeblur.io.samples import Axes
    from rsdeblur.motion.acceleration import AccelerationLog
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure

# Angle (rad) from which gravity does not point to the bottom of a picture, and that from which it points to its top.
ASIDE, TOP = math.radians(50), math.radians(130)
# Formats whose accelerometers show the same sign on all devices. Raw values of iOS have the opposite one, which looks
# like a picture upside down.
ONE_SIGN = "mars", "deepgyro"
# Where the bottom of the viewed picture is in the stored one, for each orientation in EXIF that does not mirror: angle
# (rad) from its bottom towards its right.
BOTTOMS = {1: 0.0, 3: math.pi, 6: math.pi / 2, 8: -math.pi / 2}


def gravity_problem(
    photo: Path, exif: bytes | None, recording: Recording, camera: Camera, exposure: Exposure
) -> str | None:
    """Return what is wrong where gravity does not point to the bottom of a picture; None if nothing is, or unknown.

    Parameters
    ----------
    photo : Path
        The picture.
    exif : bytes or None
        Its EXIF block, which contains how it is viewed.
    recording : Recording
        Names the log.
    camera, exposure
        The camera and the exposure.
    """
    log, bottom = _known(exif, recording)
    angle = None if log is None else _turn(log, camera, exposure, bottom)
    if log is None or angle is None or abs(angle) < ASIDE:
        return None
    if abs(angle) > TOP and log_format(recording) not in ONE_SIGN:
        return None
    side = "top" if abs(angle) > TOP else "right" if angle > 0 else "left"
    fits = _presets(log, log_axes(recording), camera, exposure, bottom)
    return (
        f"by the accelerometer in {recording.gyro}, gravity points to the {side} of {photo}: if the picture is "
        f"viewed upright, imu_to_camera in {recording.camera} is wrong" + (f" ({fits} fits)" if fits else "")
    )


def gravity_confirms(exif: bytes | None, recording: Recording, camera: Camera, exposure: Exposure) -> bool:
    """Return whether gravity points to the bottom of a picture; False if that is unknown. See `gravity_problem`."""
    log, bottom = _known(exif, recording)
    angle = None if log is None else _turn(log, camera, exposure, bottom)
    return angle is not None and abs(angle) < ASIDE


def _known(exif: bytes | None, recording: Recording) -> tuple[AccelerationLog | None, float]:
    """Return the accelerometer's log and where the bottom of the viewed picture is; None if either is unknown."""
    from rsdeblur.io.exif import Exif

    # Other axes than those of the file are the user's, and the accelerometer is read in those of the file.
    log = None if recording.orientation else accelerometer(recording.gyro)
    bottom = None if log is None else BOTTOMS.get(Exif(exif).orientation)
    return (None, 0.0) if bottom is None else (log, bottom)


def _turn(log: AccelerationLog, camera: Camera, exposure: Exposure, bottom: float) -> float | None:
    """Return the angle from the bottom of the viewed picture to gravity, from -pi to pi; None where it is unknown."""
    angle = log.gravity_angle(camera, exposure)
    return None if angle is None else math.remainder(angle - bottom, math.tau)


def _presets(log: AccelerationLog, axes: Axes, camera: Camera, exposure: Exposure, bottom: float) -> str:
    """Return the presets of a log in `axes` with which gravity points to the bottom of the picture."""
    from rsdeblur.motion.axes import PRESETS, imu_to_camera

    turns = {name: _turn(log, replace(camera, imu_to_camera=imu_to_camera(name)), exposure, bottom) for name in PRESETS}
    fits = [name for name, turn in turns.items() if turn is not None and abs(turn) < ASIDE]
    return " or ".join(name for name in fits if axes == "sensor" or name.startswith(axes))


def accelerometer(path: Path) -> AccelerationLog | None:
    """Return the accelerometer's samples in a gyro log; None if there are none that can be read."""
    return _acceleration(path, file_state(path))


@lru_cache(maxsize=1)
def _acceleration(path: Path, _: tuple[int, ...] | None) -> AccelerationLog | None:
    """Read the accelerometer in a gyro log; kept for the next photo."""
    from rsdeblur.io import read_acceleration

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        try:
            return read_acceleration(path)
        except RsdeblurError:
            return None
