"""Pictures: reading returns what is stored, what is written comes back, and nothing is lost between."""

from __future__ import annotations

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms
from PIL.ExifTags import Base
from PIL.JpegImagePlugin import JpegImageFile

from rsdeblur.errors import FileFormatError, InputError, OutputError, RsdeblurWarning
from rsdeblur.io import Picture, _exif_block, check_writable, pictures, read_picture, write_picture

RGB_PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
# It has the header fields of a real grey profile; nothing here reads more.
GREY_PROFILE = RGB_PROFILE[:16] + b"GRAY" + RGB_PROFILE[20:]
EXTENSIONS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".PNG")


def exif_block() -> bytes:
    block = Image.Exif()
    block[271], block[274], block[306] = "Maker", 6, "2024:05:06 07:08:09"
    # ExposureTime, DateTimeOriginal; GPS north, 1 2 3.5
    block.get_ifd(34665).update({33434: 0.25, 36867: "2024:05:06 07:08:09"})
    block[34853] = {1: "N", 2: (1.0, 2.0, 3.5)}
    return block.tobytes()


EXIF = exif_block()
MOVED = (
    _exif_block.INTEROP_TABLE,
    Base.ExifImageWidth,
    Base.ExifImageHeight,
    Base.FocalPlaneXResolution,
    Base.FocalPlaneYResolution,
)


def values(exif: bytes | None) -> list[Any]:
    """Return the values of an EXIF block, which a TIFF may store in another order."""
    assert exif is not None
    main = _exif_block.of_block(exif)
    return [dict(main.ifd), *(dict(main.tables[tag].ifd) for tag in sorted(main.tables))]


def random_pixels(dtype: str, *shape: int) -> np.ndarray[Any, Any]:
    pixels = np.random.default_rng(1).random(shape)
    scale = 1 if dtype == "float32" else np.iinfo(dtype).max
    return (pixels * scale).astype(dtype)


def as_float(pixels: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    return pixels / np.float64(1 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max)


def encoded(image: Image.Image, kind: str, **options: Any) -> bytes:
    buffer = BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def tiff(pixels: np.ndarray[Any, Any], **options: Any) -> bytes:
    buffer = BytesIO()
    tifffile.imwrite(buffer, pixels, **options)
    return buffer.getvalue()


def read_bytes(tmp_path: Path, data: bytes) -> Picture:
    path = tmp_path / "picture"
    path.write_bytes(data)
    return read_picture(path)


LOSSLESS = [
    *((".png", dtype, channels) for dtype in ("uint8", "uint16") for channels in ((), (2,), (3,), (4,))),
    *((".tif", dtype, channels) for dtype in ("uint8", "uint16", "float32") for channels in ((), (2,), (3,), (4,))),
    (".webp", "uint8", (3,)),
    (".webp", "uint8", (4,)),
]


@pytest.mark.parametrize(("extension", "dtype", "channels"), LOSSLESS)
@pytest.mark.parametrize("size", [(7, 5), (1, 1), (1, 3), (3, 1)])
def test_lossless_round_trip(
    tmp_path: Path, extension: str, dtype: str, channels: tuple[int, ...], size: tuple[int, int]
) -> None:
    pixels = random_pixels(dtype, *size, *channels)
    icc = GREY_PROFILE if channels in ((), (2,)) else RGB_PROFILE
    path = tmp_path / f"picture{extension}"
    write_picture(path, as_float(pixels), like=Picture(pixels, EXIF, icc))
    again = read_picture(path)
    assert again.pixels.dtype == pixels.dtype
    np.testing.assert_array_equal(again.pixels, pixels)
    assert values(again.exif) == values(EXIF)
    assert again.icc_profile == icc
    assert not again.pixels.flags.writeable


@pytest.mark.parametrize("channels", [(), (3,)])
def test_jpeg_round_trip(tmp_path: Path, channels: tuple[int, ...]) -> None:
    # A picture as smooth as a photo: random noise would measure JPEG, not the reader.
    y, x = np.mgrid[0:64, 0:48] / 64
    image = np.stack([y, x, 1 - y], axis=-1) if channels else y
    path = tmp_path / "picture.jpg"
    icc = RGB_PROFILE if channels else GREY_PROFILE
    write_picture(path, image, like=Picture(np.zeros(1, np.uint8), EXIF, icc))
    again = read_picture(path)
    assert (values(again.exif), again.icc_profile) == (values(EXIF), icc)
    assert again.pixels.shape == image.shape
    # Quality 95 quantises the coefficients in steps of 1 to 12 levels.
    assert np.abs(as_float(again.pixels) - image).max() < 4 / 255
    with Image.open(path) as opened:
        assert isinstance(opened, JpegImageFile)
        assert channels == () or {layer[1:3] for layer in opened.layer} == {(1, 1)}


@pytest.mark.parametrize(
    ("source", "extension", "expected"),
    [
        ("float32", ".png", "uint16"),
        ("uint16", ".jpg", "uint8"),
        ("float32", ".webp", "uint8"),
        ("uint8", ".tif", "uint8"),
    ],
)
def test_depth_is_that_of_like_or_the_next_lower_one(
    tmp_path: Path, source: str, extension: str, expected: str
) -> None:
    path = tmp_path / f"picture{extension}"
    write_picture(path, np.full((4, 4), 0.5), like=Picture(np.zeros(1, source)))
    assert read_picture(path).pixels.dtype == expected


def test_integers_keep_their_depth(tmp_path: Path) -> None:
    pixels = np.arange(16, dtype=np.uint16).reshape(4, 4)
    for name, dtype in (("a.png", "uint16"), ("a.tif", "uint16"), ("a.npy", "uint16"), ("a.jpg", "uint8")):
        write_picture(tmp_path / name, pixels)
        assert read_picture(tmp_path / name).pixels.dtype == dtype
    write_picture(tmp_path / "float.tif", pixels / 15)
    assert read_picture(tmp_path / "float.tif").pixels.dtype == np.uint8


def test_bits_override_like(tmp_path: Path) -> None:
    for bits, dtype in ((8, "uint8"), (16, "uint16"), (32, "float32")):
        path = tmp_path / f"{bits}.tif"
        write_picture(path, np.full((4, 4), 0.5), like=Picture(np.zeros(1, np.uint16)), bits=bits)
        assert read_picture(path).pixels.dtype == dtype
    with pytest.raises(OutputError, match=r"picture\.jpg: JPEG cannot hold 16 bits per sample"):
        write_picture(tmp_path / "picture.jpg", np.zeros((4, 4)), bits=16)


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_constant_pictures(tmp_path: Path, extension: str, value: float) -> None:
    path = tmp_path / f"picture{extension}"
    write_picture(path, np.full((9, 10, 3), value))
    np.testing.assert_array_equal(read_picture(path).pixels, np.full((9, 10, 3), round(value * 255), np.uint8))


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_values_are_clipped_and_rounded(tmp_path: Path, dtype: type) -> None:
    image = np.array([[-1.0, 0.0, 7.0, 1.0, 0.25]], dtype)
    write_picture(tmp_path / "picture.png", image, bits=16)
    np.testing.assert_array_equal(read_picture(tmp_path / "picture.png").pixels, [[0, 0, 65535, 65535, 16384]])


def test_float_pictures_keep_what_is_brighter_than_white(tmp_path: Path) -> None:
    image = np.array([[-1.0, 0.25, 7.0]], np.float32)
    write_picture(tmp_path / "picture.tif", image, bits=32)
    np.testing.assert_array_equal(read_picture(tmp_path / "picture.tif").pixels, image)


@pytest.mark.parametrize(("channels", "left"), [(2, (4, 4)), (4, (4, 4, 3))])
def test_jpeg_drops_alpha_and_keeps_colours(tmp_path: Path, channels: int, left: tuple[int, ...]) -> None:
    image = np.full((4, 4, channels), 0.8)
    image[..., -1] = 0.0
    write_picture(tmp_path / "picture.jpg", image)
    np.testing.assert_array_equal(read_picture(tmp_path / "picture.jpg").pixels, np.full(left, 204))


@pytest.mark.parametrize("extension", [".png", ".tif", ".jpg", ".webp"])
def test_a_profile_of_another_colour_space_is_left_out(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"picture{extension}"
    write_picture(path, np.zeros((4, 4, 3)), like=Picture(np.zeros(1, np.uint8), None, GREY_PROFILE))
    assert read_picture(path).icc_profile is None


def test_tiff_without_metadata_has_no_exif(tmp_path: Path) -> None:
    write_picture(tmp_path / "picture.tif", np.zeros((4, 4)))
    picture = read_picture(tmp_path / "picture.tif")
    assert (picture.exif, picture.icc_profile) == (None, None)


def test_damaged_exif_does_not_prevent_the_tiff(tmp_path: Path) -> None:
    with pytest.warns(RsdeblurWarning, match="EXIF block, which is damaged"):
        write_picture(tmp_path / "picture.tif", np.ones((4, 4)), like=Picture(np.zeros(1, np.uint8), b"Exif\0\0junk"))
    assert read_picture(tmp_path / "picture.tif").pixels.min() == 255


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_orientation_is_not_applied(tmp_path: Path, kind: str) -> None:
    block = Image.Exif()
    block[274] = 6
    picture = read_bytes(tmp_path, encoded(Image.new("RGB", (6, 4)), kind, exif=block.tobytes()))
    assert picture.pixels.shape == (4, 6, 3)
    again = Image.Exif()
    again.load(picture.exif)
    assert again[274] == 6


GREY = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20
COLOUR = np.stack([GREY, GREY + 1, GREY + 2], axis=-1)
WIDE = COLOUR.astype(np.uint16) * 257
BILEVEL = np.where(GREY > 100, 255, 0).astype(np.uint8)
OPENED = Image.fromarray(COLOUR)
FEW = OPENED.quantize(12)
PALETTE_COLOURS = np.array(FEW.convert("RGB"))

FOREIGN = {
    "bilevel PNG": (encoded(Image.fromarray(BILEVEL).convert("1"), "PNG"), BILEVEL),
    "bilevel TIFF": (encoded(Image.fromarray(BILEVEL).convert("1"), "TIFF", compression="packbits"), BILEVEL),
    "palette PNG": (encoded(FEW, "PNG", bits=4), PALETTE_COLOURS),
    "palette TIFF": (encoded(FEW, "TIFF"), PALETTE_COLOURS),
    "transparent grey": (
        encoded(Image.fromarray(GREY), "PNG", transparency=40),
        np.stack([GREY, np.where(GREY == 40, 0, 255).astype(np.uint8)], axis=-1),
    ),
    "CMYK TIFF": (encoded(OPENED.convert("CMYK"), "TIFF"), COLOUR),
    "LZW TIFF": (encoded(OPENED, "TIFF", compression="tiff_lzw"), COLOUR),
    "white is zero": (tiff(GREY, photometric="miniswhite"), 255 - GREY),
    "big-endian": (tiff(WIDE, photometric="rgb", byteorder=">"), WIDE),
    "BigTIFF": (tiff(WIDE, photometric="rgb", bigtiff=True), WIDE),
    "zstd": (tiff(WIDE, photometric="rgb", compression="zstd", predictor=True), WIDE),
    "planes": (tiff(WIDE.transpose(2, 0, 1).copy(), photometric="rgb", planarconfig="separate"), WIDE),
    "double": (tiff(WIDE / 65535, photometric="rgb"), (WIDE / 65535).astype(np.float32)),
    "pages": (tiff(np.stack([GREY, GREY + 9]), photometric="minisblack"), GREY),
    "animated PNG": (encoded(OPENED, "PNG", save_all=True, append_images=[OPENED.rotate(180)]), COLOUR),
    "animated WebP": (
        encoded(OPENED, "WEBP", save_all=True, append_images=[OPENED.rotate(180)], lossless=True),
        COLOUR,
    ),
}


@pytest.mark.parametrize(("data", "expected"), FOREIGN.values(), ids=FOREIGN)
def test_files_of_other_programs(tmp_path: Path, data: bytes, expected: np.ndarray[Any, Any]) -> None:
    pixels = read_bytes(tmp_path, data).pixels
    assert pixels.dtype == expected.dtype
    np.testing.assert_array_equal(pixels, expected)


def test_fax_compression(tmp_path: Path) -> None:
    if not hasattr(imagecodecs, "ccittfax4_decode"):
        pytest.skip("needs imagecodecs 2026.3.6")
    data = encoded(Image.fromarray(BILEVEL).convert("1"), "TIFF", compression="group4")
    np.testing.assert_array_equal(read_bytes(tmp_path, data).pixels, BILEVEL)


def test_cmyk_jpeg_becomes_rgb_without_its_profile(tmp_path: Path) -> None:
    profile = RGB_PROFILE[:16] + b"CMYK" + RGB_PROFILE[20:]
    flat = Image.new("RGB", (16, 16), (200, 100, 50)).convert("CMYK")
    picture = read_bytes(tmp_path, encoded(flat, "JPEG", quality=95, icc_profile=profile))
    assert picture.icc_profile is None
    # a flat block is exact but for the rounding of its mean
    np.testing.assert_allclose(picture.pixels, np.full((16, 16, 3), (200, 100, 50)), atol=2)


def png_of_size(width: int, height: int, rows: bytes) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows, 1)), (b"IEND", b""))
    parts = (struct.pack(">I", len(b)) + n + b + struct.pack(">I", zlib.crc32(n + b)) for n, b in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


NOISE = Image.fromarray(random_pixels("uint8", 64, 64, 3))
DAMAGED = {
    "empty": (b"", "the file is empty"),
    "table": (b"a,b\n0,1\n", "not a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw picture"),
    "GIF": (encoded(OPENED, "GIF"), "not a JPEG, PNG, TIFF, WebP, NumPy, HEIC or raw picture"),
    "half a JPEG": (encoded(NOISE, "JPEG")[:2000], "truncated"),
    "half a PNG": (encoded(NOISE, "PNG")[:6000], "truncated"),
    "PNG header": (encoded(NOISE, "PNG")[:20], "truncated"),
    "half a WebP": (encoded(NOISE, "WEBP")[:1000], "truncated or damaged"),
    "half a TIFF": (encoded(NOISE, "TIFF")[:6000], "truncated"),
    "half a deflated TIFF": (tiff(np.asarray(NOISE), photometric="rgb", compression="zlib")[:6000], "truncated"),
    "TIFF header": (b"II*\0\x08\0\0\0", "truncated or damaged"),
    "bomb": (png_of_size(50_000, 50_000, b""), "2500000000 pixels"),
    "TIFF bomb": (tiff(np.zeros((4, 4), np.uint8)), "claims 4x4 pixels"),
    "integers": (tiff(np.zeros((4, 4), np.int32)), "TIFF with 1 samples of 32 bits .* not supported"),
    "five channels": (
        tiff(np.zeros((6, 7, 5), np.uint8), photometric="rgb", planarconfig="contig"),
        "TIFF with 5 samples",
    ),
    "volume": (
        tiff(np.zeros((6, 16, 16), np.uint8), photometric="minisblack", volumetric=True, tile=(1, 16, 16)),
        "TIFF with 1 samples",
    ),
}


@pytest.mark.parametrize(("data", "message"), DAMAGED.values(), ids=DAMAGED)
def test_damaged_files_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data: bytes, message: str
) -> None:
    # The limit is lowered, because a TIFF of 500 megapixels is too large for a test.
    if "4x4" in message:
        monkeypatch.setattr(pictures, "MAX_PIXELS", 15)
    with pytest.raises(FileFormatError, match=f"^{tmp_path / 'picture'}: .*{message}"):
        read_bytes(tmp_path, data)


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_our_size_limit_replaces_pillows_and_admits_200_megapixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    data = encoded(OPENED, kind)
    assert pictures.MAX_PIXELS > 200_000_000
    # Pillow's own limit, here one pixel, would refuse the picture.
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1)
    assert read_bytes(tmp_path, data).pixels.shape == COLOUR.shape
    assert Image.MAX_IMAGE_PIXELS == 1


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 4), np.int32), "uint8 or uint16, got int32"),
        ([[0.5]], "array of float .* list"),
        (np.zeros(4), r"shape .*\(4,\)"),
        (np.zeros((4, 4, 1)), r"C = 2, 3 or 4, got \(4, 4, 1\)"),
        (np.zeros((0, 4)), r"\(0, 4\)"),
        (np.array([[0.0, np.nan], [np.inf, 0.0]]), "finite, got 2 NaN or infinite"),
    ],
)
def test_impossible_images_are_refused(tmp_path: Path, image: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_picture(tmp_path / "picture.png", image)
    assert not list(tmp_path.iterdir())


IMAGE = np.full((4, 4), 0.5)


def test_existing_files_are_kept_without_force(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"old")
    for call in (lambda: write_picture(path, IMAGE), lambda: check_writable(path, force=False)):
        with pytest.raises(OutputError, match=r"picture\.png: the file exists; use force"):
            call()
    assert path.read_bytes() == b"old"
    check_writable(path, force=True)
    write_picture(path, IMAGE, force=True)
    assert read_picture(path).pixels.shape == (4, 4)


def test_places_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder.png").mkdir()
    faults = {
        "picture.bmp": "unknown picture extension '.bmp'; use one of .jpg",
        "picture": "unknown picture extension ''",
        "folder.png": "a folder has this name",
        "none/picture.png": "there is no folder",
    }
    for name, message in faults.items():
        with pytest.raises(OutputError, match=f"{name}: .*{message}"):
            check_writable(tmp_path / name, force=True)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match=r"picture\.png: .*not writable"):
        check_writable(tmp_path / "picture.png", force=True)


def test_what_a_format_cannot_hold_is_an_output_error(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"wide\.webp: cannot write 17000x1 pixels as WebP"):
        write_picture(tmp_path / "wide.webp", np.zeros((1, 17_000)))
    long = Picture(np.zeros(1, np.uint8), EXIF + bytes(70_000))
    assert not list(tmp_path.iterdir())
    with pytest.warns(RsdeblurWarning, match="EXIF block, whose [0-9]+ bytes are too many for JPEG"):
        write_picture(tmp_path / "picture.jpg", IMAGE, like=long)
    assert read_picture(tmp_path / "picture.jpg").exif is None


def test_real_photos_keep_their_exif(data_dir: Path, tmp_path: Path) -> None:
    photo = read_picture(data_dir / "real/shield-burst/images/0004.jpg")
    assert (photo.pixels.shape, photo.pixels.dtype) == ((1080, 1920, 3), np.uint8)
    assert photo.exif is not None
    small = as_float(photo.pixels[:64, :64])
    for extension in (".jpg", ".png", ".webp"):
        write_picture(tmp_path / f"copy{extension}", small, like=photo)
        exif = read_picture(tmp_path / f"copy{extension}").exif
        # Everything stays at its place, and the thumbnail is that of the result.
        assert len(exif) == len(photo.exif)
        assert values(exif)[0] == values(photo.exif)[0]
    write_picture(tmp_path / "copy.tif", small, like=photo)
    blocks = [Image.Exif(), Image.Exif()]
    for block, exif in zip(blocks, (photo.exif, read_picture(tmp_path / "copy.tif").exif), strict=True):
        block.load(exif)
    # Sizes, resolution and the place of a table are renewed. Compared as text: this file's aperture is NaN, which does
    # not equal itself.
    same = [{tag: value for tag, value in block.get_ifd(34665).items() if tag not in MOVED} for block in blocks]
    assert repr(sorted(same[0].items())) == repr(sorted(same[1].items()))


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_premultiplied_colours_are_divided_by_alpha(tmp_path: Path, dtype: str) -> None:
    full = 1 if dtype == "float32" else np.iinfo(dtype).max
    straight = np.array([[[0.2, 0.4, 0.8, 0.5], [0.2, 0.4, 0.8, 1.0], [0.0, 0.0, 0.0, 0.0]]]) * full
    stored = straight * [[[0.5, 0.5, 0.5, 1.0], [1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0]]]
    data = tiff(stored.astype(dtype), photometric="rgb", extrasamples=["assocalpha"])
    path = tmp_path / "a.tif"
    path.write_bytes(data)
    for in_place in (False, True):
        pixels = read_picture(path, in_place=in_place).pixels
        # Half of a level is two levels, as the stored values are cut to whole ones.
        np.testing.assert_allclose(pixels, straight, atol=2e-7 if full == 1 else 2)
        assert pixels.dtype == dtype


def test_values_of_another_scale_do_not_become_white(tmp_path: Path) -> None:
    """Those of solvers, which overshoot white, do."""
    path = tmp_path / "picture.png"
    with pytest.raises(InputError, match=r"up to 255, most of them beyond 1, .* divide the picture by its full scale"):
        write_picture(path, np.full((8, 8), 255.0))
    assert not path.exists()
    write_picture(path, np.full((8, 8), 1.1))
    write_picture(tmp_path / "light.tif", np.full((8, 8), 255.0), bits=32)


@pytest.mark.parametrize("dtype", ["int8", "int16"])
def test_samples_with_a_sign_are_refused(tmp_path: Path, dtype: str) -> None:
    with pytest.raises(FileFormatError, match="8 or 16 bits without sign"):
        read_bytes(tmp_path, tiff(np.zeros((3, 4), dtype), photometric="minisblack"))
