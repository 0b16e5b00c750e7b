"""Power smoothed by a Hann window."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.fft

from rsdeblur.kernels.periodogram import smoothed_power


@pytest.fixture(params=[(8, 8), (6, 4), (64, 64)], ids=str)
def tiles(request):
    return np.random.default_rng(0).normal(size=(3, *request.param)).astype(np.float32)


def test_the_whole_spectrum_is_smoothed(tiles):
    """Half a spectrum gives the same as the whole one, convolved with 1/6, 2/3, 1/6 along both axes."""
    power = np.abs(np.fft.fft2(tiles)) ** 2
    for axis in (1, 2):
        power = 2 / 3 * power + (np.roll(power, 1, axis) + np.roll(power, -1, axis)) / 6
    half = power[..., : tiles.shape[2] // 2 + 1]
    np.testing.assert_allclose(smoothed_power(scipy.fft.rfft2(tiles)), half, rtol=1e-4, atol=1e-5 * half.max())
