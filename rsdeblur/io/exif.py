"""EXIF: exposure, camera data and time of a photo; and its block, renewed for a result and copied into TIFF files.

Sizes, orientation and thumbnail are renewed where they are, so that offsets in makers' notes stay true.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Collection
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from mmap import mmap
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from PIL.ExifTags import IFD, Base
from tifffile import TIFF

from rsdeblur.errors import ClockError, InputError
from rsdeblur.motion.gyro import GyroLog

MAKE, MODEL, ZOOM = Base.Make, Base.Model, Base.DigitalZoomRatio
# mm: diagonal of a 36 x 24 mm film frame, to which the 35 mm equivalent refers.
FILM_DIAGONAL = 43.267
# Errors that damaged blocks raise.
DAMAGE = (SyntaxError, ValueError, TypeError, LookupError, struct.error, OSError)


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
ZONES = [quarter * 900 * SECOND_NS for quarter in range(-48, 57)]
# Time in EXIF minus the start of the exposure, s: cameras write the command, the end or the storing of the picture, and
# some whole seconds only.
EXIF_ERROR = (-2.0, 1.0)


class CaptureTime(NamedTuple):
    """Time of a photo: Unix time, or its local time as if that were UTC, in ns."""

    ns: int
    has_zone: bool


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
    return f"{_shown(time.ns)}.{time.ns // 1_000_000 % 1000:03d} {'UTC' if time.has_zone else 'local time'}"


def on_clock_of(time: CaptureTime, log: GyroLog) -> int:
    """Return the Unix time of a photo in ns; without a time zone, in the one zone in which the log covers the photo."""
    first, last = (log.epoch_ns + round(end * SECOND_NS) for end in log.span)
    # Timestamps before the year 2000 are not Unix time: clocks of phones count from their start.
    if first < 946_684_800 * SECOND_NS:
        raise ClockError("the timestamps of the log are not Unix time, so the time in EXIF has no place on its clock")
    early, late = (round(error * SECOND_NS) for error in EXIF_ERROR)
    times = [time.ns] if time.has_zone else [time.ns - zone for zone in ZONES]
    fitting = [ns for ns in times if first + early <= ns <= last + late]
    if len(fitting) != 1:
        what = "several time zones fit" if fitting else "the log does not cover it"
        zone = "" if time.has_zone else ", local time"
        raise ClockError(
            f"the photo was taken at {_shown(time.ns)}{zone} by its EXIF block, the log spans {_shown(first)} to "
            f"{_shown(last)} UTC: {what}; give --start-ns"
        )
    return fitting[0]


def _shown(ns: int) -> str:
    return datetime.fromtimestamp(ns // SECOND_NS, UTC).strftime("%Y-%m-%d %H:%M:%S")


PREFIX = b"Exif\0\0"
ORIENTATION = Base.Orientation
# Kinds of whole numbers in TIFF.
SHORT, LONG = 3, 4
# Tables that the tables of a block point to.
POINTERS: dict[int | None, tuple[int, ...]] = {None: (IFD.Exif, IFD.GPSInfo), IFD.Exif: (IFD.Interop,)}
# Values by tag: their kind, their number, and their bytes, least significant first; or the values of another table.
Tags = dict[int, "tuple[int, int, bytes] | Tags"]


class _Directory:
    """A directory in the bytes of a block or of a TIFF file, whose entries may be changed in place."""

    def __init__(self, data: bytes | bytearray | mmap, start: int | None = None) -> None:
        if bytes(data[:4]) not in (b"II*\0", b"MM\0*"):
            raise ValueError("it does not begin like TIFF")
        self.data: Any = data
        self.order = "<" if data[:2] == b"II" else ">"
        start = self.unpack("I", 4) if start is None else start
        self.end = start + 2 + 12 * self.unpack("H", start)
        self.places = {self.unpack("H", place): place for place in range(start + 2, self.end, 12)}

    def unpack(self, kind: str, place: int) -> int:
        return int(struct.unpack_from(self.order + kind, self.data, place)[0])

    def number(self, tag: int) -> int:
        """Return a whole number; 0 if it is missing."""
        place = self.places.get(tag)
        kind = self.unpack("H", place + 2) if place is not None else 0
        if place is None or kind not in (SHORT, LONG, 13):  # 13: the place of a table
            return 0
        return self.unpack("H" if kind == SHORT else "I", place + 8)

    def set(self, tag: int, kind: int, value: int) -> None:
        """Change a number that is there."""
        if (place := self.places.get(tag)) is not None:
            form = "HHI" + ("I" if kind == LONG else "Hxx")
            struct.pack_into(self.order + form, self.data, place, tag, kind, 1, value)

    def scale(self, tag: int, by: Fraction) -> None:
        """Multiply a ratio of two numbers that is there."""
        if (entry := self.places.get(tag)) is None:
            return
        place = self.unpack("I", entry + 8)
        above, below = struct.unpack_from(f"{self.order}II", self.data, place)
        scaled = (Fraction(above, below or 1).limit_denominator(10**6) * by).limit_denominator(10_000)
        if below and scaled.numerator < 2**32:
            struct.pack_into(f"{self.order}II", self.data, place, *scaled.as_integer_ratio())

    def value(self, tag: int) -> tuple[int, int, bytes]:
        """Return kind, number and bytes of the values of a tag."""
        entry = self.places[tag]
        kind, count = self.unpack("H", entry + 2), self.unpack("I", entry + 4)
        form = TIFF.DATA_FORMATS[kind]
        size = count * struct.calcsize(f"={form}")
        place = entry + 8 if size <= 4 else self.unpack("I", entry + 8)
        if place + size > len(self.data):
            raise ValueError("a value lies beyond the end")
        unit = struct.calcsize(f"={form[-1]}")
        values = np.frombuffer(self.data[place : place + size], f"{self.order}u{unit}")
        return kind, count, values.astype(f"<u{unit}").tobytes()

    def tags(self, wanted: Collection[int] | None = None, table: int | None = None) -> Tags:
        """Return the values of all or the `wanted` tags and of the tables behind them, without what is damaged."""
        found: Tags = {}
        size = 0
        for tag in self.places:
            with suppress(*DAMAGE):
                if tag in POINTERS.get(table, ()):
                    if start := self.number(tag):
                        found[tag] = _Directory(self.data, start).tags(None, tag)
                elif wanted is None or tag in wanted:
                    found[tag] = value = self.value(tag)
                    size += len(value[2])
            if size > len(self.data):
                raise ValueError("values of its tags overlap")
        return {tag: value for tag, value in found.items() if value}


def tags_of(data: bytes | mmap, wanted: Collection[int] | None = None) -> Tags:
    """Return the tags of an EXIF block or of a classic TIFF file, or only the `wanted` ones of the first directory.

    Raises ValueError, LookupError or `struct.error` if the first directory is damaged.
    """
    return _Directory(data[len(PREFIX) :] if data[: len(PREFIX)] == PREFIX else data).tags(wanted)


def directory(tags: Tags, start: int) -> bytes:
    """Return a directory as it is written at the even offset `start`, with its values and tables behind it."""
    entries, body = struct.pack("<H", len(tags)), b""
    for tag, value in sorted(tags.items()):
        place = start + 6 + 12 * len(tags) + len(body)
        if isinstance(value, dict):
            kind, count, data, behind = LONG, 1, struct.pack("<I", place), directory(value, place)
        else:
            kind, count, data = value
            behind = data + bytes(len(data) % 2) if len(data) > 4 else b""
            data = struct.pack("<I", place) if behind else data.ljust(4, b"\0")
        entries += struct.pack("<HHI", tag, kind, count) + data
        body += behind
    return entries + bytes(4) + body


def block_of(tags: Tags) -> bytes:
    """Return an EXIF block with these tags."""
    return PREFIX + b"II*\0\x08\0\0\0" + directory(tags, 8)


def with_orientation(exif: bytes | None, orientation: int) -> bytes:
    """Return the EXIF block with another orientation; a new block if it is missing or damaged."""
    data, tags = bytearray((exif or b"").removeprefix(PREFIX)), Tags()
    with suppress(*DAMAGE):
        main = _Directory(data)
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
        main = _Directory(data)
        main.set(Base.ImageWidth, LONG, width)
        main.set(Base.ImageLength, LONG, height)
        if table := main.number(IFD.Exif):
            camera = _Directory(data, table)
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


def _renew_thumbnail(main: _Directory, draw: Callable[[int], bytes | None]) -> None:
    """Put a new thumbnail into the place of the old one; remove the second directory if none fits."""
    data = main.data
    start = main.unpack("I", main.end) if len(data) >= main.end + 4 else 0
    if not 0 < start < len(data) - 2:
        return
    second = _Directory(data, start)
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
