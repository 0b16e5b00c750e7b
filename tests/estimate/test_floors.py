"""Noise and error of PSFs, measured where the PSF leaves nothing of the scene."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur import PsfBank
from rsdeblur.estimate.floors import measure_floors
from rsdeblur.estimate.noise import noise_level, overall_noise
from rsdeblur.simulation.scene import scene

SHAPE = 200, 280


def line(length: int) -> np.ndarray:
    return np.full((1, length), 1 / length, np.float32)


@pytest.fixture(scope="module")
def blurred() -> np.ndarray:
    """A picture as sharp as its pixels, full of detail, after a blur of 7 px along the rows."""
    rng = np.random.default_rng(1)
    detailed = scene(*SHAPE) + 0.2 * rng.random(SHAPE)[..., None]
    return ndimage.convolve1d(detailed, np.full(7, 1 / 7), axis=1).astype(np.float32)


def noisy(light: np.ndarray, sigma: float) -> np.ndarray:
    return light + np.random.default_rng(0).normal(0, sigma, light.shape).astype(np.float32)


def test_noise_is_told_from_detail(blurred: np.ndarray) -> None:
    for sigma, tolerance in ((0.003, 0.35), (0.01, 0.06), (0.03, 0.02)):
        floors = measure_floors(noisy(blurred, sigma), PsfBank(line(7), [100], [140]))
        assert floors is not None
        assert overall_noise(floors.octave_noise) == pytest.approx(sigma, rel=tolerance)
    # The finest scale alone takes detail for noise.
    assert noise_level(noisy(blurred, 0.003)) > 0.008


def test_a_wrong_psf_is_noticed(blurred: np.ndarray) -> None:
    picture = noisy(blurred, 0.003)
    right, long, across = (
        measure_floors(picture, PsfBank(kernel, [100], [140])).path_error for kernel in (line(7), line(9), line(7).T)
    )
    # Of a line 2 px longer, both ends are displaced by 1 px: 0.3 px^2 on average.
    assert right < 0.004
    assert long > 4 * right
    assert across > 10 * right


def test_denoised_noise_has_a_colour(blurred: np.ndarray) -> None:
    bank = PsfBank(line(7), [100], [140])
    white = noisy(np.full_like(blurred, 0.5), 0.02)
    # A Gaussian of 1 px leaves 0.7 of the amplitude at 0.15 cycles/px, and 0.05 at 0.4.
    smoothed = ndimage.gaussian_filter(white, (1, 1, 0))
    assert [measure_floors(picture, bank).processed for picture in (white, smoothed)] == [0.0, 1.0]
    # Texture in all directions, in the pictures of a sensor, is no processing.
    assert measure_floors(noisy(blurred, 0.01), bank).processed == 0.0


@pytest.mark.parametrize("shape", [(63, 200, 1), (200, 200, 1)])
def test_what_cannot_be_measured(shape: tuple[int, int, int]) -> None:
    even = np.full(shape, 0.5, np.float32)
    assert measure_floors(even, PsfBank(line(7), [10], [10])) is None


@pytest.mark.parametrize("even", [0.0, 1.0])
def test_even_and_clipped_parts_tell_nothing_of_the_noise(blurred: np.ndarray, even: float) -> None:
    bank = PsfBank(line(7), [100], [140])
    picture = noisy(blurred, 0.03).clip(0.0, 1.0)
    picture[:120] = even
    # Less than half of the tiles remain.
    assert overall_noise(measure_floors(picture, bank).octave_noise) == pytest.approx(0.03, rel=0.1)
