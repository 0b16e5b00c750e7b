"""deconvolve(): own PSFs with every prior, against deblur() and against pictures blurred by SciPy."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur import Camera, Exposure, PsfBank, RsdeblurWarning, deblur, deconvolve, simulate
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake
from tests.installed import PRIORS

# A curved stroke, not symmetric in any way.
KERNEL = np.zeros((9, 11))
KERNEL[[1, 2, 3, 4, 5, 6, 7], [1, 2, 3, 4, 6, 8, 9]] = 1, 1, 2, 3, 3, 2, 1
KERNEL /= KERNEL.sum()


@pytest.fixture(scope="module")
def pictures() -> tuple[np.ndarray, np.ndarray]:
    """Return a sharp picture, and it blurred with noise of 0.01; the blur reads no pixel outside."""
    wide = scene(150, 170)
    blurred = np.stack([ndimage.convolve(plane, KERNEL) for plane in np.moveaxis(wide, -1, 0)], axis=-1)
    noise = np.random.default_rng(0).normal(0, 0.01, blurred.shape)
    inside = np.s_[16:-16, 16:-16]
    return wide[inside], (blurred + noise).astype(np.float32)[inside]


def error(picture: np.ndarray, truth: np.ndarray) -> float:
    inside = np.s_[12:-12, 12:-12]
    return float(np.sqrt(np.mean(np.square((picture - truth)[inside]))))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("prior", ["wavelet", "hyper-laplacian", "wiener"])
def test_a_black_picture_stays_black(prior) -> None:
    np.testing.assert_allclose(deconvolve(np.zeros((40, 50)), KERNEL, prior=prior).image, 0.0, atol=1e-6)


@pytest.mark.filterwarnings("error")
def test_kernels_with_negative_values_have_strengths(pictures) -> None:
    sharpening = np.array([[0.0, -1, 0], [-1, 5, -1], [0, -1, 0]])
    assert np.isfinite(deconvolve(pictures[1], sharpening).image).all()


@pytest.mark.parametrize("prior", PRIORS)
def test_every_prior_undoes_a_known_blur(pictures: tuple[np.ndarray, np.ndarray], prior: str) -> None:
    sharp, blurred = pictures
    result = deconvolve(blurred, KERNEL, prior=prior)
    # Measured: at most 0.62 of the error of the input; a mirrored kernel doubles the error of the input.
    assert error(result.image, sharp) < 0.75 * error(blurred, sharp)
    assert (result.bands, result.strips, result.check) == (1, 1, None)
    assert result.coverage.all()


def test_it_is_what_deblur_does_with_the_same_psfs() -> None:
    camera, exposure, log = Camera(96, 80, 110.0, readout_time=0.03), Exposure(0.05, 1 / 30), hand_shake(0.2, seed=3)
    blurred = simulate(scene(120, 136), log, camera, exposure).blurred
    for strengths in ({"prior": "wiener", "nsr": 0.02}, {"prior": "tv", "weight": 0.01, "nsr": 0.01}):
        options = {**strengths, "border": "blend"}
        by_motion = deblur(blurred, log, camera, exposure, bands=3, strips=2, **options)
        by_psf = deconvolve(blurred, by_motion.psfs, **options)
        np.testing.assert_array_equal(by_psf.image, by_motion.image)
        assert (by_psf.bands, by_psf.strips) == (3, 2)


def test_automatic_strengths_use_a_given_noise(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    blurred = pictures[1]
    estimated, given, noisy = (deconvolve(blurred, KERNEL, prior="tv", noise=noise) for noise in ("auto", 0.01, 0.05))
    # The estimate is at most twice too high, and the weight grows about like the variance.
    assert 0.007 < estimated.noise < 0.02
    assert (given.noise, noisy.noise) == (0.01, 0.05)
    assert noisy.weight > 3 * given.weight


def test_formats_highlights_and_chunks(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    stored = np.rint(255 * pictures[1].clip(0, 1)).astype(np.uint8)
    stored[60:64, 60:64] = 255
    out = np.empty_like(stored)
    # The values stored are linear light.
    settings = {"prior": "wiener", "nsr": 0.01, "transfer": "linear"}
    whole = deconvolve(stored, KERNEL, saturation="always", out=out, **settings)
    assert whole.image is out
    assert "highlights" in whole.timings
    bank = PsfBank.for_picture(np.broadcast_to(KERNEL, (3, 2, *KERNEL.shape)), stored.shape)
    tiled = deconvolve(stored, bank, max_memory=55 << 20, **settings)
    one = deconvolve(stored, KERNEL, saturation="ignore", **settings)
    # Equal PSFs everywhere; tiles and chunks ring a little at their ends (measured 0.012).
    assert error(tiled.image, one.image) < 0.02
    grey = deconvolve(pictures[1][..., 0], KERNEL, prior="wiener", nsr=0.01, border="periodic").image
    assert grey.shape == pictures[1].shape[:2]


def test_what_speaks_against_kernel_and_encoding_is_said(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    """Nothing is said of the right ones; a wrong encoding, half a turn and a floor are named, and `check` ends that."""
    blurred = pictures[1].clip(0, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        right = deconvolve(blurred, KERNEL, transfer="linear")
        unchecked = deconvolve(blurred, KERNEL[::-1, ::-1], transfer="linear", check=False)
    assert right.check is unchecked.check is None
    for words, kernel, transfer in (
        ("transfer linear", KERNEL, "srgb"),
        ("turned", KERNEL[::-1, ::-1], "linear"),
        ("rim", KERNEL + 0.01, "linear"),
        ("inverted", KERNEL.max() - KERNEL, "linear"),
    ):
        with pytest.warns(RsdeblurWarning, match=words):
            deconvolve(blurred, kernel, transfer=transfer)


def test_sums_and_even_sizes_of_kernels_do_not_matter(pictures: tuple[np.ndarray, np.ndarray]) -> None:
    whole = deconvolve(pictures[1], KERNEL, transfer="linear", check=False).image
    scaled = deconvolve(pictures[1], 3 * KERNEL[:, :-1], transfer="linear", check=False).image
    # Rounding of the kernel.
    np.testing.assert_allclose(scaled, whole, atol=1e-5)
