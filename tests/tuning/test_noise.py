"""Noise that must be measured, detail that must not be mistaken for it, and the error of PSFs."""

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur import PsfBank, from_linear, scene, to_linear
from rsdeblur.tuning.noise import gradient_energy, measure_floors, noise_level, overall_noise


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


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 9, 3), (2, 2, 1), (3, 4, 3), (65, 2, 1)])
def test_tiny_pictures_have_a_level(shape: tuple[int, ...]) -> None:
    picture = np.random.default_rng(0).random(shape, dtype=np.float32)
    assert noise_level(picture) >= 0.0
    assert np.isfinite(gradient_energy(picture))


@pytest.mark.parametrize("size", [(40, 50), (41, 51)])
def test_steps_are_twice_as_large_at_half_the_size(size: tuple[int, int]) -> None:
    """An odd last row or column has no partner."""
    down, across = np.indices(size).astype(np.float32)
    picture = np.stack([0.01 * across, 0.02 * down], axis=-1)
    # The last column and row have no next. Steps of 0.02 between values up to 1 lose some digits in float32.
    assert gradient_energy(picture) == pytest.approx(0.02**2 * 24 / 25 + 0.04**2 * 19 / 20, rel=1e-4)


SHAPE = 200, 280


def line(length: int) -> np.ndarray:
    return np.full((1, length), 1 / length, np.float32)


@pytest.fixture(scope="module")
def blurred() -> np.ndarray:
    """A picture as sharp as its pixels, full of detail, after a blur of 7 px along the rows."""
    rng = np.random.default_rng(1)
    detailed = scene(*SHAPE) + 0.2 * rng.random(SHAPE)[..., None]
    return ndimage.convolve1d(detailed, np.full(7, 1 / 7), axis=1).astype(np.float32)


def test_noise_is_told_from_detail(blurred: np.ndarray) -> None:
    for sigma, tolerance in ((0.003, 0.35), (0.01, 0.06), (0.03, 0.02)):
        floors = measure_floors(blurred + grain(blurred.shape, sigma), PsfBank(line(7), [100], [140]))
        assert floors is not None
        assert overall_noise(floors.octave_noise) == pytest.approx(sigma, rel=tolerance)
    # The finest scale alone takes detail for noise.
    assert noise_level(blurred + grain(blurred.shape, 0.003)) > 0.008


def test_a_wrong_psf_is_noticed(blurred: np.ndarray) -> None:
    picture = blurred + grain(blurred.shape, 0.003)
    right, long, across = (
        measure_floors(picture, PsfBank(kernel, [100], [140])).path_error for kernel in (line(7), line(9), line(7).T)
    )
    # Of a line 2 px longer, both ends are displaced by 1 px: 0.3 px^2 on average.
    assert right < 0.004
    assert long > 4 * right
    assert across > 10 * right


def test_denoised_noise_has_a_colour(blurred: np.ndarray) -> None:
    bank = PsfBank(line(7), [100], [140])
    white = 0.5 + grain(blurred.shape, 0.02)
    # A Gaussian of 1 px leaves 0.7 of the amplitude at 0.15 cycles/px, and 0.05 at 0.4.
    smoothed = ndimage.gaussian_filter(white, (1, 1, 0))
    assert [measure_floors(picture, bank).processed for picture in (white, smoothed)] == [0.0, 1.0]
    # Texture in all directions, in the pictures of a sensor, is no processing.
    assert measure_floors(blurred + grain(blurred.shape, 0.01), bank).processed == 0.0


@pytest.mark.parametrize("shape", [(63, 200, 1), (200, 200, 1)])
def test_what_cannot_be_measured(shape: tuple[int, int, int]) -> None:
    even = np.full(shape, 0.5, np.float32)
    assert measure_floors(even, PsfBank(line(7), [10], [10])) is None


@pytest.mark.parametrize("even", [0.0, 1.0])
def test_even_and_clipped_parts_tell_nothing_of_the_noise(blurred: np.ndarray, even: float) -> None:
    bank = PsfBank(line(7), [100], [140])
    picture = (blurred + grain(blurred.shape, 0.03)).clip(0.0, 1.0)
    picture[:120] = even
    # Less than half of the tiles remain.
    assert overall_noise(measure_floors(picture, bank).octave_noise) == pytest.approx(0.03, rel=0.1)
