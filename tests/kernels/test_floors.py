"""Floors of periodograms: found where they are known, and agreement with the NumPy twin."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.floors import TilePowers, fit_floors
from tests.oracles.floors import fit_floors_numpy

TILES, FREQUENCIES = 24, 480


def powers(noise: float, error: float, coarser: float = 1.0) -> TilePowers:
    """Return the powers of tiles that follow the model, with gains of 1e-4 to 1e2.

    The first octave has `coarser` times the noise of the second.
    """
    rng = np.random.default_rng(0)
    cells = np.arange(0, FREQUENCIES + 1, 20)
    frequency = rng.uniform(0.03, 0.5, FREQUENCIES)
    scene, white = frequency**-1.5, frequency**2
    blurred = np.sinc(12 * frequency) ** 2 * scene * np.ones((TILES, 1))
    gains = np.repeat(10 ** rng.uniform(-4, 2, (TILES, len(cells) - 1)), 20, axis=1)
    brightness = rng.uniform(0.2, 1.8, TILES)
    octaves = (np.arange(len(cells) - 1) >= 8).astype(np.int64)
    variance = np.outer(noise * brightness / brightness.mean(), np.where(octaves, 1.0, coarser).repeat(20))
    expected = gains * (blurred + error * white * scene) + variance * white
    measured = expected * rng.exponential(size=expected.shape)
    return TilePowers(measured, np.maximum(blurred, 1e-9), white * scene, white, brightness, cells, octaves)


@pytest.mark.parametrize("error", [0.02, 0.2])
@pytest.mark.parametrize(("noise", "coarser"), [(1e-4, 1.0), (1e-4, 30.0), (1e-2, 1.0), (1e-2, 3.0)])
def test_the_floors_are_found(noise: float, coarser: float, error: float) -> None:
    found, squared = fit_floors(powers(noise, error, coarser), (0.1, 0.05), 200, 0.0)
    # Gains that are fitted to 20 frequencies take a twentieth of everything.
    np.testing.assert_allclose(found, [coarser * noise, noise], rtol=0.06)
    assert squared == pytest.approx(error, rel=0.06)


@pytest.mark.parametrize("weight", [0.0, 100.0])
def test_twins_agree(weight: float) -> None:
    arguments = powers(1e-3, 0.05, 2.0), (0.1, 0.02), 20, weight
    # Both do the same steps in double precision.
    for one, other in zip(fit_floors(*arguments), fit_floors_numpy(*arguments), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8)


def test_a_prior_of_great_weight_is_the_result() -> None:
    assert fit_floors(powers(1e-3, 0.2), (0.1, 0.02), 50, 1e9)[1] == pytest.approx(0.02, rel=1e-3)
