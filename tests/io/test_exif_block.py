"""EXIF blocks: every value comes through every format, except those that are of the old picture."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import _exif_block
from rsdeblur.io._exif_block import (
    EXIF_TABLE,
    GPS_TABLE,
    INTEROP_TABLE,
    ORIENTATION,
    of_block,
    renewed,
    with_orientation,
)
from rsdeblur.io.exif import Exif
from rsdeblur.io.picture_output import picture_to_fill, write_picture
from rsdeblur.io.pictures import Picture, read_picture

ARTIST = "Jürgen Жуков 写真".encode()
COMMENT = b"UNICODE\0" + "größer".encode("utf-16-le")
NOTES = b"MakerNote\0" + bytes(range(200))
ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SIGNED = 2, 3, 4, 5, 7, 10
Tags = dict[int, tuple[int, list[Any] | bytes]]
GPS: Tags = {1: (ASCII, b"N\0"), 2: (RATIONAL, [(50, 1), (4, 1), (25, 2)])}
INTEROP: Tags = {1: (ASCII, b"R98\0"), 2: (UNDEFINED, b"0100")}
CAMERA: Tags = {
    0x829A: (RATIONAL, [(1, 20)]),
    0x9204: (SIGNED, [(-1, 3)]),
    0x9286: (UNDEFINED, COMMENT),
    0x927C: (UNDEFINED, NOTES),
    0x9101: (UNDEFINED, b"\1\2\3\0"),
    0x920A: (RATIONAL, [(43, 10)]),
    0xA002: (SHORT, [400]),
    0xA003: (SHORT, [300]),
    0xA20E: (RATIONAL, [(200, 3)]),
    0xA20F: (RATIONAL, [(200, 3)]),
    0xA210: (SHORT, [4]),
    0xA434: (ASCII, "Objektiv für nah".encode() + b"\0"),
}
MAIN: Tags = {271: (ASCII, b"Maker\0"), ORIENTATION: (SHORT, [6]), 315: (ASCII, ARTIST + b"\0")}
OLD = b"\xff\xd8the blurred thumbnail\xff\xd9".ljust(2000, b"t")


def directory(order: str, tags: Tags, start: int, tables: dict[int, Any] | None = None, following: int = 0) -> bytes:
    """Write a directory of TIFF, independently of the package; `tables` are tags and tables that it points to."""
    tables = tables or {}
    count = len(tags) + len(tables)
    heads, values, body = b"", b"", start + 6 + 12 * count
    for tag in sorted({*tags, *tables}):
        place = body + len(values)
        if tag in tables:
            inner, *further = tables[tag]
            values += directory(order, inner, place, *further)
            heads += struct.pack(f"{order}HHII", tag, LONG, 1, place)
            continue
        kind, value = tags[tag]
        code = {SHORT: "H", LONG: "I", RATIONAL: "II", SIGNED: "ii"}.get(kind)
        numbers = b"" if code else bytes(value)
        for number in value if code else ():
            numbers += struct.pack(order + code, *(number if isinstance(number, tuple) else (number,)))
        heads += struct.pack(f"{order}HHI", tag, kind, len(value))
        if len(numbers) > 4:
            values += numbers + b"\0" * (len(numbers) % 2)
            numbers = struct.pack(f"{order}I", place)
        heads += numbers.ljust(4, b"\0")
    return struct.pack(f"{order}H", count) + heads + struct.pack(f"{order}I", following) + values


def block(order: str = "<", thumbnail: bytes = b"") -> bytes:
    """Return an EXIF block, with a second directory if it has a thumbnail."""
    tables = {EXIF_TABLE: (CAMERA, {INTEROP_TABLE: (INTEROP,)}), GPS_TABLE: (GPS,)}
    after = 8 + len(directory(order, MAIN, 8, tables))
    data = directory(order, MAIN, 8, tables, after if thumbnail else 0)
    if thumbnail:
        place = after + 6 + 12 * 2
        data += directory(order, {513: (LONG, [place]), 514: (LONG, [len(thumbnail)])}, after) + thumbnail
    return b"Exif\0\0" + (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8) + data


def values(table: _exif_block.Table) -> dict[Any, Any]:
    """Return all values with their types, as nested tables."""
    own: dict[Any, Any] = {tag: (table.ifd.tagtype[tag], table.ifd[tag]) for tag in table.ifd}
    return own | {tag: values(inner) for tag, inner in table.tables.items()}


def expected(tags: Tags) -> dict[int, tuple[int, Any]]:
    """Return values as Pillow gives them."""
    found = {}
    for tag, (kind, value) in tags.items():
        numbers = [IFDRational(*v) if isinstance(v, tuple) else v for v in value]
        plain = numbers[0] if len(numbers) == 1 else tuple(numbers)
        found[tag] = kind, value[:-1] if kind == ASCII else value if kind == UNDEFINED else plain
    return found


EXPECTED = {
    **expected(MAIN), EXIF_TABLE: {**expected(CAMERA), INTEROP_TABLE: expected(INTEROP)}, GPS_TABLE: expected(GPS)
}  # fmt: skip


def numbered(main: dict[int, Any]) -> dict[int, Any]:
    """Return values without the types of the sizes, which may change."""
    camera = dict(main[EXIF_TABLE])
    return main | {EXIF_TABLE: camera | {tag: camera[tag][1] for tag in (0xA002, 0xA003)}}


BLOCKS = pytest.mark.parametrize("exif", [block(), block(">", OLD)], ids=["little-endian", "big-endian"])


@BLOCKS
@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [(".jpg", "uint8"), (".png", "uint8"), (".png", "uint16"), (".webp", "uint8")]
    + [(".tif", dtype) for dtype in ("uint8", "uint16", "float32")],
)
@pytest.mark.parametrize("in_place", [False, True])
def test_every_value_comes_through(tmp_path: Path, exif: bytes, suffix: str, dtype: str, in_place: bool) -> None:
    """Also through two files, of which one is a TIFF."""
    pixels = np.zeros((300, 400, 3), dtype)
    picture = Picture(pixels, exif)
    for name in (f"a{suffix}", "b.tif", f"c{suffix}"):
        with picture_to_fill(tmp_path / name, pixels.shape, like=picture, in_place=in_place) as out:
            out[...] = 0
        picture = read_picture(tmp_path / name)
        assert picture.pixels.dtype == dtype
        assert picture.exif is not None
        assert numbered(values(of_block(picture.exif))) == numbered(EXPECTED)
    with Image.open(tmp_path / f"a{suffix}") if dtype == "uint8" else Image.new("L", (1, 1)) as image:
        assert dtype != "uint8" or image.getexif()[315].encode("latin-1") == ARTIST


def test_a_thumbnail_is_replaced_where_it_is(tmp_path: Path) -> None:
    exif = block(">", OLD)
    for suffix in (".jpg", ".png", ".webp", ".tif"):
        path = tmp_path / f"a{suffix}"
        write_picture(path, np.zeros((300, 400, 3)), like=Picture(np.zeros((300, 400, 3), np.uint8), exif))
        assert b"blurred thumbnail" not in path.read_bytes()
    small = renewed(exif, 400, 300, lambda most: b"\xff\xd8new"[:most])
    assert small[: -len(OLD)].replace(b"\0\0\0\5", struct.pack(">I", len(OLD))) == exif[: -len(OLD)].replace(
        struct.pack(">HHIHxx", 0xA002, SHORT, 1, 400), struct.pack(">HHII", 0xA002, LONG, 1, 400)
    ).replace(struct.pack(">HHIHxx", 0xA003, SHORT, 1, 300), struct.pack(">HHII", 0xA003, LONG, 1, 300))
    assert small[-len(OLD) :] == b"\xff\xd8new".ljust(len(OLD), b"\0")
    # A thumbnail that does not fit is removed.
    gone = renewed(exif, 400, 300, lambda _: None)
    assert gone.endswith(bytes(len(OLD)))
    image = Image.Exif()
    image.load(gone)
    assert not image.get_ifd(1)


@BLOCKS
def test_sizes_are_those_of_the_new_picture(exif: bytes) -> None:
    half = renewed(exif, 200, 150, lambda _: None)
    camera = of_block(half).tables[EXIF_TABLE].ifd
    assert (camera[0xA002], camera[0xA003]) == (200, 150)
    # The sensor stays as large, and so does the angle of view.
    assert Exif(half).focal_px(200, 150)[0] == pytest.approx(Exif(exif).focal_px(400, 300)[0] / 2, rel=1e-3)
    assert of_block(renewed(exif, 100_000, 300, lambda _: None)).tables[EXIF_TABLE].ifd[0xA002] == 100_000


@pytest.mark.parametrize("exif", [block(), block(">", OLD), None, b"", b"Exif\0\0nonsense"])
def test_the_orientation_is_set(exif: bytes | None) -> None:
    for orientation in (1, 8):
        main = values(of_block(with_orientation(exif, orientation)))
        assert main[ORIENTATION] == (SHORT, orientation)
        if exif and exif.startswith((b"Exif\0\0II", b"Exif\0\0MM")):
            assert {**main, ORIENTATION: 0} == {**EXPECTED, ORIENTATION: 0}


def test_an_orientation_is_added_to_a_block_without_one() -> None:
    exif = block().replace(struct.pack("<HH", ORIENTATION, SHORT), struct.pack("<HH", 275, SHORT))
    main = values(of_block(with_orientation(exif, 8)))
    assert main.pop(ORIENTATION) == (SHORT, 8)
    assert {**main, 275: 0} == {**{tag: value for tag, value in EXPECTED.items() if tag != ORIENTATION}, 275: 0}


@pytest.mark.parametrize(("tag", "kind"), [(315, 129), (0xA434, 99), (271, 0)])
def test_tags_that_a_tiff_cannot_carry_are_counted(tmp_path: Path, tag: int, kind: int) -> None:
    exif = block().replace(struct.pack("<HH", tag, ASCII), struct.pack("<HH", tag, kind))
    pixels = np.zeros((3, 4), np.uint8)
    with pytest.warns(RsdeblurWarning, match="1 tags"):
        write_picture(tmp_path / "a.tif", pixels, like=Picture(pixels, exif))
    kept = read_picture(tmp_path / "a.tif").exif
    assert kept is not None
    main = values(of_block(kept))
    assert len(main) + len(main[EXIF_TABLE]) == len(EXPECTED) + len(EXPECTED[EXIF_TABLE]) - 1


def test_a_thumbnail_that_claims_the_directories_is_damage(tmp_path: Path) -> None:
    exif = block(">", OLD)
    place = exif.rindex(struct.pack(">HHI", 513, LONG, 1)) + 8
    damaged = exif[:place] + struct.pack(">I", 40) + exif[place + 4 :]
    assert renewed(damaged, 200, 150, lambda _: None) == damaged
    write_picture(tmp_path / "a.png", np.zeros((9, 9, 3)), like=Picture(np.zeros((9, 9, 3), np.uint8), damaged))


@settings(max_examples=300, deadline=None, derandomize=True, database=None)
@given(data=st.data())
def test_no_damage_raises_anything_else(data: st.DataObject) -> None:
    exif = bytearray(block(">", OLD) if data.draw(st.booleans()) else block())
    for _ in range(data.draw(st.integers(1, 8))):
        exif[data.draw(st.integers(6, len(exif) - 1))] = data.draw(st.sampled_from([0, 1, 4, 5, 8, 13, 127, 255]))
    damaged = bytes(exif[: data.draw(st.integers(6, len(exif)))])
    assert len(renewed(damaged, 40, 30, lambda most: b"x" * most)) == len(damaged)
    assert with_orientation(damaged, 3)
    try:
        main = of_block(damaged)
    except ValueError:
        return
    assert values(of_block(main.block())).keys() == values(main).keys()


def test_tiff_tags_of_big_endian_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, np.zeros((3, 4), np.uint8), byteorder=">", extratags=[(315, "s", 0, ARTIST, True)], metadata=None
    )
    picture = read_picture(path)
    assert picture.exif is not None
    assert of_block(picture.exif).ifd[315] == ARTIST
