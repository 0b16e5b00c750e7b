"""Metadata of photos: kept, renewed and left out, through every format."""

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image
from PIL.ExifTags import IFD
from PIL.TiffImagePlugin import IFDRational

from rsdeblur import RsdeblurWarning, read_picture, write_picture
from rsdeblur._util.binary import block_of, tags_of
from rsdeblur.io import Picture
from rsdeblur.io.metadata import with_orientation, without_thumbnail
from rsdeblur.io.picture_output import iptc_segment
from tests.hostile.packets import KEPT, LOST, with_thumbnail
from tests.installed import needs

WIDTH, HEIGHT = 64, 48
# Record 2: keyword, caption.
IPTC = b"\x1c\x02\x19\x00\x05shake\x1c\x02\x78\x00\x07caption"
# The start of every C2PA manifest.
MANIFEST = b"\0\0\0\x20jumb\0\0\0\x18jumdc2pa" + bytes(12)
NOTES = b"MakerNote\0" + bytes(range(200))
MAIN: dict[int, Any] = {271: "Maker", 274: 6, 315: "Jürgen Жуков 写真".encode()}
CAMERA: dict[int, Any] = {
    0x829A: IFDRational(1, 20),
    0x9204: IFDRational(-1, 3),
    0x9286: b"UNICODE\0" + "größer".encode("utf-16-le"),
    0x927C: NOTES,
    0x9101: b"\1\2\3\0",
    0x920A: IFDRational(43, 10),
    **{0xA002: WIDTH, 0xA003: HEIGHT},
    **dict.fromkeys((0xA20E, 0xA20F), IFDRational(20, 3)),
    0xA210: 4,
    0xA434: "Objektiv für nah".encode(),
}
INTEROP: dict[int, Any] = {1: "R98", 2: b"0100"}
GPS: dict[int, Any] = {1: "N", 2: (50.0, 4.0, 12.5)}


def block(order: str = ">") -> bytes:
    """Return an EXIF block; that in big-endian order has a thumbnail."""
    exif = Image.Exif()
    exif.endian = order
    exif.update(MAIN)
    exif.get_ifd(0x8769).update(CAMERA)
    exif.get_ifd(0x8769)[0xA005] = dict(INTEROP)
    exif.get_ifd(0x8825).update(GPS)
    thumbnail = b"\xff\xd8the blurred thumbnail\xff\xd9".ljust(2000, b"t")
    return with_thumbnail(exif.tobytes(), thumbnail) if order == ">" else exif.tobytes()


def values(block: bytes | None) -> dict[Any, Any]:
    """Return all values by tag as Pillow reads them, texts as bytes, those of the camera, the GPS and so on nested."""
    exif = Image.Exif()
    exif.load(block)
    tables = {table: dict(exif.get_ifd(table)) for table in (0x8769, 0x8825, 0xA005)}
    found: dict[Any, Any] = {tag: value for tag, value in exif.items() if tag not in tables}
    for table in (found, *tables.values()):
        table.pop(0xA005, None)
        table.update({tag: value.encode("latin-1") for tag, value in table.items() if isinstance(value, str)})
    return found | tables


BLOCKS = pytest.mark.parametrize("exif", [block("<"), block()], ids=["little-endian", "big-endian"])


@BLOCKS
@pytest.mark.parametrize(
    ("suffix", "dtype"),
    [(".jpg", "uint8"), (".png", "uint8"), (".png", "uint16"), (".webp", "uint8"), (".tif", "uint8")],
)
def test_every_value_comes_through(tmp_path: Path, exif: bytes, suffix: str, dtype: str) -> None:
    """Also through two files, of which one is a TIFF."""
    picture = Picture(np.zeros((HEIGHT, WIDTH, 3), dtype), exif)
    for name in (f"a{suffix}", "b.tif", f"c{suffix}"):
        write_picture(tmp_path / name, picture.pixels, like=picture)
        picture = read_picture(tmp_path / name)
        assert picture.pixels.dtype == dtype
        assert values(picture.exif) == values(exif)


@BLOCKS
def test_the_thumbnail_is_removed_and_nothing_else(exif: bytes) -> None:
    block = Image.Exif()
    block.load(without_thumbnail(exif))
    assert not block.get_ifd(IFD.IFD1)
    assert values(without_thumbnail(exif)) == values(exif)


def test_the_orientation_is_set_or_added() -> None:
    without = block_of({tag: value for tag, value in tags_of(block()).items() if tag != 274})
    for exif in (block("<"), block(), without):
        assert values(with_orientation(exif, 8)) == values(exif) | {274: 8}
    assert all(values(with_orientation(exif, 8))[274] == 8 for exif in (None, b"", b"Exif\0\0nonsense"))


def segment(marker: int, body: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def photo(tmp_path: Path, kind: str) -> Path:
    """Write a photo of a kind, and give it an old date."""
    pixels = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    image, buffer, exif = Image.fromarray(pixels), BytesIO(), block()
    xmp = LOST if kind in ("phone.jpg", "a.heic") else KEPT
    if kind == "phone.jpg":
        # MPO is a JPEG with further pictures behind it, as phones store gain maps.
        image.save(buffer, "MPO", exif=exif, xmp=xmp, save_all=True, append_images=[image.convert("L")])
        # In front of the first segment, so that the places of the pictures behind stay true.
        data = b"\xff\xd8" + segment(0xEB, b"JP\0\1\0\0\0\1" + MANIFEST) + buffer.getvalue()[2:]
    elif kind == "drone.jpg":
        image.save(buffer, "JPEG", exif=exif, xmp=xmp, quality=95)
        data = b"\xff\xd8" + iptc_segment(IPTC) + buffer.getvalue()[2:]
    elif kind == "a.tif":
        tags = [(700, 1, len(xmp), xmp, True), (33723, 7, len(IPTC), IPTC, True), (0xCD41, 7, 4, b"c2pa", True)]
        tifffile.imwrite(buffer, pixels.astype(np.uint16) * 257, photometric="rgb", extratags=tags, metadata=None)
        data = buffer.getvalue()
    elif kind == "a.png":
        image.save(buffer, "PNG", exif=exif)
        text = chunk(b"iTXt", b"XML:com.adobe.xmp" + bytes(5) + xmp)
        data = buffer.getvalue()[:33] + text + chunk(b"caBX", MANIFEST) + buffer.getvalue()[33:]
    elif kind == "a.webp":
        image.save(buffer, "WebP", lossless=True, exif=exif, xmp=xmp)
        data = buffer.getvalue() + b"C2PA" + struct.pack("<I", len(MANIFEST)) + MANIFEST
        data = data[:4] + struct.pack("<I", len(data) - 8) + data[8:]
    else:
        needs("heif").from_pillow(image).save(buffer, exif=exif, xmp=xmp, quality=90)
        data = buffer.getvalue()
    path = tmp_path / kind
    path.write_bytes(data)
    os.utime(path, ns=(1_500_000_000 * 10**9, 1_500_000_000 * 10**9))
    return path


def copied(path: Path, suffix: str, tmp_path: Path) -> tuple[Picture, Picture]:
    """Return a photo and the copy that is written like it."""
    before, out = read_picture(path), tmp_path / f"copy{suffix}"
    pixels = np.full_like(before.pixels, 200 if before.pixels.dtype == np.uint8 else 200 * 257)
    write_picture(out, pixels, like=before, force=True)
    return before, read_picture(out)


@pytest.mark.filterwarnings("ignore:left out of the result")
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp"])
@pytest.mark.parametrize("kind", ["drone.jpg", "a.png", "a.webp"])
def test_blocks_come_through(tmp_path: Path, kind: str, suffix: str) -> None:
    before, after = copied(photo(tmp_path, kind), suffix, tmp_path)
    assert after.xmp == before.xmp == KEPT
    assert before.iptc == (IPTC if kind == "drone.jpg" else None)
    assert after.iptc == (None if suffix in (".png", ".webp") else before.iptc)
    if suffix != ".tif":
        assert before.exif is not None
        assert after.exif is not None
        # The maker's notes stay at their place, to which they may point.
        assert after.exif.index(NOTES) == before.exif.index(NOTES)


@pytest.mark.parametrize(
    ("kind", "lost"),
    [
        *((name, ("gain map", "XMP packet, which describes such parts")) for name in ("phone.jpg", "a.heic")),
        *((name, ("C2PA",)) for name in ("a.tif", "a.png", "a.webp")),
    ],
)
def test_parts_of_the_original_are_left_out_with_a_message(tmp_path: Path, kind: str, lost: tuple[str, ...]) -> None:
    with pytest.warns(RsdeblurWarning, match="left out of the result") as caught:
        before, after = copied(photo(tmp_path, kind), ".jpg", tmp_path)
    assert len(caught) == 1
    for word in lost:
        assert word in str(caught[0].message)
    assert not after.has_parts
    assert after.xmp == (None if before.xmp == LOST else before.xmp)
    for mark in (b"c2pa", b"MPF"):
        assert mark not in (tmp_path / "copy.jpg").read_bytes()


@pytest.mark.parametrize(
    ("suffix", "sizes", "lost"),
    [
        *((suffix, {"iptc": 9}, ("IPTC",)) for suffix in (".png", ".webp")),
        (".npy", {"iptc": 9, "xmp": 9, "exif": 9}, ("IPTC", "XMP", "EXIF")),
        (".jpg", {"iptc": 70_000, "xmp": 70_000, "exif": 70_000}, ("IPTC", "XMP", "EXIF")),
        (".tif", {"exif": 9}, ("EXIF",)),
    ],
)
def test_what_a_format_cannot_hold_is_named_once(tmp_path, suffix, sizes, lost):
    like = Picture(np.zeros((4, 4, 3), np.uint8), **{name: b"x" * size for name, size in sizes.items()})
    with pytest.warns(RsdeblurWarning, match="left out of the result") as caught:
        write_picture(tmp_path / f"a{suffix}", like.pixels, like=like)
    assert len(caught) == 1
    for word in lost:
        assert word in str(caught[0].message)
