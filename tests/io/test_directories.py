"""EXIF blocks: every value comes through every format, except those that are of the old picture."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from rsdeblur.io import directories
from rsdeblur.io._exif_renewal import DATE, SOFTWARE
from rsdeblur.io._metadata import AGENT
from rsdeblur.io.directories import (
    ASCII,
    EXIF_TABLE,
    GPS_TABLE,
    INTEROP_TABLE,
    LONG,
    RATIONAL,
    SHORT,
    Directory,
    Entry,
    block,
    read,
    read_block,
    renewed,
    with_orientation,
)
from rsdeblur.io.exif import Exif
from rsdeblur.io.picture_output import picture_to_fill, write_picture
from rsdeblur.io.pictures import Picture, read_picture

ARTIST = "Jürgen Жуков 写真".encode()
UNDEFINED = 7
COMMENT = b"UNICODE\0" + "größer".encode("utf-16-le")


def text(value: bytes) -> Entry:
    return Entry(ASCII, len(value) + 1, value + b"\0")


def short(value: int) -> Entry:
    return Entry(SHORT, 1, struct.pack("<H", value))


def rational(above: int, below: int) -> Entry:
    return Entry(RATIONAL, 1, struct.pack("<II", above, below))


MAIN = Directory(
    {315: text(ARTIST), 271: text(b"Maker"), directories.ORIENTATION: short(6)},
    {
        EXIF_TABLE: Directory(
            {
                0x829A: rational(1, 20),
                0x9286: Entry(UNDEFINED, len(COMMENT), COMMENT),
                0x9101: Entry(UNDEFINED, 4, b"\1\2\3\0"),
                0x920A: rational(43, 10),
                directories.EXIF_WIDTH: short(400),
                directories.EXIF_HEIGHT: short(300),
                directories.PLANE_X: rational(400, 6),
                directories.PLANE_Y: rational(400, 6),
                0xA210: short(4),
                0xA434: text("Objektiv für nah".encode()),
            },
            {INTEROP_TABLE: Directory({1: text(b"R98"), 2: Entry(UNDEFINED, 4, b"0100")})},
        ),
        GPS_TABLE: Directory({1: text(b"N"), 2: Entry(RATIONAL, 3, struct.pack("<6I", 50, 1, 4, 1, 12, 1))}),
    },
)


def big_endian(directory: Directory, start: int, following: int = 0) -> bytes:
    """Write a directory with the most significant byte first, independently of the package."""
    count = len(directory.entries) + len(directory.tables)
    heads, values, body = b"", b"", start + 6 + 12 * count
    for tag in sorted({*directory.entries, *directory.tables}):
        if tag in directory.tables:
            place = body + len(values)
            values += big_endian(directory.tables[tag], place)
            heads += struct.pack(">HHII", tag, LONG, 1, place)
            continue
        entry = directory.entries[tag]
        code = {SHORT: "H", LONG: "I", RATIONAL: "I"}.get(entry.kind, "B")
        numbers = struct.unpack(f"<{len(entry.value) // struct.calcsize('<' + code)}{code}", entry.value)
        value = struct.pack(f">{len(numbers)}{code}", *numbers)
        if len(value) > 4:
            place = body + len(values)
            values += value + b"\0" * (len(value) % 2)
            value = struct.pack(">I", place)
        heads += struct.pack(">HHI4s", tag, entry.kind, entry.items, value.ljust(4, b"\0"))
    return struct.pack(">H", count) + heads + struct.pack(">I", following) + values


def values(directory: Directory) -> dict[int, object]:
    """Return all values, as nested tables."""
    return {**directory.entries, **{tag: values(table) for tag, table in directory.tables.items()}}


EXPECTED = values(MAIN)
THUMBNAIL = b"\xff\xd8the blurred thumbnail\xff\xd9"


def with_thumbnail(main: Directory) -> bytes:
    """Return an EXIF block in big-endian order with a second directory and its JPEG."""
    first = len(big_endian(main, 8))
    second = Directory({513: Entry(LONG, 1, b""), 514: Entry(LONG, 1, struct.pack("<I", len(THUMBNAIL)))})
    place = 8 + first + 6 + 12 * 2
    second.entries[513] = Entry(LONG, 1, struct.pack("<I", place))  # type: ignore[index]
    data = big_endian(main, 8, 8 + first) + big_endian(second, 8 + first) + THUMBNAIL
    return b"Exif\0\0MM\0*" + struct.pack(">I", 8) + data


@pytest.mark.parametrize("exif", [block(MAIN), with_thumbnail(MAIN)], ids=["little-endian", "big-endian"])
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp", ".tif"])
@pytest.mark.parametrize("in_place", [False, True])
def test_every_value_comes_through(tmp_path: Path, exif: bytes, suffix: str, in_place: bool) -> None:
    """Also through two files, of which one is a TIFF: all keep the same bytes."""
    pixels = np.zeros((300, 400, 3), np.uint8)
    picture = Picture(pixels, exif)
    for name in (f"a{suffix}", "b.tif", f"c{suffix}"):
        with picture_to_fill(tmp_path / name, pixels.shape, like=picture, in_place=in_place) as out:
            out[...] = 0
        picture = read_picture(tmp_path / name)
        assert picture.exif is not None
        found = numbered(values(read_block(picture.exif)))
        assert found.pop(SOFTWARE) == text(AGENT.encode())
        assert len(found.pop(DATE).value) == 20  # type: ignore[attr-defined]
        assert found == numbered(EXPECTED)
        with Image.open(tmp_path / name) as image:
            assert image.getexif()[315].encode("latin-1") == ARTIST


def numbered(main: dict[int, object]) -> dict[int, object]:
    """Return values with numbers for the sizes, whose type may change."""
    camera = dict(main[EXIF_TABLE])
    camera |= {tag: int.from_bytes(camera[tag].value, "little") for tag in (0xA002, 0xA003)}
    return main | {EXIF_TABLE: camera}


def test_no_thumbnail_of_the_old_picture_is_left(tmp_path: Path) -> None:
    exif = with_thumbnail(MAIN)
    for suffix in (".jpg", ".png", ".webp", ".tif"):
        path = tmp_path / f"a{suffix}"
        write_picture(path, np.zeros((300, 400, 3)), like=Picture(np.zeros((300, 400, 3), np.uint8), exif))
        assert b"blurred thumbnail" not in path.read_bytes()
        with Image.open(path) as image:
            assert not image.getexif().get_ifd(1)
    # In the middle of a block it becomes zeros: makers' notes may contain offsets of what follows.
    more = exif + b"more"
    assert renewed(more, 400, 300).endswith(bytes(len(THUMBNAIL)) + b"more")
    assert len(renewed(more, 400, 300)) == len(more)


def test_sizes_are_those_of_the_new_picture() -> None:
    for exif in (block(MAIN), with_thumbnail(MAIN)):
        half = renewed(exif, 200, 150)
        camera = read_block(half).tables[EXIF_TABLE]
        assert [directories.number(camera, tag) for tag in (0xA002, 0xA003)] == [200, 150]
        # The sensor stays as large, and so does the angle of view.
        assert Exif(half).focal_px(200, 150)[0] == pytest.approx(Exif(exif).focal_px(400, 300)[0] / 2, rel=1e-3)
        huge = read_block(renewed(exif, 100_000, 300)).tables[EXIF_TABLE]
        assert directories.number(huge, 0xA002) == 100_000


@pytest.mark.parametrize("exif", [block(MAIN), with_thumbnail(MAIN), None, b"", b"Exif\0\0nonsense"])
def test_the_orientation_is_set(exif: bytes | None) -> None:
    for orientation in (1, 8):
        main = read_block(with_orientation(exif, orientation))
        assert directories.number(main, directories.ORIENTATION) == orientation
        if exif and exif.startswith((b"Exif\0\0II", b"Exif\0\0MM")):
            assert {**values(main), directories.ORIENTATION: 0} == {**EXPECTED, directories.ORIENTATION: 0}


def test_a_value_outside_the_block_costs_only_itself() -> None:
    exif = bytearray(block(MAIN))
    place = read_block(bytes(exif)).places[271]
    struct.pack_into("<I", exif, 6 + place + 8, 10**9)
    assert values(read_block(bytes(exif))) == {tag: value for tag, value in EXPECTED.items() if tag != 271}


def test_a_thumbnail_that_claims_the_directories_is_damage(tmp_path: Path) -> None:
    exif = with_thumbnail(MAIN)
    at = exif.rindex(struct.pack(">HHII", 513, LONG, 1, exif.index(THUMBNAIL) - 6)) + 8
    damaged = exif[:at] + struct.pack(">I", 40) + exif[at + 4 : -len(THUMBNAIL)] + bytes(9999)
    damaged = damaged.replace(
        struct.pack(">HHII", 514, LONG, 1, len(THUMBNAIL)), struct.pack(">HHII", 514, LONG, 1, 99999)
    )
    assert renewed(damaged, 200, 150) == damaged
    write_picture(tmp_path / "a.png", np.zeros((9, 9, 3)), like=Picture(np.zeros((9, 9, 3), np.uint8), damaged))


def test_values_that_share_their_bytes_are_bounded() -> None:
    size = 100_000
    heads = b"".join(struct.pack("<HHII", 40_000 + i, UNDEFINED, size, 0) for i in range(2000))
    data = b"II*\0" + struct.pack("<IH", 8, 2000) + heads + bytes(size)
    assert sum(len(entry.value) for entry in read(BytesIO(data)).entries.values()) <= len(data)


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(data=st.data())
def test_no_damage_raises_anything_else(data: st.DataObject) -> None:
    exif = bytearray(with_thumbnail(MAIN) if data.draw(st.booleans()) else block(MAIN))
    for _ in range(data.draw(st.integers(1, 8))):
        exif[data.draw(st.integers(6, len(exif) - 1))] = data.draw(st.sampled_from([0, 1, 4, 5, 8, 13, 127, 255]))
    damaged = bytes(exif[: data.draw(st.integers(6, len(exif)))])
    assert len(renewed(damaged, 40, 30)) <= len(damaged)
    assert with_orientation(damaged, 3)
    try:
        main = read_block(damaged)
    except ValueError:
        return
    assert values(read_block(block(main))) == values(main)


def test_tiff_tags_of_big_endian_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, np.zeros((3, 4), np.uint8), byteorder=">", extratags=[(315, "s", 0, ARTIST, True)], metadata=None
    )
    picture = read_picture(path)
    assert picture.exif is not None
    assert read_block(picture.exif).entries[315].value == ARTIST + b"\0"
