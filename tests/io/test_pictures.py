"""Pictures: reading returns what is stored, what is written comes back, whole or not at all.

Metadata are those of test_metadata.py, and what cannot be read is in test_unreadable.py.
"""

import os
from io import BytesIO
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from PIL import Image, ImageCms
from PIL.JpegImagePlugin import JpegImageFile

from rsdeblur import FileFormatError, InputError, OutputError, read_picture, write_picture
from rsdeblur.image.transfer import linear_profile
from rsdeblur.io import Picture, read_depths
from rsdeblur.io.metadata import Exif
from rsdeblur.io.picture_output import check_writable
from rsdeblur.io.pictures import read_psfs
from tests._util import files as seeds
from tests._util.files import tiff
from tests.installed import needs

RGB_PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
# It has the header fields of a real grey profile; nothing here reads more.
GREY_PROFILE = RGB_PROFILE[:16] + b"GRAY" + RGB_PROFILE[20:]


def random_pixels(dtype: str, *shape: int) -> np.ndarray[Any, Any]:
    pixels = np.random.default_rng(1).random(shape)
    scale = 1 if dtype == "float32" else np.iinfo(dtype).max
    return (pixels * scale).astype(dtype)


def encoded(image: Image.Image, kind: str, **options: Any) -> bytes:
    buffer = BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def read_bytes(tmp_path: Path, data: bytes) -> Picture:
    path = tmp_path / "picture"
    path.write_bytes(data)
    return read_picture(path)


LOSSLESS = [
    *((".png", dtype, channels) for dtype in ("uint8", "uint16") for channels in ((), (2,), (3,), (4,))),
    *(
        (suffix, dtype, channels)
        for suffix in (".tif", ".npy")
        for dtype in ("uint8", "uint16", "float32")
        for channels in ((), (2,), (3,), (4,))
    ),
    (".webp", "uint8", (3,)),
    (".webp", "uint8", (4,)),
]


@pytest.mark.parametrize(("extension", "dtype", "channels"), LOSSLESS)
@pytest.mark.parametrize("size", [(7, 5), (1, 1), (1, 3), (3, 1)])
def test_lossless_round_trip(tmp_path, extension, dtype, channels, size):
    pixels = random_pixels(dtype, *size, *channels)
    icc = None if extension == ".npy" else GREY_PROFILE if channels in ((), (2,)) else RGB_PROFILE
    path = tmp_path / f"picture{extension}"
    write_picture(
        path,
        pixels / np.float64(1 if dtype == "float32" else np.iinfo(dtype).max),
        like=Picture(pixels, icc_profile=icc),
    )
    again = read_picture(path)
    assert again.pixels.dtype == pixels.dtype
    np.testing.assert_array_equal(again.pixels, pixels)
    assert again.icc_profile == icc
    assert not again.pixels.flags.writeable


@pytest.mark.parametrize("channels", [(), (3,)])
def test_jpeg_round_trip(tmp_path: Path, channels: tuple[int, ...]) -> None:
    # A picture as smooth as a photo: random noise would measure JPEG, not the reader.
    y, x = np.mgrid[0:64, 0:48] / 64
    image = np.stack([y, x, 1 - y], axis=-1) if channels else y
    path = tmp_path / "picture.jpg"
    icc = RGB_PROFILE if channels else GREY_PROFILE
    write_picture(path, image, like=Picture(np.zeros(1, np.uint8), icc_profile=icc))
    again = read_picture(path)
    assert again.icc_profile == icc
    assert again.pixels.shape == image.shape
    # Quality 95 quantises the coefficients in steps of 1 to 12 levels.
    assert np.abs(again.pixels / 255 - image).max() < 4 / 255
    with Image.open(path) as opened:
        assert isinstance(opened, JpegImageFile)
        assert channels == () or {layer[1:3] for layer in opened.layer} == {(1, 1)}


@pytest.mark.parametrize(
    ("pixels", "like", "bits", "extension", "expected"),
    [
        ("float64", "float32", None, ".png", "uint16"),
        ("float64", "uint16", None, ".jpg", "uint8"),
        ("float64", "float32", None, ".webp", "uint8"),
        ("float64", "uint8", None, ".tif", "uint8"),
        ("float64", None, None, ".tif", "uint8"),
        *(("uint16", None, None, extension, "uint16") for extension in (".png", ".tif", ".npy")),
        ("uint16", None, None, ".jpg", "uint8"),
        *(
            ("float64", "uint16", bits, ".tif", dtype)
            for bits, dtype in ((8, "uint8"), (16, "uint16"), (32, "float32"))
        ),
    ],
)
def test_depth_is_what_is_asked_for_or_the_next_lower_one(tmp_path, pixels, like, bits, extension, expected):
    """That of `bits`, of `like` or of integers, and 8 bits otherwise."""
    path = tmp_path / f"picture{extension}"
    given = Picture(np.zeros(1, like)) if like else None
    write_picture(path, np.zeros((4, 4), pixels), like=given, bits=bits)
    assert read_picture(path).pixels.dtype == expected


WRITTEN: dict[str, tuple[Any, str, int | None, Any]] = {
    **{
        f"{np.dtype(dtype)} is clipped and rounded": (
            *(np.array([[-1.0, 0.0, 7.0, 1.0, 0.25]], dtype), ".png", 16),
            [[0, 0, 65535, 65535, 16384]],
        )
        for dtype in (np.float16, np.float32, np.float64)
    },
    "32 bits keep what is brighter than white": (np.array([[-1, 0.25, 7]], "f"), ".tif", 32, [[-1, 0.25, 7]]),
    "light has no end": (np.full((8, 8), 255.0), ".tif", 32, np.full((8, 8), 255.0)),
    "solvers overshoot white": (np.full((8, 8), 1.1), ".png", None, np.full((8, 8), 255)),
    "JPEG drops alpha": (np.array([[[0.8, 0]] * 4] * 4), ".jpg", None, np.full((4, 4), 204)),
    "JPEG keeps colours": (np.array([[[0.8, 0.8, 0.8, 0]] * 4] * 4), ".jpg", None, np.full((4, 4, 3), 204)),
}


@pytest.mark.parametrize(("image", "extension", "bits", "expected"), WRITTEN.values(), ids=WRITTEN)
def test_what_is_stored(tmp_path: Path, image: Any, extension: str, bits: Any, expected: Any) -> None:
    write_picture(tmp_path / f"picture{extension}", image, bits=bits)
    np.testing.assert_array_equal(read_picture(tmp_path / f"picture{extension}").pixels, expected)


@pytest.mark.parametrize("extension", [".jpeg", ".PNG", ".tiff", ".webp"])
def test_a_profile_of_another_colour_space_is_left_out(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"picture{extension}"
    write_picture(path, np.zeros((4, 4, 3)), like=Picture(np.zeros(1, np.uint8), None, GREY_PROFILE))
    assert read_picture(path).icc_profile is None


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
    "tiles": (tiff(np.tile(GREY, (7, 8)), tile=(16, 16)), np.tile(GREY, (7, 8))),
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


def test_pillow_does_not_warn_of_large_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Beyond this it warns, and beyond twice this it refuses.
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", COLOUR.shape[0] * COLOUR.shape[1] - 1)
    assert read_bytes(tmp_path, encoded(OPENED, "PNG")).pixels.shape == COLOUR.shape


@pytest.mark.parametrize(
    ("image", "name", "bits", "message"),
    [
        (np.zeros((4, 4), np.int32), "a.png", None, "int32"),
        (np.zeros((4, 4, 1)), "a.png", None, r"C = 2, 3 or 4"),
        (np.zeros((0, 4)), "a.png", None, r"\(0, 4\)"),
        (np.array([[0.0, np.nan], [np.inf, 0.0]]), "a.png", None, "finite, got 2"),
        (np.full((8, 8), 255.0), "a.png", None, "up to 255, .* full scale"),
        (np.zeros((1, 17_000)), "wide.webp", None, "wide.webp: cannot write 17000x1"),
        (np.zeros((4, 4)), "a.jpg", 16, "a.jpg: JPEG cannot hold 16"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, image: Any, name: str, bits: Any, message: str) -> None:
    with pytest.raises((InputError, OutputError), match=message):
        write_picture(tmp_path / name, image, bits=bits)
    assert not list(tmp_path.iterdir())


IMAGE = np.full((4, 4), 0.5)


def test_existing_files_are_kept_without_force(tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"old")
    for call in (
        lambda: write_picture(path, IMAGE),
        lambda: check_writable(path, force=False),
    ):
        with pytest.raises(OutputError, match=r"picture\.png: the file exists"):
            call()
    assert path.read_bytes() == b"old"
    check_writable(path, force=True)
    write_picture(path, IMAGE, force=True)
    assert read_picture(path).pixels.shape == (4, 4)


def test_places_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder.png").mkdir()
    faults = {
        "picture.bmp": "unknown picture extension",
        "folder.png": "it is a folder",
        "none/picture.png": "there is no folder",
    }
    for name, message in faults.items():
        with pytest.raises(OutputError, match=f"{name}: .*{message}"):
            check_writable(tmp_path / name, force=True)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match=r"picture\.png: .*not writable"):
        check_writable(tmp_path / "picture.png", force=True)


HEIGHT, WIDTH = 40, 64


def exif_of(orientation: int) -> bytes:
    block = Image.Exif()
    block[0x0112], block[0x010F] = orientation, "Maker"
    block.get_ifd(0x8769)[0x829A] = 0.125
    return block.tobytes()


class TestHeif:
    @pytest.mark.parametrize("orientation", [1, 3, 6, 8])
    def test_the_sensors_axes_are_kept(self, tmp_path: Path, orientation: int) -> None:
        """Viewers turn the picture, as they do a JPEG of the same phone; the pixels stay in the sensor's axes."""
        heif = needs("heif")
        heif.register_heif_opener()
        stored = np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3)).astype(np.uint8)
        stored = np.kron(stored[::8, ::8], np.ones((8, 8, 1), np.uint8))
        Image.fromarray(stored).save(tmp_path / "a.heic", quality=-1, exif=exif_of(orientation))
        picture = read_picture(tmp_path / "a.heic")
        # Lossless but for the conversion to YCbCr and back.
        assert np.abs(picture.pixels.astype(int) - stored).mean() < 3
        exif = Exif(picture.exif)
        assert (exif.orientation, exif.text(0x010F), exif.exposure) == (orientation, "Maker", 0.125)
        write_picture(tmp_path / "b.jpg", picture.pixels / 255.0, like=picture)
        assert Exif(read_picture(tmp_path / "b.jpg").exif).orientation == orientation

    def test_ten_bits_become_sixteen_of_full_range(self, tmp_path: Path) -> None:
        heif = needs("heif")
        levels = np.zeros((HEIGHT, WIDTH, 3), "<u2")
        levels[:, WIDTH // 2 :] = 65535
        heif.from_bytes("RGB;16", (WIDTH, HEIGHT), levels.tobytes()).save(tmp_path / "a.heic", quality=-1)
        picture = read_picture(tmp_path / "a.heic")
        assert (picture.pixels.dtype, picture.pixels.min(), picture.pixels.max()) == (np.uint16, 0, 65535)


def dng(path: Path, mosaic: np.ndarray, orientation: int = 1) -> Path:
    path.write_bytes(seeds.dng(mosaic, orientation))
    return path


def mosaic(red: int, green: int, blue: int) -> np.ndarray:
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.where((y + x) % 2, green, np.where(y % 2, blue, red))


class TestRaw:
    def test_light_is_linear_and_the_colours_are_the_cameras(self, tmp_path: Path) -> None:
        needs("raw")
        for scale in (1, 2, 4):
            picture = read_picture(dng(tmp_path / "a.dng", mosaic(16000, 8000, 4000) // scale))
            # The camera's matrix has four decimals.
            np.testing.assert_allclose(picture.pixels[20, 30], np.array([16000, 8000, 4000]) / scale, rtol=1e-3)
        assert (picture.transfer, picture.pixels.dtype, picture.pixels.shape) == ("linear", np.uint16, (40, 64, 3))

    @pytest.mark.parametrize("orientation", [1, 6])
    def test_the_sensors_axes_are_kept(self, tmp_path: Path, orientation: int) -> None:
        needs("raw")
        picture = read_picture(dng(tmp_path / "a.dng", mosaic(16000, 8000, 4000), orientation))
        assert picture.pixels.shape == (HEIGHT, WIDTH, 3)
        assert Exif(picture.exif).orientation == orientation

    def test_the_result_says_that_it_is_linear(self, tmp_path: Path) -> None:
        needs("raw")
        picture = read_picture(dng(tmp_path / "a.dng", mosaic(16000, 8000, 4000)))
        write_picture(tmp_path / "b.tif", picture.pixels / 65535.0, like=picture)
        again = read_picture(tmp_path / "b.tif")
        np.testing.assert_array_equal(again.pixels, picture.pixels)
        assert again.icc_profile == picture.icc_profile == linear_profile()
        assert again.transfer == "linear"

    def test_the_profile_is_linear(self) -> None:
        profile = ImageCms.ImageCmsProfile(BytesIO(linear_profile()))
        grey = Image.new("RGB", (1, 1), (55, 55, 55))
        shown = ImageCms.profileToProfile(grey, profile, ImageCms.createProfile("sRGB"))
        # 255 (1.055 (55 / 255)^(1 / 2.4) - 0.055) = 127.95
        assert shown is not None
        assert shown.getpixel((0, 0)) == (128, 128, 128)

    def test_damaged(self, tmp_path: Path) -> None:
        needs("raw")
        path = dng(tmp_path / "a.dng", mosaic(16000, 8000, 4000))
        for keep in (600, 3000):
            path.write_bytes(path.read_bytes()[:keep])
            with pytest.raises(FileFormatError, match=r"a\.dng"):
                read_picture(path)


METRES = np.array([[0.9, 1.2, 1.5], [2.5, 3.0, 60.0]])
SHAPE = (40, 60, 3)
WEIGHTS = np.arange(12, dtype=np.uint8).reshape(3, 4)


def saved(folder: Path, name: str, values: Any) -> Path:
    path = folder / name
    if isinstance(values, bytes):
        path.write_bytes(values)
    elif path.suffix == ".npy":
        np.save(path, values)
    else:
        Image.fromarray(values).save(path)
    return path


@pytest.mark.parametrize(
    ("name", "dtype"),
    [("d.npy", np.float32), ("d.tiff", np.float32), *((f"d.{suffix}", np.uint16) for suffix in ("npy", "png", "tiff"))],
)
def test_floats_are_metres_and_whole_numbers_millimetres(tmp_path: Path, name: str, dtype: type) -> None:
    path = saved(tmp_path, name, ((1 if dtype == np.float32 else 1000) * METRES).astype(dtype))
    # Single precision, or whole millimetres.
    np.testing.assert_allclose(read_depths(path), METRES, rtol=1e-7)


@pytest.mark.parametrize("unknown", [0.0, np.nan, np.inf])
def test_an_unknown_depth_is_that_of_the_nearest_place(tmp_path: Path, unknown: float) -> None:
    path = saved(tmp_path, "depth.npy", np.array([[1.0, unknown, unknown], [1.0, unknown, 3.0]]))
    np.testing.assert_array_equal(read_depths(path)[:, [0, 2]], [[1.0, 3.0], [1.0, 3.0]])


def test_depths_of_8_bits_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match=r"depth\.png: .*16 bits in mm"):
        read_depths(saved(tmp_path, "depth.png", np.ones((2, 3), np.uint8)))


def test_arrays_and_pictures_of_a_psf_agree(tmp_path: Path) -> None:
    expected = np.pad(WEIGHTS / WEIGHTS.sum(), ((0, 0), (0, 1)))
    rgba = np.stack([WEIGHTS, WEIGHTS, WEIGHTS, 0 * WEIGHTS], axis=-1)
    for name, values in {"k.npy": WEIGHTS, "grey.png": WEIGHTS, "rgba.png": rgba}.items():
        bank = read_psfs(saved(tmp_path, name, values), SHAPE)
        # Pictures are read in single precision.
        np.testing.assert_allclose(bank.kernels[0, 0], expected, rtol=1e-6)
        assert (bank.rows.tolist(), bank.cols.tolist()) == ([19.5], [29.5])


def test_several_psfs(tmp_path: Path) -> None:
    kernels = np.random.default_rng(0).random((2, 3, 5, 7))
    bank = read_psfs(saved(tmp_path, "k.npy", kernels), SHAPE)
    assert bank.kernels.shape == kernels.shape
    bank.save(tmp_path / "bank.npz")
    stored = read_psfs(tmp_path / "bank.npz", SHAPE)
    for name in ("kernels", "rows", "cols"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(bank, name))
