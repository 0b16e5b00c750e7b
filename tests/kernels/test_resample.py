"""Resampling of pictures by splines."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.resample import sample, to_spline
from tests.oracles.resample import to_spline_numpy


@pytest.mark.parametrize("shape", [(300, 7, 1), (1, 90, 4), (2, 2, 2)])
def test_coefficients_are_those_of_scipy(shape: tuple[int, int, int]) -> None:
    picture = np.random.default_rng(2).uniform(size=shape).astype(np.float32)
    got, expected = picture.copy(), picture.copy()
    to_spline(got, threads=1)
    to_spline_numpy(expected)
    # The gain of the filters is at most 24; recursions in float32 for values up to 16.
    np.testing.assert_allclose(got, expected, atol=2e-5)
    shared = picture.copy()
    to_spline(shared, threads=3)
    np.testing.assert_array_equal(shared, got)


def test_polynomials_of_the_degree_of_the_spline_are_exact() -> None:
    y, x = np.indices((60, 60)) / 60
    picture = (x**5 - 2 * y**4 * x + y).astype(np.float32)
    spline = picture[..., None].copy()
    to_spline(spline)
    across, down = np.meshgrid(np.linspace(25, 35, 9, dtype=np.float32), np.linspace(26, 34, 7, dtype=np.float32))
    expected = (across / 60) ** 5 - 2 * (down / 60) ** 4 * (across / 60) + down / 60
    # The mirrored edges are 25 px away: the spline decays by 0.43 per px.
    np.testing.assert_allclose(sample(spline, across, down)[..., 0], expected, atol=1e-5)
