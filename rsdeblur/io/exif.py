"""Exposure and camera data in a picture's EXIF block."""

from __future__ import annotations

import math
import struct
from typing import Any

from PIL import Image

from rsdeblur.errors import InputError

CAMERA_IFD = 0x8769
MAKE, MODEL, ORIENTATION = 0x010F, 0x0110, 0x0112
EXPOSURE_TIME, SENSITIVITY, FOCAL_LENGTH, FOCAL_LENGTH_35 = 0x829A, 0x8827, 0x920A, 0xA405
PLANE_RESOLUTION, PLANE_UNIT, PIXELS_ACROSS, ZOOM = 0xA20E, 0xA210, 0xA002, 0xA404

# mm per unit of the focal plane's resolution: none (which means inch), inch, cm, mm, um.
PLANE_UNITS = {1: 25.4, 2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
# mm: the smallest phone cameras, and medium format.
SENSOR_WIDTHS = (2.0, 60.0)
# mm: diagonal of a 36 x 24 mm film frame, to which the 35 mm equivalent refers.
FILM_DIAGONAL = 43.267


class Exif:
    """Valid tags of an EXIF block; `None` where a tag is missing or malformed."""

    def __init__(self, block: bytes | None) -> None:
        self.main: Any = Image.Exif()
        self.camera: dict[int, Any] = {}
        try:
            if block:
                self.main.load(block)
            self.camera = dict(self.main.get_ifd(CAMERA_IFD))
        except (SyntaxError, ValueError, TypeError, LookupError, struct.error, OSError):
            self.main = Image.Exif()

    def number(self, tag: int) -> float | None:
        """Return a tag of the camera's directory that is a positive number."""
        try:
            value = self.camera[tag]
            number = float(value[0] if isinstance(value, tuple) else value)
        except (KeyError, TypeError, ValueError, ZeroDivisionError, IndexError):
            return None
        return number if math.isfinite(number) and number > 0 else None

    def text(self, tag: int) -> str | None:
        """Return a tag of the main directory that is text."""
        value = self.main.get(tag)
        return value.replace("\0", "").strip() or None if isinstance(value, str) else None

    @property
    def exposure(self) -> float | None:
        """Exposure time in s."""
        return self.number(EXPOSURE_TIME)

    @property
    def iso(self) -> float | None:
        """ISO sensitivity."""
        return self.number(SENSITIVITY)

    @property
    def orientation(self) -> int:
        """How viewers turn the stored picture: 1 (not at all) to 8."""
        value = self.main.get(ORIENTATION)
        return value if isinstance(value, int) and 1 <= value <= 8 else 1

    def focal_px(self, width: int, height: int) -> tuple[float, str]:
        """Return the focal length in px of a picture of that size, and its origin in words."""
        film = self.number(FOCAL_LENGTH_35)
        if film:
            return film / FILM_DIAGONAL * math.hypot(width, height), f"35 mm equivalent {film:g} mm"
        focal_length, resolution = self.number(FOCAL_LENGTH), self.number(PLANE_RESOLUTION)
        millimetres = PLANE_UNITS.get(int(self.number(PLANE_UNIT) or 2))
        if focal_length and resolution and millimetres:
            across = self.number(PIXELS_ACROSS) or max(width, height)
            low, high = SENSOR_WIDTHS
            sensor = across * millimetres / resolution
            if not low < sensor < high:
                raise InputError(
                    f"the picture was resized since it was taken: its EXIF block implies a sensor {sensor:.3g} mm wide"
                )
            # The resolution refers to the picture as the camera took it.
            scale = max(width, height) / across
            return (
                focal_length * resolution / millimetres * scale,
                f"{focal_length:g} mm at {resolution / millimetres:.1f} px/mm",
            )
        raise InputError(
            "EXIF contains no focal length in px: neither the 35 mm equivalent nor the focal plane's resolution"
            + (f", only {focal_length:g} mm" if focal_length else "")
        )
