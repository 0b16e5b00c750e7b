"""Pictures with their metadata, which are found in files of each format, and renewed for a result; photos' EXIF blocks.

The orientation is changed where it is in an EXIF block, so that offsets in makers' notes stay true.
"""

import math
import struct
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any, Literal, NamedTuple

from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import IFD, Base

from rsdeblur._util.binary import DAMAGE, ORIENTATION, PREFIX, SHORT, Directory, Tags, block_of, tags_of
from rsdeblur._util.one_line import one_line
from rsdeblur.errors import ClockError, InputError, RsdeblurWarning
from rsdeblur.image.transfer import linear_profile
from rsdeblur.motion.camera_values import focal35_px
from rsdeblur.motion.gyro import GyroLog

# Bytes that show, in a file or its XMP packet, parts that fit the original only: C2PA manifest, HDR gain map, pictures
# behind the photo (MPF), video of a motion photo, extended XMP packet, depth maps, sounds, thumbnails.
PARTS = (
    *(b"jumdc2pa", b"hdrgm:", b"HDRGainMap:", b'"GainMap"', b">GainMap<", b"aux:hdrgainmap", b"\0\0tmap\0"),
    *(b"MPF\0II*\0", b"MPF\0MM\0*", b"MotionPhoto", b"MicroVideo", b"http://ns.adobe.com/xmp/extension/\0"),
    *(b"/photos/1.0/", b"/photos/dd/1.0/device/", b"HasExtendedXMP", b"xmp:Thumbnails", b"dcterms:provenance"),
)
# Blocks of metadata, and the length of the longest in a JPEG.
BLOCKS = {"exif": 65_533, "xmp": 65_502, "iptc": 65_500}

MAKE, MODEL, ZOOM = Base.Make, Base.Model, Base.DigitalZoomRatio
# Time in EXIF minus the start of the exposure, s: cameras write the command, the end or the storing of the picture.
# Some write whole seconds only, and the rest is missing.
EXIF_ERROR, WHOLE_SECOND = (-1.0, 1.0), 1.0


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    r"""A picture as stored in a file.

    Parameters
    ----------
    pixels : ndarray, shape (H, W) or (H, W, C)
        Samples: uint8 or uint16 of full range, or float32. C is 2 for grey and alpha, 3 for RGB, 4 for RGB and alpha.
    exif : bytes, optional
        The EXIF block, from its ``Exif\0\0`` prefix on.
    icc_profile : bytes, optional
        The colour profile.
    xmp : bytes, optional
        The XMP packet.
    iptc : bytes, optional
        The IPTC record.
    has_parts : bool, default False
        Whether the file has parts that fit the original only, such as gain maps and C2PA manifests.
    """

    pixels: NDArray[Any]
    exif: bytes | None = None
    icc_profile: bytes | None = None
    xmp: bytes | None = None
    iptc: bytes | None = None
    has_parts: bool = False

    @property
    def transfer(self) -> Literal["srgb", "linear"]:
        """How the values encode light: linearly if they are floats, or have the profile that raw files get here."""
        return "linear" if self.pixels.dtype.kind == "f" or self.icc_profile == linear_profile() else "srgb"


def of_info(info: Mapping[Any, Any], data: bytes, pixels: NDArray[Any], exif: bytes | None) -> Picture:
    """Return the picture of a file, whose metadata are in `info` as Pillow names them."""
    xmp = info.get("xmp")
    xmp = xmp.encode() if isinstance(xmp, str) else xmp
    if exif and not exif.startswith(PREFIX):
        exif = PREFIX + exif
    profile, iptc = info.get("icc_profile"), info.get("photoshop", {}).get(0x0404)
    has_parts = any(mark in data or mark in (xmp or b"") for mark in PARTS)
    return Picture(pixels, exif or None, profile, xmp or None, iptc or None, has_parts)


def renewed(old: Picture, pixels: NDArray[Any], kind: str) -> Picture:
    """Return a result with the metadata of its original."""
    icc = fitting_profile(old.icc_profile, pixels, grey=kind != "WebP")
    blocks = {name: block for name in BLOCKS if (block := getattr(old, name))}
    if "exif" in blocks:
        blocks["exif"] = without_thumbnail(blocks["exif"])
    losses = []
    if old.has_parts:
        losses.append("parts that fit the original only (C2PA manifest, gain map, video, depth map or other pictures)")
    if any(part in blocks.get("xmp", b"") for part in PARTS):
        losses.append("the XMP packet, which describes such parts")
        del blocks["xmp"]
    unfit = [name for name, block in blocks.items() if not _fits(name, block, kind)]
    losses += [f"the {name.upper()} block, which is damaged or has no room in {kind} files" for name in unfit]
    if losses:
        warnings.warn(f"left out of the result: {'; '.join(losses)}", RsdeblurWarning, stacklevel=3)
    kept: dict[str, Any] = {name: None if name in unfit else blocks.get(name) for name in BLOCKS}
    return replace(old, pixels=pixels, icc_profile=icc, **kept)


def fitting_profile(icc: bytes | None, pixels: NDArray[Any], *, grey: bool = True) -> bytes | None:
    """Return the profile if its colour space (bytes 16 to 20) is that of `pixels`; `grey`: the file can be grey."""
    space = b"GRAY" if grey and (pixels.ndim == 2 or pixels.shape[2] == 2) else b"RGB "
    return icc if icc and icc[16:20] == space else None


def _fits(name: str, block: bytes, kind: str) -> bool:
    """Whether a file of a kind can hold a block of metadata."""
    if kind == "TIFF" and name == "exif":
        try:
            tags_of(block)
        except DAMAGE:
            return False
    if kind == "JPEG":
        return len(block) <= BLOCKS[name]
    return kind != "NumPy" and not (name == "iptc" and kind in ("PNG", "WebP"))


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


class CaptureTime(NamedTuple):
    """Time of a photo: Unix time, or its local time as if that were UTC, in ns."""

    ns: int
    has_zone: bool

    @property
    def error(self) -> tuple[float, float]:
        """First and last difference from the start of the exposure that is possible, s."""
        early, late = EXIF_ERROR
        return (early if self.ns % 10**9 else early - WHOLE_SECOND), late


def capture_time(exif: Exif, name: str = "") -> CaptureTime:
    """Return the time of a photo: DateTimeOriginal, or its name if that is Unix time in ms, as of Sensor Logger."""
    if Base.DateTimeOriginal not in exif.camera and len(name) == 13 and name.isascii() and name.isdigit():
        return CaptureTime(int(name) * 1_000_000, True)
    try:
        local = datetime.strptime(exif.text(Base.DateTimeOriginal) or "", "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
        # Cameras whose clock is not set write the year 0 or 1, and 64 bits of ns end in 2262.
        if not 1900 <= local.year < 2262:
            raise ValueError
    except ValueError:
        raise InputError("the EXIF block contains no DateTimeOriginal; give --start or --start-ns") from None
    digits = exif.text(Base.SubsecTimeOriginal) or ""
    fraction = int(digits[:9].ljust(9, "0")) if digits.isascii() and digits.isdigit() else 0
    ns = round(local.timestamp()) * 10**9 + fraction
    with suppress(ValueError):
        zone = datetime.strptime(exif.text(Base.OffsetTimeOriginal) or "", "%z").utcoffset() or timedelta()
        return CaptureTime(ns - round(zone.total_seconds()) * 10**9, True)
    return CaptureTime(ns, False)


def on_clock_of(time: CaptureTime, log: GyroLog) -> int:
    """Return the Unix time of a photo in ns; without a time zone, in the one zone in which the log covers the photo."""
    first, last = (log.epoch_ns + round(end * 10**9) for end in log.span)
    # Timestamps before the year 2000 are not Unix time: clocks of phones count from their start.
    if first < 946_684_800 * 10**9:
        raise ClockError("the timestamps of the log are not Unix time, so the time in EXIF has no place on its clock")
    early, late = (round(error * 10**9) for error in time.error)
    # Time zones differ from UTC by multiples of a quarter of an hour, from -12 to +14 hours.
    quarters = range(1) if time.has_zone else range(-48, 57)
    times = [time.ns - quarter * 900 * 10**9 for quarter in quarters]
    fitting = [ns for ns in times if first + early <= ns <= last + late]
    if len(fitting) != 1:
        what = "several time zones fit" if fitting else "the log does not cover it"
        zone = "" if time.has_zone else ", local time"
        raise ClockError(
            f"the photo was taken at {shown(time.ns)}{zone} by its EXIF block, the log spans {shown(first)} to "
            f"{shown(last)} UTC: {what}; give --start-ns"
        )
    return fitting[0]


def shown(ns: int) -> str:
    """Return a Unix time in ns as text, UTC."""
    return datetime.fromtimestamp(ns // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S")


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
        if (place := main.places.get(ORIENTATION)) is not None:
            struct.pack_into(f"{main.order}HHIHxx", data, place, ORIENTATION, SHORT, 1, orientation)
            return PREFIX + bytes(data)
        tags = main.tags()
    return block_of(tags | {ORIENTATION: (SHORT, 1, struct.pack("<H", orientation))})


def without_thumbnail(exif: bytes) -> bytes:
    """Return an EXIF block without the second directory, which contains a thumbnail of the blurred photo."""
    prefix, data = exif[: len(exif) - len(exif.removeprefix(PREFIX))], bytearray(exif.removeprefix(PREFIX))
    with suppress(*DAMAGE):
        main = Directory(data)
        if 0 < main.unpack("I", main.end) < len(data):
            data[main.end : main.end + 4] = bytes(4)
    return prefix + bytes(data)
