"""Extrapolation of an iteration."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.extrapolate import CHUNK, extrapolate
from tests.oracles.extrapolate import extrapolate_numpy


@pytest.mark.parametrize("shape", [(1, 1, 1), (3, 7, 3), (2, CHUNK, 1), (5, CHUNK // 3, 3)])
@pytest.mark.parametrize("ahead", [0.0, 0.5])
def test_twins_agree(shape, ahead):
    random = np.random.default_rng(0)
    before, after = (random.normal(size=shape).astype(np.float32) for _ in range(2))
    other = before.copy()
    sums = extrapolate(before, after, np.float32(ahead))
    # Sums of float32 over a chunk.
    np.testing.assert_allclose(sums, extrapolate_numpy(other, after, np.float32(ahead)), rtol=1e-5)
    np.testing.assert_array_equal(before, other)


def test_a_step_ahead_of_a_straight_line_stays_on_it():
    places = np.arange(4, dtype=np.float32)
    first, second = np.zeros((1, 4, 1), np.float32), places.reshape(1, 4, 1)
    assert extrapolate(first, second, np.float32(1.0)) == (14.0, 14.0)
    np.testing.assert_array_equal(first, 2 * second)
