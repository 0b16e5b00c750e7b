"""Energy of the gradient at half the size: known for a slope, and agreement with the NumPy twin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rsdeblur.kernels.energy import halved_gradient_energy
from tests.oracles.energy import halved_gradient_energy_numpy

Energy = Callable[[np.ndarray], float]


@pytest.mark.parametrize("energy", [halved_gradient_energy, halved_gradient_energy_numpy])
def test_steps_are_twice_as_large_at_half_the_size(energy: Energy) -> None:
    down, across = np.mgrid[:40, :50].astype(np.float32)
    picture = np.stack([0.01 * across, 0.02 * down], axis=-1)
    # The last column and row have no next. Steps of 0.02 between values up to 1 lose some digits in float32.
    assert energy(picture) == pytest.approx(0.02**2 * 24 / 25 + 0.04**2 * 19 / 20, rel=1e-4)


@pytest.mark.parametrize("shape", [(2, 2, 1), (3, 2, 3), (2, 9, 2), (65, 70, 3), (40, 51, 1)])
def test_twins_agree(shape: tuple[int, ...]) -> None:
    picture = np.random.default_rng(0).random(shape, dtype=np.float32)
    # Both add up squares of float32 in double precision.
    assert halved_gradient_energy(picture) == pytest.approx(halved_gradient_energy_numpy(picture), rel=1e-6)
