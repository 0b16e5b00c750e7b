"""How an IMU sits in a camera: orientation strings and presets."""

from __future__ import annotations

import re

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.types import FloatArray

# Gyroflow's frame is x up, y left, z back; a camera's x right, y down, z forward.
GYROFLOW_TO_CAMERA = ((0, -1, 0), (-1, 0, 0), (0, 0, -1))

# Android's and iOS's device axes (x right, y up, z out of the screen, phone upright) and the rear camera: its picture
# stored upright; as the sensor reads it, the phone's right side at the top; and both upside down.
PRESETS = {
    "gyroflow": "XYZ",
    "phone-portrait": "YxZ",
    "phone-landscape": "XYZ",
    "phone-portrait-reversed": "yXZ",
    "phone-landscape-reversed": "xyZ",
}


def orientation(letters: str) -> FloatArray:
    """Return the matrix that an orientation string of Gyroflow describes, shape (3, 3).

    It takes raw numbers to Gyroflow's frame. It is no rotation where the raw ones are left-handed, as those of some
    action cameras are, whose strings are like ``"xZy"``.

    Parameters
    ----------
    letters : str
        The raw axis that becomes Gyroflow's x (up), y (left) and z (back) axis each, lower case if it is negated:
        ``"XYZ"`` changes nothing, ``"YxZ"`` is a phone held upright.

    Raises
    ------
    InputError
        If it is no such string.
    """
    if not re.fullmatch(r"[XYZxyz]{3}", letters) or len(set(letters.upper())) != 3:
        raise InputError(f"{letters!r} is no orientation: it must name each of X, Y and Z once, like 'YxZ'")
    matrix = np.zeros((3, 3))
    for row, letter in enumerate(letters):
        matrix[row, "XYZ".index(letter.upper())] = 1.0 if letter.isupper() else -1.0
    return matrix


def imu_to_camera(name: str) -> FloatArray:
    """Return the matrix from IMU to camera axes that a preset or an orientation string stands for, shape (3, 3).

    Raises
    ------
    InputError
        If there is no such preset and it is no orientation string.
    """
    if name not in PRESETS and not re.fullmatch(r"[XYZxyz]{3}", name):
        raise InputError(
            f"there is no IMU orientation {name!r}; use one of {', '.join(PRESETS)}, or three letters like 'YxZ'"
        )
    camera: FloatArray = np.array(GYROFLOW_TO_CAMERA, dtype=np.float64) @ orientation(PRESETS.get(name, name))
    return camera
