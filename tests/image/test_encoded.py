"""Encoded pictures: the curves, the upright frame, work sizes, and floats that are probably encoded values."""

import warnings
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from skimage import data
from skimage.transform import resize
from skimage.util import img_as_float, img_as_ubyte

from rsdeblur import Camera, Exposure, RsdeblurWarning, from_linear, hand_shake, scene, simulate, to_linear
from rsdeblur.image.encoded import EncodedImage, reduced, upright
from rsdeblur.image.transfer import normalized

CAMERA = Camera(120, 90, 200.0, readout_time=0.02)


def test_the_camera_follows():
    """A point on the optical axis stays on it; pixel centres are at integers."""
    y, x = np.mgrid[:90, :120]
    spot = np.exp(-((x - CAMERA.principal_point[0]) ** 2 + (y - CAMERA.principal_point[1]) ** 2) / 72)
    small, camera = reduced(spot, CAMERA, 60)
    assert small.shape == (camera.height, camera.width) == (45, 60)
    assert camera.focal_length == (100.0, 100.0)
    assert camera.readout_time == CAMERA.readout_time
    rows, cols = np.mgrid[:45, :60]
    centre = (small * cols).sum() / small.sum(), (small * rows).sum() / small.sum()
    np.testing.assert_allclose(centre, camera.principal_point, atol=1e-3)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_grey_is_the_mean_light_without_alpha(channels):
    values = np.random.default_rng(0).integers(0, 256, (9, 7, channels), dtype=np.uint8)
    encoded = EncodedImage.of(values, "srgb")
    # Rounding of sums of three values up to 1.
    np.testing.assert_allclose(encoded.grey(slice(2, 8)), encoded.linear(slice(2, 8)).mean(axis=2), atol=1e-6)


@pytest.mark.parametrize("transfer", ["auto", "linear", "srgb"])
def test_whole_floats_warn(transfer):
    values = np.arange(256.0).reshape(16, 16)
    with pytest.warns(RsdeblurWarning, match="whole numbers") if transfer == "auto" else nullcontext():
        EncodedImage.of(values, transfer)


def is_doubted(picture):
    """Return whether floats are taken for encoded values."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RsdeblurWarning)
        EncodedImage.of(picture)
    return any('transfer="srgb"' in str(warning.message) for warning in caught)


PHOTOS = sorted(path for path in Path(data.__file__).parent.iterdir() if path.suffix in (".png", ".jpg"))[::2]


@pytest.mark.parametrize("path", PHOTOS, ids=lambda path: path.name)
def test_floats_of_8_bits_warn_and_light_does_not(path):
    with Image.open(path) as opened:
        stored = np.asarray(opened if opened.mode != "1" else opened.convert("L"))
    # Drawings of a few greys, which look the same with any transfer.
    drawn = path.stem in ("chessboard_GRAY", "chessboard_RGB", "phantom")
    values = img_as_float(stored)
    assert [is_doubted(values.astype(kind)) for kind in (np.float64, np.float32, np.float16)] == [not drawn] * 3
    assert not is_doubted(to_linear(values, "srgb"))


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_simulated_light_does_not_warn_and_its_photo_does(noise):
    log, exposure = hand_shake(0.4, strength=0.3, seed=3), Exposure(0.1, 0.05)
    for sharp in (scene(120, 160), to_linear(img_as_float(data.coffee()[:120, :160]), "srgb")):
        blurred = simulate(sharp, log, Camera(120, 80, 150.0), exposure, noise=noise).blurred.clip(0, 1)
        assert not is_doubted(blurred)
        assert is_doubted(img_as_float(img_as_ubyte(from_linear(blurred, "srgb"))))


@pytest.mark.parametrize("scale", [1.0, 0.83, 0.5, 1 / 3, 0.21, 1.4])
def test_pictures_are_reduced_as_by_scikit_image(scale):
    light = np.random.default_rng(0).random((97, 131), dtype=np.float32)
    camera = Camera(131, 97, 100.0)
    small = camera.scaled(scale)
    expected = resize(light, (small.height, small.width), order=1, anti_aliasing=True)
    # The same bits here; versions of either library may round otherwise.
    np.testing.assert_allclose(upright(light, camera, scale), expected, atol=1e-6)
    # Horizontal readout turns the reduced picture a quarter clockwise.
    turned = upright(light, replace(camera, readout_direction="left-right"), scale)
    np.testing.assert_allclose(turned, np.rot90(expected, -1), atol=1e-6)


CURVES = ["linear", "srgb", 2.2, 0.5, 1.0]


@pytest.fixture
def values():
    return np.linspace(-1.0, 2.0, 3001, dtype=np.float32).reshape(1, -1)


@pytest.mark.parametrize("transfer", CURVES)
def test_there_and_back(values, transfer):
    # Powers of float32 values: relative roundings of 6e-8 times exponents up to 2.4, twice.
    np.testing.assert_allclose(from_linear(to_linear(values, transfer), transfer), values, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(to_linear(from_linear(values, transfer), transfer), values, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("transfer", CURVES)
def test_increasing_odd_and_fixed_at_zero_and_one(values, transfer):
    for curve in (to_linear, from_linear):
        coded = curve(values, transfer)
        assert coded.dtype == np.float32
        assert coded.shape == values.shape
        assert np.all(np.diff(coded) > 0)
        np.testing.assert_array_equal(curve(-values, transfer), -coded)
        np.testing.assert_allclose(curve(np.array([0, 1], np.float32), transfer), [0, 1], atol=1e-7)


@pytest.mark.parametrize(
    ("stored", "light"), [(0.5, 0.21404114), (10 / 255, 0.0030352698), (11 / 255, 0.0033465358), (0.735357, 0.5)]
)
def test_known_values_of_srgb(stored, light):
    assert to_linear(np.float32([stored]), "srgb")[0] == pytest.approx(light, rel=3e-6)
    assert from_linear(np.float32([light]), "srgb")[0] == pytest.approx(stored, rel=3e-6)


def test_normalized_light_fills_the_range_only_if_it_overshoots():
    light = np.linspace(-0.5, 2.0, 10001, dtype=np.float32)
    squeezed = normalized(light)
    assert (squeezed.min(), squeezed.max()) == (0.0, 1.0)
    # All but the outliers are scaled alike: 0.1 % at either end are clipped.
    inside = (squeezed > 0) & (squeezed < 1)
    assert np.count_nonzero(~inside) == pytest.approx(20, abs=4)
    assert np.ptp(np.diff(squeezed[inside])) < 1e-5
    tame = light[(light > 0.1) & (light < 0.9)]
    np.testing.assert_array_equal(normalized(tame), tame)
