"""Work sizes: the picture is reduced, and the camera with it."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from rsdeblur import Camera, InputError, RsdeblurWarning
from rsdeblur.image.encoded import EncodedImage, reduced

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


@pytest.mark.parametrize("channels", [(), (1,), (2,), (3,), (4,)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_constants_stay(channels, dtype):
    value, peak = (0.25, 1) if dtype == np.float64 else (np.iinfo(dtype).max // 4, np.iinfo(dtype).max)
    small, _ = reduced(np.full((90, 120, *channels), value, dtype=dtype), CAMERA, 31)
    assert small.shape == (23, 31, *channels)
    assert small.dtype == np.float32
    np.testing.assert_allclose(small, value / peak, rtol=1e-6)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_grey_is_the_mean_light_without_alpha(channels):
    values = np.random.default_rng(0).integers(0, 256, (9, 7, channels), dtype=np.uint8)
    encoded = EncodedImage.of(values, "srgb")
    # Rounding of sums of three values up to 1.
    np.testing.assert_allclose(encoded.grey(slice(2, 8)), encoded.linear(slice(2, 8)).mean(axis=2), atol=1e-6)


def test_small_pictures_keep_their_size():
    picture = np.random.default_rng(0).random((90, 120))
    same, camera = reduced(picture, CAMERA, 2048)
    np.testing.assert_array_equal(same, picture.astype(np.float32))
    assert camera is CAMERA


def test_the_order_of_bytes_does_not_matter():
    values = np.arange(12, dtype=np.uint16).reshape(3, 4)
    np.testing.assert_array_equal(EncodedImage.of(values.astype(">u2")).values, EncodedImage.of(values).values)


@pytest.mark.parametrize(("scale", "transfer"), [(255.0, "auto"), (1.0, "auto"), (255.0, "linear")])
def test_floats_like_encoded_values_warn(scale, transfer):
    values = np.arange(256.0).reshape(16, 16) / 255.0 * scale
    doubted = scale > 1 and transfer == "auto"
    with pytest.warns(RsdeblurWarning, match="of up to 255") if doubted else nullcontext():
        EncodedImage.of(np.round(values) if scale > 1 else values, transfer)


def test_what_is_not_the_cameras_is_refused():
    with pytest.raises(InputError, match="turned by a quarter"):
        reduced(np.zeros((120, 90)), CAMERA, 60)
    with pytest.raises(InputError, match="side"):
        reduced(np.zeros((90, 120)), CAMERA, 0)
