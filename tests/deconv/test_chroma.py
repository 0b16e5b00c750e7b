"""Laws of colours at half the resolution."""

from functools import partial

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from rsdeblur import Camera, Deconvolver, Exposure, Options, PsfBank, deblur, deconvolve, hand_shake, scene, simulate
from rsdeblur.deconv import DerivativePrior, TileQuadratic
from rsdeblur.deconv.chroma import luma_share
from rsdeblur.kernels.chroma import separate
from rsdeblur.pipeline.deblur import psfs
from rsdeblur.pipeline.solver import Chunk, PictureSolver, Strengths

CAMERA, LOG, NSR, WEIGHT = Camera(161, 121, 170.0, readout_time=0.02), hand_shake(0.3, seed=3), 0.003, 0.003
SHAPE = 121, 161, 3
PRIORS = "wiener", "tv", "hyper-laplacian"


def bank_of(start, **options):
    return psfs(LOG, CAMERA, Exposure(start, 0.04), **({"bands": 5, "strips": 3} | options))


def restored(solver, light):
    # Solvers may overwrite the light.
    return solver(light.copy(), lambda _: None)


def solver_of(bank, prior, chroma="half"):
    options = Options(prior=prior, chroma=chroma)
    strengths = Strengths(NSR, None if prior == "wiener" else WEIGHT, 1.0, NSR)
    rows = slice(0, SHAPE[0])
    return PictureSolver(options, strengths, bank).plan(Chunk(rows, rows, bank), SHAPE)


def one_plane(bank, prior, share=1.0):
    """Return the solver of a single plane with the strength that the brightness has, or a share of it."""
    strength = share * luma_share(prior, 2 / 3) * (NSR if prior == "wiener" else WEIGHT)
    if prior == "wiener":
        return Deconvolver(bank, SHAPE[:2], nsr=strength).apply
    solver = TileQuadratic(bank, SHAPE[:2], nsr=NSR)
    return partial(solver.apply, prior=DerivativePrior(prior, strength, peak=1.0))


@pytest.fixture(scope="module")
def capture():
    return simulate(scene(150, 190), LOG, CAMERA, Exposure(0.08, 0.04), noise=0.003)


@pytest.fixture(scope="module")
def grey(capture):
    return np.repeat(capture.blurred[..., 1:2], 3, axis=-1)


@pytest.mark.parametrize("prior", PRIORS)
def test_a_grey_picture_is_its_brightness(grey, prior):
    bank = bank_of(0.08)
    alone = one_plane(bank, prior)(grey[..., 0])
    result = restored(solver_of(bank, prior), grey)
    # Colours are then the brightness at half size; the line through them has the slope 1, up to rounding.
    np.testing.assert_allclose(result, np.repeat(alone[..., None], 3, axis=-1), atol=2e-4)


@pytest.mark.parametrize("mode", ["banded", "rowwise"])
def test_colours_lose_little(capture, mode):
    recording = LOG, CAMERA, Exposure(0.08, 0.04)
    results = [deblur(capture.blurred, *recording, mode=mode, chroma=chroma) for chroma in ("full", "half", "auto")]
    assert [result.chroma for result in results] == ["full", "half", "half"]
    full, half, auto = (result.image for result in results)
    np.testing.assert_array_equal(auto, half)
    truth = capture.rolling
    gains = [peak_signal_noise_ratio(truth, image, data_range=1.0) for image in (full, half)]
    # Measured: 0.1 to 0.3 dB less, on a drawing with edges between strong colours; photos gain.
    assert gains[1] > gains[0] - 0.5
    luma = [separate(image)[0] for image in (truth, full, half)]
    assert np.square(luma[2] - luma[0]).mean() < 1.1 * np.square(luma[1] - luma[0]).mean()


def test_own_kernels_have_full_colours_and_paths_may_have_half(capture):
    bank = bank_of(0.08)
    drawn = PsfBank(bank.kernels, bank.rows, bank.cols)
    results = [deconvolve(capture.blurred, psf, border="blend", quality="fast") for psf in (drawn, bank)]
    assert [result.chroma for result in results] == ["full", "half"]


def test_where_colours_are_full():
    """The Wiener filter alone is that of the paper."""
    for options in ({"prior": "cnn"}, {"border": "unknown"}, {"prior": "wiener"}):
        assert Options(**options).chroma_in_effect == "full"
    assert Options(quality="fast").chroma_in_effect == "half"
    assert Options(quality="fast", chroma="full").chroma_in_effect == "full"


def test_grey_pictures_are_those_of_full_colours(capture):
    grey, recording = capture.blurred[..., 1], (LOG, CAMERA, Exposure(0.08, 0.04))
    np.testing.assert_array_equal(*(deblur(grey, *recording, chroma=chroma).image for chroma in ("full", "half")))
