"""Parts of binary files: tags of EXIF blocks and TIFF files, basE91 (Henke)."""

import struct
import zlib
from collections.abc import Collection
from contextlib import suppress
from tokenize import TokenError
from typing import Any
from zipfile import BadZipFile

import numpy as np
from PIL.ExifTags import IFD, Base
from tifffile import TIFF

# Errors that damaged files are known to raise, also in Pillow, imagecodecs, zipfile and NumPy.
DAMAGE = (
    *(OSError, EOFError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RuntimeError),
    *(struct.error, zlib.error, SyntaxError, AssertionError, BadZipFile, TokenError),
)
PREFIX = b"Exif\0\0"
ORIENTATION = Base.Orientation
# Kinds of whole numbers in TIFF.
SHORT, LONG = 3, 4
# Tables that the tables of a block point to.
POINTERS: dict[int | None, tuple[int, ...]] = {None: (IFD.Exif, IFD.GPSInfo), IFD.Exif: (IFD.Interop,)}
BASE91 = b'ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789!#$%&()*+,./:;<=>?@[]^_`{|}~"'
# Values by tag: their kind, their number, and their bytes, least significant first; or the values of another table.
Tags = dict[int, "tuple[int, int, bytes] | Tags"]


class Directory:
    """A directory in the bytes of a block or of a TIFF file, whose entries may be changed in place."""

    def __init__(self, data: bytes | bytearray, start: int | None = None) -> None:
        if bytes(data[:4]) not in (b"II*\0", b"MM\0*"):
            raise ValueError("it does not begin like TIFF")
        self.data: Any = data
        self.order = "<" if data[:2] == b"II" else ">"
        start = self.unpack("I", 4) if start is None else start
        self.end = start + 2 + 12 * self.unpack("H", start)
        self.places = {self.unpack("H", place): place for place in range(start + 2, self.end, 12)}

    def unpack(self, kind: str, place: int) -> int:
        return int(struct.unpack_from(self.order + kind, self.data, place)[0])

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
        for tag in self.places:
            with suppress(*DAMAGE):
                if tag in POINTERS.get(table, ()):
                    found[tag] = Directory(self.data, self.unpack("I", self.places[tag] + 8)).tags(None, tag)
                elif wanted is None or tag in wanted:
                    found[tag] = self.value(tag)
        return {tag: value for tag, value in found.items() if value}


def tags_of(data: bytes, wanted: Collection[int] | None = None) -> Tags:
    """Return the tags of an EXIF block or of a classic TIFF file, or only the `wanted` ones of the first directory."""
    return Directory(data[len(PREFIX) :] if data[: len(PREFIX)] == PREFIX else data).tags(wanted)


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


def base91_decode(text: bytes) -> bytes:
    """Decode basE91 (Henke): two characters carry 13 or 14 bits."""
    others = bytes(set(range(256)).difference(BASE91))
    values = text.translate(bytes(max(BASE91.find(code), 0) for code in range(256)), others)
    out, bits, count = bytearray(), 0, 0
    for low, high in zip(values[::2], values[1::2], strict=False):
        pair = low + 91 * high
        bits |= pair << count
        count += 13 if pair & 8191 > 88 else 14
        while count > 7:
            out.append(bits & 255)
            bits >>= 8
            count -= 8
    if len(values) % 2:
        out.append((bits | values[-1] << count) & 255)
    return bytes(out)
