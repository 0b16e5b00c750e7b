"""Pictures that stay in their files: maps equal what is read, and a file appears whole or not at all."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms

from rsdeblur.errors import FileFormatError, OutputError
from rsdeblur.io.picture_output import picture_to_fill, write_picture
from rsdeblur.io.pictures import Picture, read_picture

PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
SHAPES = ((5, 7), (5, 7, 2), (5, 7, 3), (5, 7, 4))


def exif_block() -> bytes:
    block = Image.Exif()
    block[271], block[274] = "Maker", 6
    block.get_ifd(34665).update({33434: 0.25})
    return block.tobytes()


def pixels_of(dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    values = np.random.default_rng(0).random(shape) * (1 if dtype == "float32" else np.iinfo(dtype).max)
    return values.astype(dtype)


def exif_of(picture: Picture) -> tuple[object, object, object]:
    block = Image.Exif()
    block.load(picture.exif)
    return block[271], block[274], block.get_ifd(34665)[33434]


@pytest.mark.parametrize("suffix", [".tif", ".npy"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_filled_in_place_comes_back(tmp_path: Path, suffix: str, dtype: str, shape: tuple[int, ...]) -> None:
    path, pixels = tmp_path / f"picture{suffix}", pixels_of(dtype, shape)
    like = Picture(pixels, exif_block() if suffix == ".tif" else None, PROFILE)
    with picture_to_fill(path, shape, like=like, in_place=True) as out:
        assert isinstance(out, np.memmap)
        out[...] = pixels
    for in_place in (False, True):
        picture = read_picture(path, in_place=in_place)
        assert isinstance(picture.pixels, np.memmap) == in_place
        assert not picture.pixels.flags.writeable
        np.testing.assert_array_equal(picture.pixels, pixels)
        if suffix == ".tif":
            assert exif_of(picture) == ("Maker", 6, 0.25)
            # A profile for colour does not fit grey.
            assert (picture.icc_profile == PROFILE) == (len(shape) == 3 and shape[2] > 2)


@pytest.mark.parametrize("suffix", [".tif", ".npy", ".png"])
def test_a_failure_leaves_the_old_file_alone(tmp_path: Path, suffix: str) -> None:
    path, pixels = tmp_path / f"picture{suffix}", pixels_of("uint8", (5, 7, 3))
    write_picture(path, pixels)
    before = path.read_bytes()

    def fill() -> None:
        with picture_to_fill(path, pixels.shape, like=Picture(pixels), force=True, in_place=True) as out:
            out[...] = 0
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill()
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == before
    with pytest.raises(OutputError, match="exists"), picture_to_fill(path, pixels.shape, like=Picture(pixels)):
        pass


@pytest.mark.parametrize(
    "options",
    [
        {"compression": "zlib"},
        {"byteorder": ">"},
        {"photometric": "miniswhite"},
        {"planarconfig": "separate", "photometric": "rgb"},
        {"tile": (16, 16)},
    ],
    ids=str,
)
def test_what_must_be_decoded_is_read(tmp_path: Path, options: dict[str, object]) -> None:
    shape = (3, 32, 48) if "planarconfig" in options else (32, 48)
    tifffile.imwrite(tmp_path / "picture.tif", pixels_of("uint16", shape), **options)
    picture = read_picture(tmp_path / "picture.tif", in_place=True)
    assert not isinstance(picture.pixels, np.memmap)
    np.testing.assert_array_equal(picture.pixels, read_picture(tmp_path / "picture.tif").pixels)


def npy(array: np.ndarray) -> bytes:
    buffer = BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


DAMAGED = {
    "three dimensions too many": (npy(np.zeros((2, 2, 2, 2, 2), np.uint8)), "shape"),
    "five channels": (npy(np.zeros((2, 2, 5), np.uint8)), "shape"),
    "empty": (npy(np.zeros((0, 2), np.uint8)), "shape"),
    "doubles": (npy(np.zeros((2, 2))), "float64"),
    "columns first": (npy(np.asfortranarray(np.zeros((3, 2), np.uint8))), "Fortran"),
    "objects": (npy(np.zeros((2, 2), np.uint8)).replace(b"'|u1'", b"'|O' "), "type object"),
    "cut off": (npy(np.zeros((20, 20), np.uint8))[:-1], "ends within"),
    "too large": (npy(np.zeros((2, 2), np.uint8)).replace(b"(2, 2), }      ", b"(99999, 99999)}"), "limit"),
    "header cut off": (npy(np.zeros((2, 2), np.uint8))[:20], "truncated or damaged"),
}


@pytest.mark.parametrize("in_place", [False, True])
@pytest.mark.parametrize(("data", "message"), DAMAGED.values(), ids=DAMAGED)
def test_damaged_arrays_are_refused_by_name(tmp_path: Path, data: bytes, message: str, in_place: bool) -> None:
    path = tmp_path / "picture.npy"
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=rf"^{path}: .*{message}"):
        read_picture(path, in_place=in_place)


def test_a_cut_tiff_is_refused_in_place_too(tmp_path: Path) -> None:
    path = tmp_path / "picture.tif"
    tifffile.imwrite(path, pixels_of("uint8", (64, 64)))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(FileFormatError, match="ends within"):
        read_picture(path, in_place=True)


@pytest.mark.parametrize(
    ("tag", "value", "message"),
    [
        (tifffile.TIFF.TAGS["ImageWidth"], 0, "no pixels|damaged"),
        (tifffile.TIFF.TAGS["SamplesPerPixel"], 1, "not supp|damaged"),
    ],
)
def test_what_is_no_picture_is_refused_in_place_too(tmp_path: Path, tag: int, value: int, message: str) -> None:
    """No width, or one sample per pixel along an axis of its own."""
    path = tmp_path / "picture.tif"
    tifffile.imwrite(path, pixels_of("uint8", (5, 7, 3)), photometric="rgb")
    with tifffile.TiffFile(path, mode="r+b") as file:
        file.pages.first.tags[tag].overwrite(value)
    for in_place in (False, True):
        with pytest.raises(FileFormatError, match=message):
            read_picture(path, in_place=in_place)
