"""EXIF blocks: sizes, orientation and thumbnail are renewed where they are, so that offsets in makers' notes stay true.

A TIFF file holds the tables of an EXIF block as tables of its own; Pillow reads and writes them.
"""

from __future__ import annotations

import struct
import warnings
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from fractions import Fraction
from io import BytesIO
from typing import BinaryIO, Literal

from PIL.ExifTags import IFD, Base
from PIL.TiffImagePlugin import ImageFileDirectory_v2

PREFIX = b"Exif\0\0"
HEADS = (b"II*\0", b"MM\0*")
LITTLE = b"II*\0\x08\0\0\0"
EXIF_TABLE, GPS_TABLE, INTEROP_TABLE = IFD.Exif, IFD.GPSInfo, IFD.Interop
# Tables that a table points to, by their tags; none is deeper.
TABLES: dict[int, tuple[int, ...]] = {EXIF_TABLE: (INTEROP_TABLE,), GPS_TABLE: (), INTEROP_TABLE: ()}

ORIENTATION = Base.Orientation
# Place and length of a thumbnail: a JPEG, or plain samples.
THUMBNAILS = ((513, 514), (273, 279))
ASCII, SHORT, LONG = 2, 3, 4
DAMAGE = (ValueError, TypeError, LookupError, struct.error, OSError)


class _Directory:
    """A directory in the bytes of a block, whose entries are changed in place."""

    def __init__(self, data: bytearray, start: int | None = None) -> None:
        self.data, self.order = data, "<" if data[:2] == b"II" else ">"
        if bytes(data[:4]) not in HEADS:
            raise ValueError("it does not begin like TIFF")
        start = self.unpack("I", 4) if start is None else start
        self.end = start + 2 + 12 * self.unpack("H", start)
        self.places = {self.unpack("H", place): place for place in range(start + 2, self.end, 12)}

    def unpack(self, kind: str, place: int) -> int:
        return int(struct.unpack_from(self.order + kind, self.data, place)[0])

    def number(self, tag: int) -> int:
        """Return a whole number; 0 if it is missing."""
        place = self.places.get(tag)
        kind = self.unpack("H", place + 2) if place is not None else 0
        return self.unpack("H" if kind == SHORT else "I", place + 8) if place is not None and kind in (3, 4) else 0

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
        scaled = Fraction(above, below or 1).limit_denominator(10**6) * by
        if below and scaled.limit_denominator(10_000).numerator < 2**32:
            ratio = scaled.limit_denominator(10_000).as_integer_ratio()
            struct.pack_into(f"{self.order}II", self.data, place, *ratio)


def renewed(exif: bytes, width: int, height: int, draw: Callable[[int], bytes | None]) -> bytes:
    """Return an EXIF block for a picture of this size in px, with the thumbnail that `draw` returns.

    `draw` gets the most bytes of a JPEG. Where it returns None, the old thumbnail is removed.
    """
    prefix, data = exif[: len(exif) - len(exif.removeprefix(PREFIX))], bytearray(exif.removeprefix(PREFIX))
    try:
        main = _Directory(data)
        main.set(Base.ImageWidth, LONG, width)
        main.set(Base.ImageLength, LONG, height)
        if table := main.number(EXIF_TABLE):
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
    is_drawn = False
    for place_tag, length_tag in THUMBNAILS:
        place, length = second.number(place_tag), second.number(length_tag)
        if not length or place >= len(data):
            continue
        if place <= main.end:
            raise ValueError("the thumbnail claims the bytes of the first directory")
        length = min(length, len(data) - place)
        new = draw(length) if place_tag == THUMBNAILS[0][0] else None
        data[place : place + length] = (new or b"").ljust(length, b"\0")
        if new is not None:
            second.set(length_tag, LONG, len(new))
            is_drawn = True
    if not is_drawn:
        struct.pack_into("4s", data, main.end, bytes(4))


def with_orientation(exif: bytes | None, orientation: int) -> bytes:
    """Return the EXIF block with another orientation; a new block if it is missing or damaged."""
    prefix, data = PREFIX, bytearray((exif or b"").removeprefix(PREFIX))
    try:
        main = _Directory(data)
        if ORIENTATION in main.places:
            main.set(ORIENTATION, SHORT, orientation)
            return prefix + bytes(data)
        table = of_block(bytes(data))
    except DAMAGE:
        table = Table(ImageFileDirectory_v2(LITTLE))
    table.ifd[ORIENTATION] = orientation
    return table.block()


@dataclass(frozen=True, slots=True)
class Table:
    """A directory of TIFF, least significant byte first, and those that it points to, by tag.

    `missing` counts tags that are damaged or of an unknown kind, and therefore not in it.
    """

    ifd: ImageFileDirectory_v2
    tables: dict[int, Table] = field(default_factory=dict)
    missing: int = 0

    @property
    def loss(self) -> str:
        """The missing tags in words; empty if there are none."""
        count = self.missing + sum(table.missing for table in self.tables.values())
        return f"{count} tags of the EXIF block that are damaged or of an unknown kind" if count else ""

    def to_bytes(self, start: int) -> bytes:
        """Return the directory as it is written at the even offset `start`, followed by those that it points to."""
        for tag in self.tables:
            self.ifd.tagtype[tag] = LONG
            self.ifd[tag] = 0
        end, body = start + len(self.ifd.tobytes(start)), b""
        for tag, table in self.tables.items():
            self.ifd[tag] = end + len(body)
            body += table.to_bytes(end + len(body))
        return self.ifd.tobytes(start) + body

    def block(self) -> bytes:
        """Return an EXIF block."""
        return PREFIX + LITTLE + self.to_bytes(len(LITTLE))


def of_block(exif: bytes, wanted: Collection[int] | None = None) -> Table:
    """Return the first directory of an EXIF block; see `read`."""
    return read(BytesIO(exif.removeprefix(PREFIX)), wanted)


def read(file: BinaryIO, wanted: Collection[int] | None = None) -> Table:
    """Return the first directory of a classic TIFF file, or only the `wanted` tags of it; ValueError if it is none."""
    file.seek(0)
    head = file.read(8)
    if head[:4] not in HEADS or len(head) < 8:
        raise ValueError("it does not begin like TIFF")
    (start,) = struct.unpack(("<" if head[:2] == b"II" else ">") + "I", head[4:])
    return _read(file, head, start, (EXIF_TABLE, GPS_TABLE), wanted)


def _read(file: BinaryIO, head: bytes, start: int, pointers: Collection[int], wanted: Collection[int] | None) -> Table:
    found, ifd, tables = ImageFileDirectory_v2(head), ImageFileDirectory_v2(LITTLE), dict[int, Table]()
    file.seek(start)
    order: Literal["little", "big"] = "little" if head[:2] == b"II" else "big"
    entries = file.read(12 * int.from_bytes(file.read(2), order))
    # Some cameras write tags without a value.
    missing = sum(any(entries[at + 4 : at + 8]) for at in range(0, len(entries), 12))
    file.seek(start)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found.load(file)
        for tag in found:
            try:
                value = found[tag]
                if tag in pointers:
                    inner = _read(file, head, int(value), TABLES[tag], None)
                    tables[tag] = inner
                elif wanted is None or tag in wanted:
                    ifd.tagtype[tag] = found.tagtype[tag]
                    # Pillow reads texts as Latin-1, which keeps their bytes, and would write them as ASCII.
                    ifd[tag] = value.encode("latin-1") if isinstance(value, str) else value
                missing -= 1
            except DAMAGE:
                continue
    return Table(ifd, {tag: table for tag, table in tables.items() if len(table.ifd)}, missing)
