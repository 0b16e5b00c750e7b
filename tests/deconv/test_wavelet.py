"""The learned wavelet prior: its laws in both engines, its noise model, and what it restores."""

from __future__ import annotations

import numpy as np

from rsdeblur import PsfBank
from rsdeblur.deconv import DerivativePrior, TileQuadratic
from rsdeblur.deconv.wavelet import WaveletPrior
from rsdeblur.estimate import Tuning
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


def test_it_beats_the_gradient_prior_of_its_weight() -> None:
    sharp = scene(*SHAPE[:2])
    picture = blurred(sharp)
    prior = prior_for(picture)

    def error(image: np.ndarray) -> float:
        return float(np.sqrt(np.square(image - sharp).mean()))

    gradient = solver().apply(picture, prior=DerivativePrior("gradient", prior.weight))
    assert error(solver().apply(picture, prior=prior)) < 0.9 * error(gradient)
