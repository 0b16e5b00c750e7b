"""Laws of colours at half the resolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from rsdeblur import (
    Camera,
    DerivativePrior,
    Exposure,
    InputError,
    Options,
    PsfBank,
    TileQuadratic,
    deblur,
    hand_shake,
    psfs,
    scene,
    simulate,
)
from rsdeblur.deconv.chroma import LEAST_SIZE, HalfChroma, halved
from rsdeblur.deconv.priors import LUMA_WEIGHT
from rsdeblur.kernels.chroma import separate

CAMERA, LOG, NSR = Camera(161, 121, 170.0, readout_time=0.02), hand_shake(0.3, seed=3), 0.003
PRIORS = [DerivativePrior(kind, 0.003, peak=1.0) for kind in ("gradient", "tv", "hyper-laplacian")]


def bank_of(start, **options):
    return psfs(LOG, CAMERA, Exposure(start, 0.04), **({"bands": 5, "strips": 3} | options))


@pytest.fixture(scope="module")
def capture():
    return simulate(scene(150, 190), LOG, CAMERA, Exposure(0.08, 0.04), noise=0.003)


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: prior.kind)
def test_a_grey_picture_is_its_brightness(capture, prior):
    bank, grey = bank_of(0.08), np.repeat(capture.blurred[..., 1:2], 3, axis=-1)
    alone = TileQuadratic(bank, (121, 161), nsr=NSR).apply(grey[..., 0], prior=prior.of_luma())
    result = HalfChroma(bank, (121, 161, 3), nsr=NSR).apply(grey, prior=prior)
    # Colours are then the brightness at half size; the line through them has the slope 1, up to rounding.
    np.testing.assert_allclose(result, np.repeat(alone[..., None], 3, axis=-1), atol=2e-4)


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: prior.kind)
def test_the_brightness_of_a_grey_picture_has_the_prior_of_three_channels(capture, prior):
    bank, grey = bank_of(0.08), np.repeat(capture.blurred[..., 1:2], 3, axis=-1)
    three = TileQuadratic(bank, grey.shape, nsr=NSR).apply(grey, prior=prior)
    luma = prior.of_luma()
    same = replace(luma, weight=luma.weight / LUMA_WEIGHT)
    one = TileQuadratic(bank, grey.shape[:2], nsr=NSR).apply(grey[..., 0], prior=same)
    # Splitting takes the same steps for both only up to the scale of its penalties.
    assert np.square(three - one[..., None]).mean() < 0.01 * np.square(three - grey).mean()


def test_half_a_bank(capture):
    bank = bank_of(0.08)
    half = halved(bank, threads=1)
    assert half.kernels.shape[:2] == (3, 2)
    np.testing.assert_allclose(half.kernels.sum(axis=(2, 3)), 1.0, atol=1e-6)
    # Places count from the centre of the first pixel, which is that of the first two in the whole picture.
    np.testing.assert_allclose((half.cols[0] + half.cols[-1]) / 2, (80.0 - 0.5) / 2)
    # The first of two places of three is a quarter of the way to the second.
    near, far = bank.displacements[2, :2]
    np.testing.assert_allclose(half.displacements[1, 0] * 2, 0.75 * near + 0.25 * far)


def test_one_tile_stays_one():
    bank = bank_of(0.08, mode="global")
    half = halved(bank, threads=None)
    assert half.kernels.shape[:2] == (1, 1)
    np.testing.assert_array_equal(half.displacements * 2, bank.displacements)


def test_a_padded_bank_stays_padded():
    bank = bank_of(0.08)
    padded = bank.padded((bank.size[0] + 8, bank.size[1] + 4))
    size = halved(padded, threads=None).size
    assert np.subtract(size, halved(bank, threads=None).size).tolist() == [4, 2]


def test_replanned_is_planned_anew(capture):
    first, second, shape = bank_of(0.08), bank_of(0.12), (121, 161, 3)
    size = tuple(np.maximum(first.size, second.size))
    solver = HalfChroma(first.padded(size), shape, nsr=NSR)
    solver.apply(capture.blurred, prior=PRIORS[1])
    solver.replan(second.padded(size))
    anew = HalfChroma(second.padded(size), shape, nsr=NSR)
    results = [which.apply(capture.blurred, prior=PRIORS[1]) for which in (solver, anew)]
    np.testing.assert_array_equal(*results)


def test_colours_lose_little(capture):
    recording = LOG, CAMERA, Exposure(0.08, 0.04)
    full, half, auto = (deblur(capture.blurred, *recording, chroma=chroma).image for chroma in ("full", "half", "auto"))
    np.testing.assert_array_equal(auto, half)
    truth = capture.rolling
    gains = [peak_signal_noise_ratio(truth, image, data_range=1.0) for image in (full, half)]
    # Measured: 0.1 dB less, on a drawing with edges between strong colours; photos gain.
    assert gains[1] > gains[0] - 0.5
    luma = [separate(image)[0] for image in (truth, full, half)]
    assert np.square(luma[2] - luma[0]).mean() < 1.1 * np.square(luma[1] - luma[0]).mean()


def test_progress_only_rises(capture):
    done = []
    HalfChroma(bank_of(0.08), (121, 161, 3), nsr=NSR).apply(capture.blurred, prior=PRIORS[2], progress=done.append)
    assert done == sorted(done)
    assert done[-1] == pytest.approx(1.0)


def test_what_it_suits():
    bank, shape = bank_of(0.08), (121, 161, 3)
    assert max(bank.size) >= LEAST_SIZE
    assert HalfChroma.suits(bank, shape)
    assert not HalfChroma.suits(bank, (121, 161, 1))
    assert not HalfChroma.suits(bank, (9, 9, 3))
    assert not HalfChroma.suits(PsfBank(bank.kernels, bank.rows, bank.cols), shape)
    assert not HalfChroma.suits(PsfBank.for_picture([[0.0, 1.0, 0.0]], shape), shape)


@pytest.mark.parametrize(
    "options", [{"mode": "rowwise"}, {"prior": "wavelet"}, {"prior": "wiener"}, {"border": "unknown"}], ids=str
)
def test_where_colours_are_full(options):
    assert Options(**options).chroma_in_effect == "full"
    with pytest.raises(InputError, match='chroma="half" goes with mode'):
        Options(chroma="half", **options)


def test_grey_pictures_are_those_of_full_colours(capture):
    grey, recording = capture.blurred[..., 1], (LOG, CAMERA, Exposure(0.08, 0.04))
    np.testing.assert_array_equal(*(deblur(grey, *recording, chroma=chroma).image for chroma in ("full", "half")))
