"""Pictures made periodic: the picture itself does not change, and no seam is left."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from benchmarks.paper.continuations import reflected, tapered
from rsdeblur import Camera, Deconvolver, Exposure, InputError, PsfBank, deblur, simulate
from rsdeblur.deconv.boundary import extended, extended_shape, smooth
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

H, W = 60, 85


@pytest.fixture
def light():
    return np.random.default_rng(0).random((H, W, 3), dtype=np.float32)


@pytest.fixture
def bank():
    kernels = np.random.default_rng(1).random((2, 2, 9, 15), dtype=np.float32)
    return PsfBank(kernels / kernels.sum(axis=(2, 3), keepdims=True), [20.0, 40.0], [20.0, 60.0])


def test_shape_is_as_announced(light, bank):
    longer = extended(light, bank)
    assert longer.shape == extended_shape(light.shape, bank)
    assert longer.dtype == np.float32
    np.testing.assert_array_equal(longer[:H, :W], light)
    assert longer.shape[0] >= H + 9
    assert longer.shape[1] >= W + 15


def test_a_constant_stays_one(bank):
    flat = np.full((H, W, 1), 0.3, dtype=np.float32)
    for longer in (extended(flat, bank), reflected(flat, H + 7, W + 4), tapered(flat, bank.kernels[0, 0])):
        np.testing.assert_allclose(longer, 0.3, atol=1e-6)


def test_reflection_repeats_the_border_pixels(light):
    longer = reflected(light, H + 7, W + 4)
    np.testing.assert_array_equal(longer[H : H + 4, :W], light[: H - 5 : -1])
    np.testing.assert_array_equal(longer[H + 4 :, :W], light[2::-1])
    np.testing.assert_array_equal(longer[:, W : W + 2], longer[:, W - 1 : W - 3 : -1])


@pytest.mark.parametrize("shape", [(1, 40, 1), (40, 1, 1), (1, 1, 1)])
def test_lines_of_pixels_are_filled_too(shape):
    line = np.random.default_rng(0).random(shape, dtype=np.float32)
    longer = smooth(line, shape[0] + 5, shape[1] + 7)
    np.testing.assert_array_equal(longer[: shape[0], : shape[1]], line)
    assert line.min() - 1e-6 <= longer.min()
    assert longer.max() <= line.max() + 1e-6


def test_the_smooth_filling_has_no_laplacian(light):
    longer = smooth(light, H + 11, W + 9).astype(np.float64)
    laplacian = sum(np.roll(longer, by, axis) for axis in (0, 1) for by in (-1, 1)) - 4 * longer
    # Not where two parts meet, and not along their straight sides: each part is harmonic on its own.
    for part in (np.s_[H:, 1 : W - 1], np.s_[1 : H - 1, W:], np.s_[H + 1 : -1, W + 1 : -1]):
        np.testing.assert_allclose(laplacian[part], 0, atol=1e-5)
    # A harmonic function stays within the range of its border.
    assert light.min() - 1e-6 <= longer.min()
    assert longer.max() <= light.max() + 1e-6


def test_the_taper_leaves_what_no_blur_reaches(light):
    kernel = np.full((9, 15), 1 / 135)
    faded = tapered(light, kernel)
    np.testing.assert_allclose(faded[9:-9, 15:-15], light[9:-9, 15:-15], atol=1e-6)
    assert np.abs(faded[0] - light[0]).mean() > 0.1


def test_tapers_of_pictures_smaller_than_two_psfs(light):
    assert np.isfinite(tapered(light[:12, :20], np.full((9, 15), 1 / 135))).all()


@pytest.fixture(scope="module")
def capture():
    """A capture with a bright side, whose seam rings far."""
    log, camera, exposure = hand_shake(0.4, seed=0), Camera(160, 120, 300.0), Exposure(0.05, 0.04)
    sharp = scene(180, 220)
    sharp[:, :60] = 0.9
    return simulate(sharp, log, camera, exposure, noise=1e-3), (log, camera, exposure)


def test_an_open_border_beats_the_seam(capture):
    pictures, capture = capture

    def psnr(border):
        settings = {"prior": "tv", "weight": 1e-3, "nsr": 3e-3, "border": border, "check": False}
        image = deblur(pictures.blurred, *capture, **settings).image
        return peak_signal_noise_ratio(pictures.rolling, image, data_range=1.0)

    assert psnr("unknown") > psnr("periodic") + 0.5


def test_rowwise_has_no_use_for_alternatives(shaky_log):
    camera, exposure = Camera(160, 120, 300.0), Exposure(0.05, 0.04)
    with pytest.raises(InputError, match="takes no border unknown"):
        deblur(np.zeros((120, 160)), shaky_log(), camera, exposure, mode="rowwise", border="unknown")
    with pytest.raises(InputError, match="border must be one of"):
        deblur(np.zeros((120, 160)), shaky_log(), camera, exposure, border="mirror", prior="wiener")
    with pytest.raises(InputError, match="border"):
        Deconvolver(PsfBank.for_picture(np.ones((1, 1)), (8, 8)), (8, 8), border="unknown")
