"""A denoiser as the prior: the laws of the loop."""

import numpy as np

from rsdeblur import PsfBank, deconvolve, scene
from rsdeblur.deconv import PlugAndPlayPrior, TileQuadratic
from rsdeblur.deconv.plug_and_play import WEIGHT_OF_VARIANCE

KERNEL = np.zeros((7, 9))
KERNEL[[1, 2, 3, 4, 5], [1, 2, 4, 5, 7]] = 0.2
SHAPE = 64, 80


def tiles(shape: tuple[int, ...] = SHAPE, nsr: float = 1e-3) -> TileQuadratic:
    return TileQuadratic(PsfBank.for_picture(KERNEL, shape), shape, border="periodic", nsr=nsr)


def same(image: np.ndarray, sigma: float) -> np.ndarray:
    return image


def test_a_constant_picture_is_unchanged() -> None:
    for shape in (SHAPE, (*SHAPE, 3)):
        picture = np.full(shape, 0.25, np.float32)
        result = tiles(shape, nsr=1e-6).apply(picture, prior=PlugAndPlayPrior(same, 1e-4))
        np.testing.assert_allclose(result, picture, atol=1e-5)


def test_the_denoiser_may_keep_its_arrays() -> None:
    kept: list[np.ndarray] = []

    def denoise(image: np.ndarray, sigma: float) -> np.ndarray:
        kept.append(image.copy())
        return kept[-1]

    picture = np.random.default_rng(2).random(SHAPE, dtype=np.float32)
    prior = PlugAndPlayPrior(denoise, 1e-4)
    result = tiles().apply(picture, prior=prior)
    np.testing.assert_array_equal(result, tiles().apply(picture, prior=PlugAndPlayPrior(same, 1e-4)))
    assert not np.shares_memory(result, kept[-1])


def test_a_denoiser_is_a_prior_of_deconvolve() -> None:
    sharp, bank = scene(*SHAPE), PsfBank.for_picture(KERNEL, SHAPE)
    picture = blurred(sharp)
    result = deconvolve(picture, bank, prior=same, noise=0.01, transfer="linear", border="periodic")
    # The weight allows for errors of the paths as well, which are about a hundredth of the light here.
    assert 1 <= result.weight / (WEIGHT_OF_VARIANCE * 0.01**2) < 3
    assert np.square(result.image - sharp).mean() < np.square(picture - sharp).mean()


def blurred(light: np.ndarray, noise: float = 0.01) -> np.ndarray:
    padded = np.zeros(light.shape[:2])
    padded[: KERNEL.shape[0], : KERNEL.shape[1]] = KERNEL
    spectrum = np.fft.rfft2(np.roll(padded, (-3, -4), (0, 1)))[..., None] * np.fft.rfft2(light, axes=(0, 1))
    picture = np.fft.irfft2(spectrum, light.shape[:2], axes=(0, 1))
    return (picture + np.random.default_rng(0).normal(0, noise, light.shape)).astype(np.float32)
