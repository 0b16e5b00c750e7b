"""Axes that an accelerometer contradicts: gravity points to the bottom of a picture that is viewed upright."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
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
# Number of frames of a clip, spread over it, whose mean direction counts: a camera in motion tilts and turns.
CLIP_FRAMES = 16


def bottom_of_photo(exif: bytes | None) -> float | None:
    """Return where the bottom of the viewed picture is in the stored one, see `BOTTOMS`; None if it is unknown."""
    from rsdeblur.io.exif import Exif

    return BOTTOMS.get(Exif(exif).orientation)


def bottom_of_clip(matrix: tuple[int, ...] | None) -> float | None:
    """Return where the bottom of the viewed picture is in the stored frames of a video, rad; None if it is mirrored.

    `matrix` is its display matrix; None means that viewers do not turn it.
    """
    if matrix is None:
        return 0.0
    (a, b), (c, d) = matrix[:2], matrix[3:5]
    return math.atan2(b, d) if a * d - b * c > 0 else None


def some_frames(exposures: Sequence[Exposure]) -> Sequence[Exposure]:
    """Return the exposures of some frames of a clip, for `gravity_problem`."""
    return exposures[:: -(-len(exposures) // CLIP_FRAMES)]


def gravity_problem(
    picture: Path, bottom: float | None, recording: Recording, camera: Camera, exposures: Sequence[Exposure]
) -> str | None:
    """Return what is wrong where gravity does not point to the bottom of a picture; None if nothing is, or unknown.

    Parameters
    ----------
    picture : Path
        The picture, or a video.
    bottom : float or None
        Where the bottom of the viewed picture is in the stored one, rad.
    recording : Recording
        Names the log.
    camera, exposures
        The camera and the exposure, or those of frames of a video.
    """
    log = _log(bottom, recording)
    angle = _turn(log, camera, exposures, bottom)
    if log is None or angle is None or abs(angle) < ASIDE:
        return None
    if abs(angle) > TOP and log_format(recording) not in ONE_SIGN:
        return None
    side = "top" if abs(angle) > TOP else "right" if angle > 0 else "left"
    fits = _presets(log, log_axes(recording), camera, exposures, bottom)
    return (
        f"by the accelerometer in {recording.gyro}, gravity points to the {side} of {picture}: if the picture is "
        f"viewed upright, imu_to_camera in {recording.camera} is wrong" + (f" ({fits} fits)" if fits else "")
    )


def gravity_confirms(bottom: float | None, recording: Recording, camera: Camera, exposures: Sequence[Exposure]) -> bool:
    """Return whether gravity points to the bottom of a picture; False if that is unknown. See `gravity_problem`."""
    angle = _turn(_log(bottom, recording), camera, exposures, bottom)
    return angle is not None and abs(angle) < ASIDE


def _log(bottom: float | None, recording: Recording) -> AccelerationLog | None:
    """Return the accelerometer's log where it can be compared with the bottom of the viewed picture."""
    # Other axes than those of the file are the user's, and the accelerometer is read in those of the file.
    return None if bottom is None or recording.orientation else accelerometer(recording.gyro)


def _turn(
    log: AccelerationLog | None, camera: Camera, exposures: Sequence[Exposure], bottom: float | None
) -> float | None:
    """Return the mean angle from the bottom of the viewed picture to gravity, from -pi to pi; None if it is unknown."""
    if log is None or bottom is None:
        return None
    angles = [angle for each in exposures if (angle := log.gravity_angle(camera, each)) is not None]
    if not angles:
        return None
    return math.remainder(math.atan2(sum(map(math.sin, angles)), sum(map(math.cos, angles))) - bottom, math.tau)


def _presets(
    log: AccelerationLog, axes: Axes, camera: Camera, exposures: Sequence[Exposure], bottom: float | None
) -> str:
    """Return the presets of a log in `axes` with which gravity points to the bottom of the picture."""
    from rsdeblur.motion.axes import PRESETS, imu_to_camera

    cameras = {name: replace(camera, imu_to_camera=imu_to_camera(name)) for name in PRESETS}
    turns = {name: _turn(log, each, exposures, bottom) for name, each in cameras.items()}
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
