"""Energy of the gradient at half the size."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.energy import halved_gradient_energy


@pytest.mark.parametrize("size", [(40, 50), (41, 51)])
def test_steps_are_twice_as_large_at_half_the_size(size: tuple[int, int]) -> None:
    """An odd last row or column has no partner."""
    down, across = np.indices(size).astype(np.float32)
    picture = np.stack([0.01 * across, 0.02 * down], axis=-1)
    # The last column and row have no next. Steps of 0.02 between values up to 1 lose some digits in float32.
    assert halved_gradient_energy(picture) == pytest.approx(0.02**2 * 24 / 25 + 0.04**2 * 19 / 20, rel=1e-4)
