"""Renewal of an EXIF block: program, date and thumbnail of the new picture, with everything else at its place.

Offsets in makers' notes count from the start of the block, so nothing of it moves: a new first directory at its end
points to the values where they are.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from datetime import UTC, datetime
from io import BytesIO

from rsdeblur.io import directories
from rsdeblur.io.directories import ASCII, EXIF_TABLE, LONG, ORIENTATION, PREFIX, RATIONAL, SHORT, Directory

SOFTWARE, DATE, COMPRESSION = 305, 306, 259
PLACE, LENGTH = directories.THUMBNAILS[0]
JPEG = 6
RESOLUTIONS, UNIT, INCH = (282, 283), 296, 2
# Texts beside the date: its offset from UTC, and its fraction of a second.
OFFSET, FRACTION = 0x9010, 0x9290


def now() -> datetime:
    """Return the time to write into files: that of SOURCE_DATE_EPOCH, for reproducible files, or else the present."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    return datetime.fromtimestamp(int(epoch), UTC) if epoch.isdecimal() else datetime.now().astimezone()


def has_thumbnail(exif: bytes) -> bool:
    """Whether the block has a second directory, which is that of a thumbnail."""
    data = exif.removeprefix(PREFIX)
    try:
        main = directories.read(BytesIO(data))
    except ValueError:
        return False
    return len(data) >= main.end + 4 and data[main.end : main.end + 4] != bytes(4)


def renewed(exif: bytes, software: str, when: datetime, thumbnail: bytes | None) -> bytes:
    """Return the block with program, date and thumbnail of the new picture; a damaged block is returned as it is.

    Parameters
    ----------
    exif : bytes
        The block, without a thumbnail.
    software : str
        Name of the program.
    when : datetime
        Time of the change, with its offset from UTC.
    thumbnail : bytes, optional
        The thumbnail as a JPEG.
    """
    prefix, data = exif[: len(exif) - len(exif.removeprefix(PREFIX))], exif.removeprefix(PREFIX)
    try:
        main = directories.read(BytesIO(data))
        camera = main.tables.get(EXIF_TABLE, Directory({}))
        data = _with_text(data, camera, OFFSET, when.strftime("%z")[:3] + ":" + when.strftime("%z")[3:])
        digits = len(camera.entries[FRACTION].value.rstrip(b"\0 ")) if FRACTION in camera.entries else 0
        data = _with_text(data, camera, FRACTION, "0" * digits)
        texts = {SOFTWARE: software.encode(), DATE: when.strftime("%Y:%m:%d %H:%M:%S").encode()}
        orientation = directories.number(main, ORIENTATION)
        return prefix + _with_directories(data, main.order, texts, thumbnail, orientation)
    except (ValueError, struct.error):
        return exif


def _with_text(data: bytes, directory: Directory, tag: int, text: str) -> bytes:
    """Return the block with another text of the same length, if it has one."""
    entry = directory.entries.get(tag)
    if entry is None or entry.kind != ASCII:
        return data
    place = directory.places[tag] + 8
    if entry.items > 4:
        (place,) = struct.unpack_from(f"{directory.order}I", data, place)
    value = text.encode()[: entry.items - 1].ljust(entry.items, b"\0")
    return data[:place] + value + data[place + entry.items :]


def _with_directories(
    data: bytes, order: str, texts: Mapping[int, bytes], thumbnail: bytes | None, orientation: int
) -> bytes:
    """Return the block with new first and second directories at its end."""
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, start)
    entries = [data[place : place + 12] for place in range(start + 2, start + 2 + 12 * count, 12)]
    kept = [entry for entry in entries if len(entry) == 12 and struct.unpack(f"{order}H", entry[:2])[0] not in texts]
    edited = bytearray(data)
    for tag, text in texts.items():
        kept.append(struct.pack(f"{order}HHII", tag, ASCII, len(text) + 1, _append(edited, text + b"\0")))
    second = 0
    if thumbnail is not None:
        place = _append(edited, thumbnail)
        heads = [(COMPRESSION, SHORT, JPEG), (PLACE, LONG, place), (LENGTH, LONG, len(thumbnail))]
        heads += [(ORIENTATION, SHORT, orientation)] if orientation else []
        # EXIF requires a resolution, and recommends 72 per inch where it is unknown.
        heads += [(UNIT, SHORT, INCH)]
        unknown = struct.pack(f"{order}II", 72, 1)
        resolutions = [struct.pack(f"{order}HHII", tag, RATIONAL, 1, _append(edited, unknown)) for tag in RESOLUTIONS]
        numbers = [_number(order, *head) for head in heads]
        second = _append(edited, _directory(order, numbers + resolutions, 0))
    struct.pack_into(f"{order}I", edited, 4, _append(edited, _directory(order, kept, second)))
    return bytes(edited)


def _append(data: bytearray, value: bytes) -> int:
    """Append a value at an even offset, and return that offset."""
    data += bytes(len(data) % 2)
    place = len(data)
    data += value
    return place


def _number(order: str, tag: int, kind: int, value: int) -> bytes:
    return struct.pack(f"{order}HHI" + ("I" if kind == LONG else "Hxx"), tag, kind, 1, value)


def _directory(order: str, entries: list[bytes], following: int) -> bytes:
    entries = sorted(entries, key=lambda entry: int(struct.unpack(f"{order}H", entry[:2])[0]))
    return struct.pack(f"{order}H", len(entries)) + b"".join(entries) + struct.pack(f"{order}I", following)
