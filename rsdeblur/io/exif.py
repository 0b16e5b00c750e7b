"""EXIF: exposure, camera data and time of a photo; and its block, renewed for a result and copied into TIFF files.

Sizes, orientation and thumbnail are renewed where they are, so that offsets in makers' notes stay true.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from typing import Any

from PIL import Image
from PIL.ExifTags import IFD, Base

from rsdeblur._util.binary import DAMAGE, LONG, ORIENTATION, PREFIX, SHORT, Directory, Tags, block_of
from rsdeblur.errors import InputError
from rsdeblur.motion.camera_values import focal35_px
from rsdeblur.motion.wall_clock import SECOND_NS, CaptureTime, shown

MAKE, MODEL, ZOOM = Base.Make, Base.Model, Base.DigitalZoomRatio


class Exif:
    """Valid tags of an EXIF block; `None` where a tag is missing or malformed."""

    def __init__(self, block: bytes | None) -> None:
        self.main: Any = Image.Exif()
        self.camera: dict[int, Any] = {}
        try:
            if block:
                self.main.load(block)
            self.camera = dict(self.main.get_ifd(IFD.Exif))
        except DAMAGE:
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
        """Return a tag of the main or the camera's directory that is text."""
        value = self.main.get(tag, self.camera.get(tag))
        return value.replace("\0", "").strip() or None if isinstance(value, str) else None

    @property
    def exposure(self) -> float | None:
        """Exposure time in s."""
        return self.number(Base.ExposureTime)

    @property
    def orientation(self) -> int:
        """How viewers turn the stored picture: 1 (not at all) to 8."""
        value = self.main.get(Base.Orientation)
        return value if isinstance(value, int) and 1 <= value <= 8 else 1

    def focal_px(self, width: int, height: int) -> tuple[float, str]:
        """Return the focal length in px of a picture of that size, and its origin in words."""
        film = self.number(Base.FocalLengthIn35mmFilm)
        if film:
            return focal35_px(film, width, height), f"35 mm equivalent {film:g} mm"
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


def capture_time(exif: Exif) -> CaptureTime:
    """Return the time at which a photo was taken: DateTimeOriginal, its fraction and its offset."""
    try:
        local = datetime.strptime(exif.text(Base.DateTimeOriginal) or "", "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        # Cameras whose clock is not set write the year 0 or 1, and 64 bits of ns end in 2262.
        if not 1900 <= local.year < 2262:
            raise ValueError
    except ValueError:
        raise InputError("the EXIF block contains no DateTimeOriginal; give --start or --start-ns") from None
    digits = exif.text(Base.SubsecTimeOriginal) or ""
    fraction = int(digits[:9].ljust(9, "0")) if digits.isascii() and digits.isdigit() else 0
    ns = round(local.timestamp()) * SECOND_NS + fraction
    with suppress(ValueError):
        zone = datetime.strptime(exif.text(Base.OffsetTimeOriginal) or "", "%z").utcoffset() or timedelta()
        return CaptureTime(ns - round(zone.total_seconds()) * SECOND_NS, True)
    return CaptureTime(ns, False)


def shown_time(exif: Exif) -> str | None:
    """Return the time at which a photo was taken, as text; None if the block has none."""
    try:
        time = capture_time(exif)
    except InputError:
        return None
    return f"{shown(time.ns)}.{time.ns // 1_000_000 % 1000:03d} {'UTC' if time.has_zone else 'local time'}"


def with_orientation(exif: bytes | None, orientation: int) -> bytes:
    """Return the EXIF block with another orientation; a new block if it is missing or damaged."""
    data, tags = bytearray((exif or b"").removeprefix(PREFIX)), Tags()
    with suppress(*DAMAGE):
        main = Directory(data)
        if ORIENTATION in main.places:
            main.set(ORIENTATION, SHORT, orientation)
            return PREFIX + bytes(data)
        tags = main.tags()
    return block_of(tags | {ORIENTATION: (SHORT, 1, struct.pack("<H", orientation))})


def renewed(exif: bytes, width: int, height: int, draw: Callable[[int], bytes | None]) -> bytes:
    """Return an EXIF block for a picture of this size in px, with the thumbnail that `draw` returns.

    `draw` gets the most bytes of a JPEG. Where it returns None, the old thumbnail is removed.
    """
    prefix, data = exif[: len(exif) - len(exif.removeprefix(PREFIX))], bytearray(exif.removeprefix(PREFIX))
    try:
        main = Directory(data)
        main.set(Base.ImageWidth, LONG, width)
        main.set(Base.ImageLength, LONG, height)
        if table := main.number(IFD.Exif):
            camera = Directory(data, table)
            for tag, plane, side in (
                (Base.ExifImageWidth, Base.FocalPlaneXResolution, width),
                (Base.ExifImageHeight, Base.FocalPlaneYResolution, height),
            ):
                if (before := camera.number(tag)) not in (0, side):
                    camera.scale(plane, Fraction(side, before))
                camera.set(tag, LONG, side)
        _renew_thumbnail(main, draw)
    except DAMAGE:
        return exif
    return prefix + bytes(data)


def _renew_thumbnail(main: Directory, draw: Callable[[int], bytes | None]) -> None:
    """Put a new thumbnail into the place of the old one; remove the second directory if none fits."""
    data = main.data
    start = main.unpack("I", main.end) if len(data) >= main.end + 4 else 0
    if not 0 < start < len(data) - 2:
        return
    second = Directory(data, start)
    place = second.number(Base.JpegIFOffset)
    length = min(second.number(Base.JpegIFByteCount), len(data) - place)
    new = None
    if length > 0:
        if place <= main.end:
            raise ValueError("the thumbnail claims the bytes of the first directory")
        new = draw(length)
        data[place : place + length] = (new or b"").ljust(length, b"\0")
    if new is None:
        struct.pack_into("4s", data, main.end, bytes(4))
    else:
        second.set(Base.JpegIFByteCount, LONG, len(new))
