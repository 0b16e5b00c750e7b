"""Extrapolation of an iteration."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.extrapolate import CHUNK, extrapolate


@pytest.mark.parametrize("width", [4, CHUNK, CHUNK + 3])
def test_a_step_ahead_of_a_straight_line_stays_on_it(width):
    step = np.arange(3 * width, dtype=np.float32).reshape(1, width, 3) / width
    first, second = np.ones_like(step), 1 + step
    sums = extrapolate(first, second, np.float32(0.5))
    # Rounding of float32, in sums over a chunk.
    np.testing.assert_allclose(first, 1 + 1.5 * step, rtol=1e-6)
    np.testing.assert_allclose(sums, [np.square(step).sum(dtype=float), np.square(second).sum(dtype=float)], rtol=1e-5)
