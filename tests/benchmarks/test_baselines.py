"""The baselines: they undo a blur whose PSF they are given, and the blind one finds it."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.signal import fftconvolve
from skimage import data
from skimage.metrics import peak_signal_noise_ratio

from benchmarks import baselines
from rsdeblur import Deconvolver, PsfBank

NOISE = 0.003


@cache
def photograph():
    """Return a photograph that comes with scikit-image, roughly in linear light."""
    return (data.camera()[32:416, 32:416] / 255.0) ** 2.2


@pytest.fixture(scope="module")
def psf():
    """A bent trail in a box of 15 px."""
    t = np.linspace(-1, 1, 600)
    y, x = 7 * t**3 - 2 * t, 7 * np.sin(1.4 * t) + 2 * t**2 - 1
    kernel, _, _ = np.histogram2d(y, x, bins=15, range=[[-7.5, 7.5]] * 2)
    return kernel / kernel.sum()


@pytest.fixture(scope="module")
def blurred(psf):
    clean = fftconvolve(np.pad(photograph(), 16, mode="symmetric"), psf, mode="same")[16:-16, 16:-16]
    return clean + np.random.default_rng(0).normal(0, NOISE, clean.shape)


def psnr(image):
    truth = photograph()
    inside = np.s_[24:-24, 24:-24]
    return peak_signal_noise_ratio(truth[inside], image.clip(0, 1)[inside], data_range=1.0)


@pytest.mark.parametrize("name", ["tv_l1", "richardson_lucy", "unsupervised_wiener"])
def test_a_known_psf_is_undone(name, psf, blurred):
    result = getattr(baselines, name)(blurred, psf)
    assert result.dtype == np.float32
    # At least half of the squared error is removed; all three do far better on this picture.
    assert psnr(result) > psnr(blurred) + 3


def test_the_blind_estimator_finds_a_15_px_kernel(psf, blurred):
    estimate = baselines.estimate_psf(blurred, 21)
    assert estimate.min() >= 0
    assert estimate.sum() == pytest.approx(1, abs=1e-5)
    # Two different trails in a box of 15 px correlate by 0.5 to 0.6; published estimators reach 0.8 to 0.95.
    assert baselines.kernel_similarity(estimate, psf) > 0.8
    restored = Deconvolver(PsfBank.for_picture(estimate, blurred.shape), blurred.shape, nsr=0.01).apply(blurred)
    # The kernel is estimated up to a shift.
    shifts = [np.roll(restored, (dy, dx), (0, 1)) for dy in range(-2, 3) for dx in range(-2, 3)]
    assert max(map(psnr, shifts)) > psnr(blurred) + 1
