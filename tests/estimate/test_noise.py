"""The noise level: noise that it must measure, and detail that it must not mistake for noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur.estimate.noise import gradient_energy, noise_level
from rsdeblur.image.transfer import from_linear, to_linear
from rsdeblur.simulation.scene import scene


@pytest.fixture(scope="module")
def clean() -> np.ndarray:
    """A blurred picture with bright and dark parts."""
    return ndimage.gaussian_filter(scene(300, 400), (2, 2, 0))


def grain(shape: tuple[int, ...], sigma: float) -> np.ndarray:
    return np.random.default_rng(0).normal(0.0, sigma, shape).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("channels", [1, 3])
def test_white_noise_is_measured(clean: np.ndarray, sigma: float, channels: int) -> None:
    noisy = (clean + grain(clean.shape, sigma))[..., :channels]
    # 120000 values in 24 blocks: 0.5 % by chance; remaining detail adds a few percent to the weakest.
    assert noise_level(noisy) == pytest.approx(sigma, rel=0.1)


def test_noise_of_stored_values_is_averaged_over_bright_and_dark(clean: np.ndarray) -> None:
    stored = from_linear(clean, "srgb")
    noisy = to_linear(stored + grain(clean.shape, 0.01), "srgb")
    truth = float(np.sqrt(np.mean((noisy - clean) ** 2)))
    # A single median over the picture would be that of its darker half; measured 40 % less.
    assert noise_level(noisy) == pytest.approx(truth, rel=0.15)


def test_clipped_parts_hold_no_noise() -> None:
    picture = np.full((256, 256, 3), 0.5, dtype=np.float32)
    picture[:, 128:] = 2.0
    noisy = (picture + grain(picture.shape, 0.01)).clip(0.0, 1.0)
    assert noise_level(noisy) == pytest.approx(0.01 / np.sqrt(2), rel=0.05)


def test_noise_that_was_smoothed_is_still_noticed(clean: np.ndarray) -> None:
    smoothed = clean + ndimage.gaussian_filter(grain(clean.shape, 0.03), (0.7, 0.7, 0))
    # White noise of the same level on coarse scales is 0.03; the finest scale alone shows a tenth of that.
    assert 0.005 < noise_level(smoothed) < 0.03


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 3), (2, 2, 1), (3, 4, 3), (65, 2, 1)])
def test_tiny_pictures_have_a_level(shape: tuple[int, ...]) -> None:
    picture = np.random.default_rng(0).random(shape, dtype=np.float32)
    assert noise_level(picture) >= 0.0
    assert np.isfinite(gradient_energy(picture))
