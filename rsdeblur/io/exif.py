"""Exposure, camera data and time in a picture's EXIF block."""

from __future__ import annotations

import math
import struct
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from PIL import Image
from PIL.ExifTags import GPS, IFD, Base

from rsdeblur.errors import ClockError, InputError
from rsdeblur.motion.gyro import GyroLog

MAKE, MODEL, ZOOM = Base.Make, Base.Model, Base.DigitalZoomRatio
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
            self.camera = dict(self.main.get_ifd(IFD.Exif))
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
        return self.number(Base.ExposureTime)

    @property
    def iso(self) -> float | None:
        """ISO sensitivity."""
        return self.number(Base.ISOSpeedRatings)

    @property
    def orientation(self) -> int:
        """How viewers turn the stored picture: 1 (not at all) to 8."""
        value = self.main.get(Base.Orientation)
        return value if isinstance(value, int) and 1 <= value <= 8 else 1

    def focal_px(self, width: int, height: int) -> tuple[float, str]:
        """Return the focal length in px of a picture of that size, and its origin in words."""
        film = self.number(Base.FocalLengthIn35mmFilm)
        if film:
            return film / FILM_DIAGONAL * math.hypot(width, height), f"35 mm equivalent {film:g} mm"
        focal_length, resolution = self.number(Base.FocalLength), self.number(Base.FocalPlaneXResolution)
        # None (which means inch), inch, cm, mm, um.
        units = {1: 25.4, 2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
        millimetres = units.get(int(self.number(Base.FocalPlaneResolutionUnit) or 2))
        if focal_length and resolution and millimetres:
            across = self.number(Base.ExifImageWidth) or max(width, height)
            sensor = across * millimetres / resolution
            # From the smallest phone cameras to medium format.
            if not 2 < sensor < 60:
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


SECOND_NS = 10**9
# Time zones differ from UTC by multiples of a quarter of an hour, from -12 to +14 hours.
QUARTER_NS = 900 * SECOND_NS
QUARTERS = range(-48, 57)
# Time in EXIF minus the start of the exposure, s: cameras write the command, the end or the storing of the picture, and
# some whole seconds only.
EXIF_ERROR = (-2.0, 1.0)


class CaptureTime(NamedTuple):
    """Time of a photo: Unix time, or its local time as if that were UTC, in ns."""

    ns: int
    has_zone: bool


def capture_time(exif: Exif) -> CaptureTime:
    """Return the time at which a photo was taken: DateTimeOriginal, its fraction, and its offset or that of the GPS."""
    try:
        local = datetime.strptime(_text(exif, Base.DateTimeOriginal), "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        # Cameras whose clock is not set write the year 0 or 1, and 64 bits of ns end in 2262.
        if not 1900 <= local.year < 2262:
            raise ValueError
    except ValueError:
        raise InputError("the EXIF block contains no DateTimeOriginal; give --start or --start-ns") from None
    digits = _text(exif, Base.SubsecTimeOriginal)
    fraction = int(digits[:9].ljust(9, "0")) if digits.isascii() and digits.isdigit() else 0
    ns = round(local.timestamp()) * SECOND_NS + fraction
    with suppress(ValueError):
        zone = datetime.strptime(_text(exif, Base.OffsetTimeOriginal), "%z").utcoffset()
        return CaptureTime(ns - round((zone or timedelta()).total_seconds()) * SECOND_NS, True)
    fix = _gps_time(exif)
    if fix is not None:
        quarters = round((ns - fix) / QUARTER_NS)
        # A fix may be up to 300 s older than the photo.
        if quarters in QUARTERS and abs(ns - quarters * QUARTER_NS - fix) < 300 * SECOND_NS:
            return CaptureTime(ns - quarters * QUARTER_NS, True)
    return CaptureTime(ns, False)


def shown_time(exif: Exif) -> str | None:
    """Return the time at which a photo was taken, as text; None if the block has none."""
    try:
        time = capture_time(exif)
    except InputError:
        return None
    return f"{_shown(time.ns)}.{time.ns // 1_000_000 % 1000:03d} {'UTC' if time.has_zone else 'local time'}"


def on_clock_of(time: CaptureTime, log: GyroLog) -> int:
    """Return the Unix time of a photo in ns; without a time zone, in the one zone in which the log covers the photo."""
    first, last = (log.epoch_ns + round(end * SECOND_NS) for end in log.span)
    # Timestamps before the year 2000 are not Unix time: clocks of phones count from their start.
    if first < 946_684_800 * SECOND_NS:
        raise ClockError("the timestamps of the log are not Unix time, so the time in EXIF has no place on its clock")
    zones = [quarter * QUARTER_NS for quarter in QUARTERS] if not time.has_zone else [0]
    early, late = (round(error * SECOND_NS) for error in EXIF_ERROR)
    fitting = [time.ns - zone for zone in zones if first + early <= time.ns - zone <= last + late]
    if len(fitting) != 1:
        what = "several time zones fit" if fitting else "the log does not cover it"
        zone = "" if time.has_zone else ", local time"
        raise ClockError(
            f"the photo was taken at {_shown(time.ns)}{zone} by its EXIF block, the log spans {_shown(first)} to "
            f"{_shown(last)} UTC: {what}; give --start-ns"
        )
    return fitting[0]


def _text(exif: Exif, tag: int) -> str:
    value = exif.camera.get(tag)
    return value.replace("\0", "").strip() if isinstance(value, str) else ""


def _gps_time(exif: Exif) -> int | None:
    """Return the UTC time of the GPS fix in ns."""
    with suppress(ValueError, TypeError, ArithmeticError, LookupError, AttributeError):
        gps = exif.main.get_ifd(IFD.GPSInfo)
        day = datetime.strptime(gps[GPS.GPSDateStamp].replace("\0", "").strip(), "%Y:%m:%d").replace(tzinfo=UTC)
        hours, minutes, seconds = map(float, gps[GPS.GPSTimeStamp])
        return round(day.timestamp() + 3600 * hours + 60 * minutes + seconds) * SECOND_NS
    return None


def _shown(ns: int) -> str:
    return datetime.fromtimestamp(ns // SECOND_NS, UTC).strftime("%Y-%m-%d %H:%M:%S")
