"""Directories of TIFF, of which EXIF blocks consist too: read and written without a change to any value.

Pillow decodes texts as Latin-1, writes them as ASCII, and copies pointers to further directories as numbers.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from io import BytesIO
from typing import BinaryIO, NamedTuple

PREFIX = b"Exif\0\0"
EXIF_TABLE, GPS_TABLE, INTEROP_TABLE = 34665, 34853, 40965
# Directories that a directory points to, by their tags; none is deeper.
TABLES = {EXIF_TABLE: (INTEROP_TABLE,), GPS_TABLE: (), INTEROP_TABLE: ()}
MAIN_TABLES = (EXIF_TABLE, GPS_TABLE)

ORIENTATION = 274
WIDTH, HEIGHT, EXIF_WIDTH, EXIF_HEIGHT = 256, 257, 0xA002, 0xA003
# Pixels per unit of length on the sensor.
PLANE_X, PLANE_Y = 0xA20E, 0xA20F
# Tags of a thumbnail: places and lengths, of a JPEG and of plain samples.
THUMBNAILS = ((513, 514), (273, 279))

# Bytes of a value, and of each number in it, by TIFF's types; 129 is the text of EXIF 3.
ASCII, SHORT, LONG, RATIONAL, IFD = 2, 3, 4, 5, 13
SIZES = {1: (1, 1), ASCII: (1, 1), SHORT: (2, 2), LONG: (4, 4), RATIONAL: (8, 4), 6: (1, 1), 7: (1, 1), 8: (2, 2)}
SIZES |= {9: (4, 4), 10: (8, 4), 11: (4, 4), 12: (8, 8), IFD: (4, 4), 129: (1, 1)}
# Most bytes of a directory's values, which a damaged file may all let point to the same place. Makers' notes have some
# hundred kB.
LARGEST = 2**24


class Entry(NamedTuple):
    """A value: TIFF's type, the number of items and their bytes, least significant first."""

    kind: int
    items: int
    value: bytes


@dataclass(frozen=True, slots=True)
class Directory:
    """A directory of TIFF.

    Parameters
    ----------
    entries : mapping
        Values by tag.
    tables : mapping
        Directories that this one points to, by tag.
    order : {"<", ">"}
        Byte order of the file that it was read from.
    places : mapping
        Offsets of the entries there, by tag.
    end : int
        Offset there of the pointer to the next directory.
    """

    entries: Mapping[int, Entry]
    tables: Mapping[int, Directory] = field(default_factory=dict)
    order: str = "<"
    places: Mapping[int, int] = field(default_factory=dict)
    end: int = 0

    def to_bytes(self, start: int) -> bytes:
        """Return the directory as it is written at the even offset `start`, least significant byte first."""
        count = len(self.entries) + len(self.tables)
        body = start + 2 + 12 * count + 4
        heads, values = [], bytearray()
        for tag, entry in sorted({**self.entries, **dict.fromkeys(self.tables, Entry(LONG, 1, b""))}.items()):
            value = entry.value
            if tag in self.tables or len(value) > 4:
                place = body + len(values)
                values += self.tables[tag].to_bytes(place) if tag in self.tables else value
                values += b"\0" * (len(values) % 2)
                value = struct.pack("<I", place)
            heads.append(struct.pack("<HHI4s", tag, entry.kind, entry.items, value))
        return struct.pack("<H", count) + b"".join(heads) + bytes(4) + bytes(values)


def read(file: BinaryIO) -> Directory:
    """Return the first directory of a classic TIFF file, or of an EXIF block without its prefix.

    Values that lie outside the file are left out.

    Raises
    ------
    ValueError
        If the file does not begin like TIFF, or ends before the directory.
    """
    size = file.seek(0, 2)
    file.seek(0)
    head = file.read(8)
    if head[:4] not in (b"II*\0", b"MM\0*") or len(head) < 8:
        raise ValueError("it does not begin like TIFF")
    order = "<" if head[:2] == b"II" else ">"
    return _directory(file, size, order, struct.unpack(f"{order}I", head[4:])[0], MAIN_TABLES)


def _directory(file: BinaryIO, size: int, order: str, start: int, pointers: tuple[int, ...]) -> Directory:
    file.seek(start)
    data = file.read(2)
    if len(data) < 2:
        raise ValueError("it ends before its directory")
    data = file.read(12 * struct.unpack(f"{order}H", data)[0])
    end, left = start + 2 + len(data), min(size, LARGEST)
    entries: dict[int, Entry] = {}
    tables, places = dict[int, Directory](), dict[int, int]()
    for offset in range(0, len(data) - 11, 12):
        tag, kind, count, value = struct.unpack_from(f"{order}HHI4s", data, offset)
        whole, unit = SIZES.get(kind, (0, 1))
        length = whole * count
        if not 0 < length <= left or tag in entries or tag in tables:
            continue
        (place,) = struct.unpack(f"{order}I", value)
        if length > 4:
            file.seek(place)
            value = file.read(length)
        if len(value) < length:
            continue
        left -= length
        if tag in pointers:
            if kind in (LONG, IFD) and 0 < place < size - 2:
                tables[tag] = _directory(file, size, order, place, TABLES[tag])
            continue
        entries[tag] = Entry(kind, count, _little(value[:length], unit, order))
        places[tag] = start + 2 + offset
    return Directory(entries, tables, order, places, end)


def _little(value: bytes, unit: int, order: str) -> bytes:
    """Return numbers of `unit` bytes, stored in `order`, with the least significant byte first."""
    if order == "<" or unit == 1:
        return value
    return b"".join(value[i : i + unit][::-1] for i in range(0, len(value), unit))


def block(directory: Directory) -> bytes:
    """Return an EXIF block."""
    return PREFIX + b"II*\0" + struct.pack("<I", 8) + directory.to_bytes(8)


def read_block(exif: bytes) -> Directory:
    """Return the first directory of an EXIF block; ValueError if it is damaged."""
    return read(BytesIO(exif.removeprefix(PREFIX)))


def with_orientation(exif: bytes | None, orientation: int) -> bytes:
    """Return the EXIF block with another orientation; a new block if it is missing or damaged."""
    try:
        main = read_block(exif or b"")
    except ValueError:
        main = Directory({})
    if exif and ORIENTATION in main.places:
        return _edited(exif, main.order, {main.places[ORIENTATION]: (ORIENTATION, SHORT, orientation)})
    entry = Entry(SHORT, 1, struct.pack("<H", orientation))
    return block(Directory({**main.entries, ORIENTATION: entry}, main.tables))


def renewed(exif: bytes, width: int, height: int) -> bytes:
    """Return the EXIF block for a new picture of that size: without the thumbnail of the old one, and with its sizes.

    Everything else stays at its place, because makers' notes may contain offsets. A damaged block is returned as it is.
    """
    prefix = exif[: len(exif) - len(exif.removeprefix(PREFIX))]
    try:
        return prefix + _renewed(exif.removeprefix(PREFIX), width, height)
    # The second: a thumbnail that claims the bytes of the directories.
    except (ValueError, struct.error):
        return exif


def _renewed(data: bytes, width: int, height: int) -> bytes:
    main = read(BytesIO(data))
    data = _without_thumbnail(data, main)
    camera = main.tables.get(EXIF_TABLE, Directory({}))
    changes: dict[int, tuple[int, int, int]] = {}
    for directory, tag, side in (
        *((main, WIDTH, width), (main, HEIGHT, height)),
        *((camera, EXIF_WIDTH, width), (camera, EXIF_HEIGHT, height)),
    ):
        if tag in directory.places:
            changes[directory.places[tag]] = (tag, LONG, side)
    data = _edited(data, main.order, changes)
    for tag, plane, side in ((EXIF_WIDTH, PLANE_X, width), (EXIF_HEIGHT, PLANE_Y, height)):
        data = _with_resolution(data, camera, plane, side, tag)
    return data


def _edited(exif: bytes, order: str, changes: Mapping[int, tuple[int, int, int]]) -> bytes:
    """Return the block with other entries of one number: tag, type and value, by their places."""
    edited = bytearray(exif)
    shift = len(exif) - len(exif.removeprefix(PREFIX))
    for place, (tag, kind, number) in changes.items():
        value = struct.pack(f"{order}I" if kind == LONG else f"{order}Hxx", number)
        struct.pack_into(f"{order}HHI4s", edited, shift + place, tag, kind, 1, value)
    return bytes(edited)


def number(directory: Directory, tag: int) -> int:
    """Return a whole number of a directory; 0 if it is missing."""
    entry = directory.entries.get(tag, Entry(LONG, 1, b""))
    return int.from_bytes(entry.value, "little") if entry.kind in (SHORT, LONG) and entry.items == 1 else 0


def _with_resolution(data: bytes, camera: Directory, tag: int, side: int, old: int) -> bytes:
    """Return the block with the resolution on the sensor, of `tag`, of a picture that was resized from `old` px."""
    before, entry = number(camera, old), camera.entries.get(tag)
    if entry is None or (entry.kind, entry.items) != (RATIONAL, 1) or before in (0, side):
        return data
    above, below = struct.unpack("<II", entry.value)
    if not below:
        return data
    scaled = Fraction(above * side, below * before).limit_denominator(10_000)
    if scaled.numerator >= 2**32:
        return data
    (place,) = struct.unpack_from(f"{camera.order}I", data, camera.places[tag] + 8)
    edited = bytearray(data)
    struct.pack_into(f"{camera.order}II", edited, place, *scaled.as_integer_ratio())
    return bytes(edited)


def _without_thumbnail(data: bytes, main: Directory) -> bytes:
    """Return the block without the directory after the first one, and with zeros for its picture."""
    if len(data) < main.end + 4:
        return data
    edited = bytearray(data)
    (start,) = struct.unpack_from(f"{main.order}I", edited, main.end)
    struct.pack_into("4s", edited, main.end, bytes(4))
    if not 0 < start < len(data) - 2:
        return bytes(edited)
    second = _directory(BytesIO(data), len(data), main.order, start, ())
    for place_tag, length_tag in THUMBNAILS:
        place, length = number(second, place_tag), number(second, length_tag)
        if place and place + length >= len(edited) > place:
            del edited[place:]
        elif length and 0 < place < len(edited):
            edited[place : place + length] = bytes(length)
    return bytes(edited)
