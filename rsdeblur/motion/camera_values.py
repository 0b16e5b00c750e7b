"""Numbers of a :class:`~rsdeblur.motion.camera.Camera`: checks, which raise `InputError`, and doubts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur.choices import Distortion
from rsdeblur.errors import InputError
from rsdeblur.motion import axes, lens
from rsdeblur.types import FloatArray

if TYPE_CHECKING:
    from rsdeblur.motion.camera import Camera

# Largest width and height, px. The widest panoramas have a tenth of that, and every row has a pose.
MOST_PIXELS = 1_000_000

# Largest length in px and largest coefficient. No lens comes near it, and its eighth power does not overflow.
LARGEST = 1e12

# Largest deviation from orthonormality. A rotation typed with four decimals deviates by 1e-4.
ROTATION_TOLERANCE = 1e-3

# Degrees along the longer side. Without fisheye distortion no lens for photos sees more.
WIDEST = 150.0
# s. The slowest sensors of cameras take 0.1 s.
LONGEST_READOUT = 0.2
# mm: diagonal of a 36 x 24 mm film frame, to which the 35 mm equivalent refers.
FILM_DIAGONAL = 43.267


def focal35_px(focal35: float, width: int, height: int) -> float:
    """Return the focal length in px that a 35 mm equivalent in mm means."""
    return focal35 / FILM_DIAGONAL * math.hypot(width, height)


def pixels(name: str, value: Any, *, minimum: int = 1) -> int:
    """Return a whole number of pixels, at least `minimum`."""
    return validate.count(name, value, minimum=minimum, maximum=MOST_PIXELS)


def vectors(name: str, value: ArrayLike, size: int) -> FloatArray:
    """Return vectors of `size` values along the last axis; they may be NaN."""
    vectors = validate.array(name, value).astype(np.float64, copy=False)
    if vectors.shape[-1:] != (size,):
        raise InputError(f"{name} must have shape (..., {size}), got {vectors.shape}")
    return vectors


def focal_length(value: Any) -> tuple[float, float]:
    """Return the focal lengths along x and y, px, from a pair or from one for both."""
    pair: Any = (value, value) if isinstance(value, (int, float, np.number)) else value
    fx, fy = validate.real_array("focal_length", pair, (2,), most=LARGEST)
    if min(fx, fy) < 1 / LARGEST:
        raise InputError(f"focal_length must be positive and at least {1 / LARGEST:g} px, got ({fx:g}, {fy:g})")
    return float(fx), float(fy)


def coefficients(model: Distortion, value: ArrayLike) -> tuple[float, ...]:
    """Return the coefficients of a lens model."""
    k = validate.real_array("distortion", value, (None,), most=LARGEST)
    if len(k) not in lens.COEFFICIENTS[model]:
        counts = " or ".join(map(str, lens.COEFFICIENTS[model]))
        raise InputError(f"distortion of the model {model!r} must have {counts} coefficients, got {len(k)}")
    return tuple(k.tolist())


def rotation(value: ArrayLike | str) -> FloatArray:
    """Return a rotation from its matrix or the name of a preset."""
    rows = axes.imu_to_camera(value) if isinstance(value, str) else value
    matrix = validate.real_array("imu_to_camera", rows, (3, 3), most=LARGEST)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise InputError(
            f"imu_to_camera must be a rotation: its rows must be perpendicular unit vectors, got {matrix.tolist()}"
        )
    if np.linalg.det(matrix) < 0:
        raise InputError(
            "imu_to_camera has determinant -1: it mirrors the axes instead of turning them, and rates, being "
            "right-handed, would change sign. An exchange of two axes needs one more sign: turn the sign of the row "
            "whose direction was guessed, so that the determinant is +1"
        )
    return matrix


def doubts(camera: Camera) -> list[str]:
    """Return a sentence for each value that is a guess, or probably a mistake, with the probable intent."""
    found = mistakes(camera)
    if camera.readout_sd > 0:
        ms, sd = 1e3 * camera.readout_time, 1e3 * camera.readout_sd
        found.append(
            f"the readout time is unknown: {ms:.3g} ± {sd:.2g} ms is assumed, which a refinement corrects by the "
            "picture; give it if you know it, and 0 for a global shutter"
        )
    return found


def mistakes(camera: Camera) -> list[str]:
    """Return a sentence for each value whose unit is probably another one."""
    found, (fx, fy), seconds = [], camera.focal_length, camera.readout_time
    # Along the longer side, without distortion.
    view = math.degrees(2 * math.atan(max(camera.width / fx, camera.height / fy) / 2))
    if camera.distortion_model != "fisheye" and view > WIDEST:
        found.append(
            f"a focal length of {min(fx, fy):g} px means a field of view of {view:.1f} degrees; is it in mm? It must "
            "be in px: divide it by the width of a pixel on the sensor; a 35 mm equivalent of "
            f"{min(fx, fy):g} mm means {focal35_px(min(fx, fy), camera.width, camera.height):.0f} px"
        )
    if seconds > LONGEST_READOUT:
        found.append(f"a readout time of {seconds:g} s is longer than that of any camera; did you mean {seconds:g} ms?")
    return found
