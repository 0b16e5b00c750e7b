"""The learned wavelet prior: its laws in both engines, its noise model, and what it restores."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import PsfBank
from rsdeblur.deconv import DerivativePrior, TileQuadratic
from rsdeblur.deconv.wavelet import Factors, WaveletPrior, band_shape, frame_responses
from rsdeblur.estimate import Tuning, strength
from rsdeblur.simulation.scene import scene

KERNEL = np.zeros((7, 9))
KERNEL[[1, 2, 3, 4, 5], [1, 2, 4, 5, 7]] = 0.2
SHAPE = 90, 300, 3
SPARSE = DerivativePrior("hyper-laplacian", 0.001)


def solver(**options) -> TileQuadratic:
    return TileQuadratic(PsfBank.for_picture(KERNEL, SHAPE), SHAPE, border="periodic", nsr=1e-6, **options)


def blurred(light: np.ndarray, noise: float = 0.01) -> np.ndarray:
    padded = np.zeros(SHAPE[:2])
    padded[: KERNEL.shape[0], : KERNEL.shape[1]] = KERNEL
    spectrum = np.fft.rfft2(np.roll(padded, (-3, -4), (0, 1)))[..., None] * np.fft.rfft2(light, axes=(0, 1))
    picture = np.fft.irfft2(spectrum, SHAPE[:2], axes=(0, 1))
    return (picture + np.random.default_rng(0).normal(0, noise, SHAPE)).astype(np.float32)


def prior_for(picture: np.ndarray) -> WaveletPrior:
    return Tuning.of(picture, PsfBank.for_picture(KERNEL, SHAPE), one_filter=True, repeats=True).wavelet()


def test_a_constant_picture_is_unchanged() -> None:
    picture = np.full(SHAPE, 0.25, np.float32)
    prior = WaveletPrior(0.01, tuple(np.full(band_shape(), 1e-4).ravel()), 0.5, SPARSE)
    np.testing.assert_allclose(solver().apply(picture, prior=prior), picture, atol=1e-5)


def test_threads_and_an_own_output_change_nothing() -> None:
    picture = blurred(scene(*SHAPE[:2]))
    prior, out, fractions = prior_for(picture), np.empty(SHAPE, np.float32), []
    one = solver(threads=1).apply(picture, prior=prior)
    solver(threads=3).apply(picture, out, prior=prior, progress=fractions.append)
    np.testing.assert_array_equal(out, one)
    assert fractions == pytest.approx(np.arange(1, 6) / 5)


def test_it_beats_the_gradient_prior_of_its_weight() -> None:
    sharp = scene(*SHAPE[:2])
    picture = blurred(sharp)
    prior = prior_for(picture)

    def error(image: np.ndarray) -> float:
        return float(np.sqrt(np.square(image - sharp).mean()))

    gradient = solver().apply(picture, prior=DerivativePrior("gradient", prior.weight))
    assert error(solver().apply(picture, prior=prior)) < 0.9 * error(gradient)


def test_the_variances_are_those_of_white_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strength, "ABSORBED", 0.0)
    rng, noise, shape = np.random.default_rng(0), 0.1, (256, 256)
    bank = PsfBank.for_picture(KERNEL, shape)
    white = rng.normal(0, noise, shape).astype(np.float32)
    tuning = Tuning.of(white, bank, noise=noise, one_filter=True, repeats=True)
    prior = tuning.wavelet()
    quadratic = TileQuadratic(bank, shape, border="periodic", nsr=0)
    quadratic.prepare(white)
    latents = [quadratic.solve(prior.weight * ratio)[..., 0] for ratio in Factors.learned().ratios]
    expected = np.reshape(prior.variances, band_shape())
    responses = frame_responses(shape[0])
    for k, latent in enumerate(latents):
        power = np.square(np.abs(np.fft.fft2(latent))) / latent.size**2
        found = (responses * power).sum(axis=(2, 3))
        # The coarsest level has some hundred independent values, and the spectra of the tuning fewer frequencies.
        np.testing.assert_allclose(found, expected[k], rtol=0.2)
