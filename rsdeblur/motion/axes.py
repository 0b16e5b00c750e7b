"""Orientation of the IMU in the camera: orientation strings, presets, and all mountings along the axes."""

from __future__ import annotations

import re
from itertools import permutations, product

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.types import FloatArray

# Names for users; calibration and readers of logs use the others.
__all__ = ["imu_to_camera", "orientation"]

# Gyroflow's axes are x up, y left, z back; the camera's are x right, y down, z forward.
GYROFLOW_TO_CAMERA = ((0, -1, 0), (-1, 0, 0), (0, 0, -1))

# The phone presets are for device axes of Android and iOS (x right, y up, z out of the screen, phone upright) and the
# rear camera. Its picture is stored upright ("portrait") or as the sensor reads it, with the phone's right side at the
# top ("landscape"); "reversed" means upside down.
PRESETS = {
    "gyroflow": "XYZ",
    "phone-portrait": "YxZ",
    "phone-landscape": "XYZ",
    "phone-portrait-reversed": "yXZ",
    "phone-landscape-reversed": "xyZ",
}


def orientation(letters: str) -> FloatArray:
    """Return the matrix of one of Gyroflow's orientation strings.

    The matrix takes raw rates to Gyroflow's axes. Some action cameras record rates in left-handed axes, with strings
    like ``"xZy"``; their matrix is not a rotation.

    Parameters
    ----------
    letters : str
        For each of Gyroflow's axes x (up), y (left) and z (back), the raw axis that it is taken from, in lower case if
        the sign changes: ``"XYZ"`` changes nothing, ``"YxZ"`` is a phone held upright.

    Returns
    -------
    ndarray, shape (3, 3)
        Matrix M of `gyroflow = M @ raw`.

    Raises
    ------
    InputError
        If `letters` does not name each axis once.
    """
    if not re.fullmatch(r"[XYZxyz]{3}", letters) or len(set(letters.upper())) != 3:
        raise InputError(
            "orientation must name each of X, Y and Z once, like 'YxZ', or be one of a camera's presets, "
            f"{', '.join(PRESETS)}; got {letters!r}"
        )
    matrix = np.zeros((3, 3))
    for row, letter in enumerate(letters):
        matrix[row, "XYZ".index(letter.upper())] = 1.0 if letter.isupper() else -1.0
    return matrix


def imu_to_camera(name: str) -> FloatArray:
    """Return the matrix from IMU axes to camera axes that a preset or an orientation string describes.

    Parameters
    ----------
    name : str
        A key of `PRESETS`, or an orientation string, see :func:`orientation`.

    Returns
    -------
    ndarray, shape (3, 3)
        Matrix for the parameter `imu_to_camera` of :class:`rsdeblur.Camera`.

    Raises
    ------
    InputError
        If `name` is neither a preset nor an orientation string.
    """
    return np.array(GYROFLOW_TO_CAMERA, dtype=np.float64) @ orientation(PRESETS.get(name, name))


def mountings() -> list[FloatArray]:
    """Return all 48 signed permutations, the 24 rotations first."""
    matrices = [
        np.diag(np.array(signs)) @ np.eye(3)[list(order)]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return sorted(matrices, key=lambda matrix: -round(float(np.linalg.det(matrix))))


def rotations() -> list[FloatArray]:
    """Return the 24 mountings of right-handed logs."""
    return mountings()[:24]


def letters(matrix: FloatArray) -> str:
    """Return the orientation string that :func:`imu_to_camera` turns into `matrix`.

    The matrix, from IMU axes to camera axes, is a signed permutation, which may mirror.
    """
    rows = np.array(GYROFLOW_TO_CAMERA, dtype=np.float64).T @ matrix
    names = ["XYZ"[int(np.abs(row).argmax())] for row in rows]
    return "".join(name if row.sum() > 0 else name.lower() for name, row in zip(names, rows, strict=True))
