"""The gyro log that options name, and the direction of gravity in it, which shows wrong axes of the camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from rsdeblur._util.files import FileState, file_state
from rsdeblur.cli import _engine as rs
from rsdeblur.cli._options import Recording
from rsdeblur.cli._output import capture_warnings, warn

# Angle (rad) from which gravity does not point to the bottom of a picture, and that from which it points to its top.
ASIDE, TOP = math.radians(50), math.radians(130)
# Apps of the rear camera, whose accelerometers show the same sign on all devices. Raw values of iOS have the opposite
# one, which looks like a picture upside down.
REAR = "mars", "deepgyro"
# Where the bottom of the viewed picture is in the stored one, for each orientation in EXIF that does not mirror: angle
# (rad) from its bottom towards its right.
BOTTOMS = {1: 0.0, 3: math.pi, 6: math.pi / 2, 8: -math.pi / 2}


def read_log(recording: Recording) -> rs.GyroFile:
    """Read the log that the options name, without its bias, and show its warnings.

    The last log is kept: a long one takes longer than deblurring a photo.
    """
    file, messages = known_log(recording)
    for message in messages:
        warn(message)
    return file if recording.bias is None else replace(file, log=file.log.minus_bias(recording.bias))


def known_log(recording: Recording) -> tuple[rs.GyroFile, list[str]]:
    """Return the log with its bias, and the warnings of its reader."""
    columns = rs.choice_for("gyro log", recording.columns)
    reading = recording.gyro_format, recording.unit, recording.orientation, recording.rate, columns
    return _gyro_file(recording.gyro, file_state(recording.gyro), *reading)


@lru_cache(maxsize=1)
def _gyro_file(
    path: Path,
    _: FileState,
    format: str | None,
    unit: str | None,
    orientation: str | None,
    rate: float | None,
    columns: str | None,
) -> tuple[rs.GyroFile, list[str]]:
    with capture_warnings(show=False) as messages:
        file = rs.open_gyro(path, format, unit=unit, orientation=orientation, rate=rate, columns=columns)
        return file, messages


def accelerometer(path: Path, columns: str | None) -> rs.AccelerationLog | None:
    """Return the accelerometer's samples in a gyro log; None if there are none that can be read."""
    return _acceleration(path, file_state(path), columns)


@lru_cache(maxsize=1)
def _acceleration(path: Path, _: FileState, columns: str | None) -> rs.AccelerationLog | None:
    return rs.accelerometer(path, columns)


def warn_of_axes(file: rs.GyroFile, camera: rs.Camera, recording: Recording) -> None:
    """Warn if the camera file contradicts the axes of the log, where those are known."""
    import numpy as np

    problems = []
    if file.axes == "phone" and camera.readout_time == 0:
        problems.append(
            f"the readout time is 0, as of a global shutter, but {recording.gyro} is the log of a phone, whose shutter "
            "rolls; give --readout-time"
        )
    given = None
    if np.array_equal(camera.imu_to_camera, np.eye(3)):
        given = "the identity"
    elif file.axes == "gyroflow" and np.array_equal(camera.imu_to_camera, rs.imu_to_camera("phone-portrait")):
        given = "that of a phone's axes"
    if given is not None and file.axes != "sensor":
        expected = "phone-portrait or phone-landscape" if file.axes == "phone" else "gyroflow"
        problems.append(
            f"imu_to_camera is {given}, but {recording.gyro} is in {file.axes} axes; it should be {expected}"
        )
    for problem in problems:
        warn(f"{recording.camera}: {problem}")


def bottom_of_photo(exif: bytes | None) -> float | None:
    """Return where the bottom of the viewed picture is in the stored one, see `BOTTOMS`; None if it is unknown."""
    return BOTTOMS.get(rs.Exif(exif).orientation)


def bottom_of_clip(matrix: tuple[int, ...] | None) -> float | None:
    """Return the same for the frames of a video with a display matrix, without which viewers do not turn it."""
    if matrix is None:
        return 0.0
    (a, b), (c, d) = matrix[:2], matrix[3:5]
    return math.atan2(b, d) if a * d - b * c > 0 else None


class Gravity(NamedTuple):
    """Whether gravity points to the bottom of the picture, or elsewhere; neither where the direction is unknown.

    `fits` are names of axes with which it points to the bottom, where those of the camera cannot be right.
    """

    confirms: bool = False
    contradicts: bool = False
    fits: tuple[str, ...] = ()


def gravity_of(
    picture: Path, bottom: float | None, recording: Recording, camera: rs.Camera, exposures: Sequence[rs.Exposure]
) -> Gravity:
    """Return where the log's accelerometer sees gravity in a picture, or on average in frames of a video.

    Warn where that contradicts the camera's axes.
    `bottom` is where the bottom of the viewed picture is in the stored one, rad.
    """
    # Other axes than those of the file are the user's, and the accelerometer is read in those of the file.
    log = None if bottom is None or recording.orientation else accelerometer(recording.gyro, recording.columns)
    # Those of 16 frames of a clip, spread over it: a camera in motion tilts and turns.
    exposures = exposures[:: -(-len(exposures) // 16)]
    if log is None or bottom is None:
        return Gravity()
    angle = _turn(log, camera, exposures, bottom)
    file, _ = known_log(recording)
    # Cameras of phones look along their z axis, within 45 degrees, those on the back towards its negative end.
    forward = camera.imu_to_camera[2, 2] if file.axes == "phone" else -1.0
    if abs(forward) < 0.7:
        doubt = f"the camera would look along an edge of the phone that logged {recording.gyro}"
    elif forward > 0 and file.format in REAR:
        doubt = f"the camera would look towards the user of the app that logged {recording.gyro}"
    elif angle is None or abs(angle) < ASIDE:
        return Gravity(confirms=angle is not None)
    elif abs(angle) > TOP and file.format not in REAR:
        return Gravity()
    else:
        side = "top" if abs(angle) > TOP else "right" if angle > 0 else "left"
        doubt = f"by the accelerometer in {recording.gyro}, gravity points to the {side} of {picture}"
    fits = tuple(
        name
        for name in rs.PRESETS
        if (file.axes == "sensor" or name.startswith(file.axes))
        and (turn := _turn(log, replace(camera, imu_to_camera=rs.imu_to_camera(name)), exposures, bottom)) is not None
        and abs(turn) < ASIDE
    )
    warn(
        f"{doubt}: if the picture is viewed upright, imu_to_camera in {recording.camera} is wrong"
        + (f" ({' or '.join(fits)} fits)" if fits else "")
    )
    return Gravity(contradicts=True, fits=fits)


def _turn(log: rs.AccelerationLog, camera: rs.Camera, exposures: Sequence[rs.Exposure], bottom: float) -> float | None:
    """Return the mean angle from the bottom of the viewed picture to gravity, from -pi to pi; None if it is unknown."""
    angles = [angle for each in exposures if (angle := log.gravity_angle(camera, each)) is not None]
    if not angles:
        return None
    return math.remainder(math.atan2(sum(map(math.sin, angles)), sum(map(math.cos, angles))) - bottom, math.tau)
