"""HEIC and raw files: pixels are in the sensor's axes, and those of raw files linear in light."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from rsdeblur.errors import FileFormatError
from rsdeblur.image.profile import linear_profile
from rsdeblur.io import read_picture, write_picture
from rsdeblur.io.exif import Exif
from tests._util import files as seeds
from tests.installed import needs

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
