"""Metadata of photos: kept, renewed and left out, through every format."""

from __future__ import annotations

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import _metadata, read_picture, write_picture
from rsdeblur.io.picture_output import iptc_segment
from rsdeblur.io.pictures import Picture
from tests.hostile import packets
from tests.installed import needs
from tests.io.test_exif_block import NOTES, OLD, block

WIDTH, HEIGHT = 64, 48
EXIF = block(">", OLD)
# Record 2: keyword, caption.
IPTC = b"\x1c\x02\x19\x00\x05shake\x1c\x02\x78\x00\x07caption"
# A packet that is kept, and one that describes a gain map and a motion photo.
KEPT, LOST = packets.PACKETS[4], packets.PACKETS[0]


def segment(marker: int, body: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, len(body) + 2) + body


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def photo(tmp_path: Path, kind: str) -> Path:
    """Write a photo of a kind, and give it an old date."""
    pixels = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    image, buffer = Image.fromarray(pixels), BytesIO()
    suffix = {"phone": ".jpg", "drone": ".jpg", "tiff": ".tif", "png": ".png", "webp": ".webp", "heic": ".heic"}[kind]
    xmp = LOST if kind in ("phone", "heic") else KEPT
    if suffix == ".jpg":
        # MPO is a JPEG with further pictures behind it, as phones store gain maps.
        behind = {"save_all": True, "append_images": [image.convert("L")]} if kind == "phone" else {}
        image.save(buffer, "MPO" if behind else "JPEG", exif=EXIF, xmp=xmp, quality=95, **behind)
        data = buffer.getvalue()
        if kind == "phone":
            # In front of the first segment, so that the places of the pictures behind stay true.
            manifest = segment(0xEB, b"JP\0\1\0\0\0\1\0\0\0\x20jumb\0\0\0\x18jumdc2pa" + bytes(12))
            data = data[:2] + manifest + data[2:]
        else:
            data = data[:2] + iptc_segment(IPTC) + data[2:]
    elif suffix == ".tif":
        tags = [(700, 1, len(xmp), xmp, True), (33723, 7, len(IPTC), IPTC, True), (0xCD41, 7, 4, b"c2pa", True)]
        tifffile.imwrite(buffer, pixels.astype(np.uint16) * 257, photometric="rgb", extratags=tags, metadata=None)
        data = buffer.getvalue()
    elif suffix == ".png":
        image.save(buffer, "PNG", exif=EXIF)
        data = buffer.getvalue()
        text = chunk(b"iTXt", b"XML:com.adobe.xmp" + bytes(5) + xmp)
        text += chunk(b"zTXt", b"Raw profile type iptc\0\0" + zlib.compress(_metadata.png_iptc(IPTC)))
        data = data[:33] + text + chunk(b"caBX", b"c2pa") + data[33:]
    elif suffix == ".webp":
        image.save(buffer, "WebP", lossless=True, exif=EXIF, xmp=xmp)
        data = buffer.getvalue() + b"C2PA" + struct.pack("<I", 4) + b"jumb"
        data = data[:4] + struct.pack("<I", len(data) - 8) + data[8:]
    else:
        heif = needs("heif")
        try:
            heif.from_pillow(image).save(buffer, exif=EXIF, xmp=xmp, quality=90)
        except RuntimeError:
            pytest.skip("pillow-heif has no encoder here")
        data = buffer.getvalue()
    path = tmp_path / f"{kind}{suffix}"
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
@pytest.mark.parametrize("kind", ["drone", "png", "webp"])
def test_blocks_come_through(tmp_path: Path, kind: str, suffix: str) -> None:
    before, after = copied(photo(tmp_path, kind), suffix, tmp_path)
    assert before.xmp is not None
    assert after.xmp is not None
    assert after.xmp == before.xmp
    assert before.iptc == (None if kind == "webp" else IPTC)
    assert after.iptc == (None if suffix == ".webp" else before.iptc)
    assert after.modified_ns == before.modified_ns == 1_500_000_000 * 10**9


@pytest.mark.filterwarnings("ignore:left out of the result")
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".webp"])
def test_the_thumbnail_shows_the_result(tmp_path: Path, suffix: str) -> None:
    before, after = copied(photo(tmp_path, "drone"), suffix, tmp_path)
    assert before.exif is not None
    assert after.exif is not None
    # The maker's notes stay at their place, to which they may point.
    assert after.exif.index(NOTES) == before.exif.index(NOTES)
    start = after.exif.index(b"\xff\xd8\xff")
    with Image.open(BytesIO(after.exif[start:])) as thumbnail:
        assert thumbnail.size == (WIDTH, HEIGHT)
        assert np.abs(np.asarray(thumbnail.convert("L")).astype(int) - 200).max() <= 2


@pytest.mark.parametrize(
    ("kind", "lost"),
    [
        ("phone", ("C2PA", "gain map", "motion photo")),
        ("tiff", ("C2PA",)),
        ("png", ("C2PA",)),
        ("webp", ("C2PA",)),
        ("heic", ("gain map", "motion photo")),
    ],
)
def test_parts_of_the_original_are_left_out_with_a_message(tmp_path: Path, kind: str, lost: tuple[str, ...]) -> None:
    path = photo(tmp_path, kind)
    with pytest.warns(RsdeblurWarning, match="left out of the result") as caught:
        _, after = copied(path, ".jpg", tmp_path)
    assert len(caught) == 1
    for word in lost:
        assert word in str(caught[0].message)
    assert after.losses == ()
    assert b"c2pa" not in (tmp_path / "copy.jpg").read_bytes()
    assert b"MPF" not in (tmp_path / "copy.jpg").read_bytes()


def test_packets_that_describe_lost_parts_are_named(tmp_path: Path) -> None:
    with pytest.warns(RsdeblurWarning, match="XMP packet, which describes parts"):
        _, after = copied(photo(tmp_path, "phone"), ".jpg", tmp_path)
    assert after.xmp is None


@pytest.mark.parametrize(
    ("suffix", "sizes", "lost"),
    [
        (".webp", {"iptc": 9}, ("IPTC",)),
        (".npy", {"iptc": 9, "xmp": 9, "exif": 9}, ("IPTC", "XMP", "EXIF")),
        (".jpg", {"iptc": 70_000, "xmp": 70_000, "exif": 70_000}, ("IPTC", "XMP", "EXIF")),
        (".tif", {"exif": 9}, ("EXIF",)),
    ],
)
def test_what_a_format_cannot_hold_is_named_once(
    tmp_path: Path, suffix: str, sizes: dict[str, int], lost: tuple[str, ...]
) -> None:
    like = Picture(np.zeros((4, 4, 3), np.uint8), **{name: b"x" * size for name, size in sizes.items()})
    with pytest.warns(RsdeblurWarning, match="left out of the result") as caught:
        write_picture(tmp_path / f"a{suffix}", like.pixels, like=like)
    assert len(caught) == 1
    for word in lost:
        assert word in str(caught[0].message)
