"""Laws of the spread of paths over a grid."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from rsdeblur.kernels.spread import OVERSAMPLING, WIDTH, interpolated, spread, window_spectrum

PATHS = [
    [[0.3, -0.4], [0.3, -0.4]],
    [[-3.3, 2.0], [5.0, -4.7]],
    [[0, 0], [3, 0], [3, 0], [3, 3], [0, 0], [-1, 2], [-1, -2.5], [1e-13, 0], [5, 4], [-5, -4]],
]
GRID = (2 * 8 + WIDTH + 1, 2 * 8 + WIDTH + 1)


def grid_of(path):
    grid = np.full(GRID, np.nan)
    spread(np.array(path, dtype=np.float64), (OVERSAMPLING, OVERSAMPLING), grid)
    return grid


@pytest.mark.parametrize("path", PATHS)
def test_spectrum_is_that_of_the_path(path):
    """The spectrum over that of the window is the mean over time of `exp(-i k d)`, up to the highest frequency."""
    turns = np.linspace(-0.5, 0.5, 9)  # per px
    at_points = turns / OVERSAMPLING
    points = np.arange(GRID[0]) - GRID[0] // 2
    waves = np.exp(-2j * np.pi * np.outer(at_points, points)) / window_spectrum(at_points)[:, None]
    found = waves @ grid_of(path) @ waves.T
    expected = np.zeros_like(found)
    for start, end in pairwise(path):
        middle, step = np.add(start, end) / 2, np.subtract(end, start)
        phase, turn = (np.add.outer(turns * at[1], turns * at[0]) for at in (middle, step))
        expected += np.exp(-2j * np.pi * phase) * np.sinc(turn) / (len(path) - 1)
    # Aliases of the window add up to 2e-4, and the Gauss points err by as much on diagonal segments.
    np.testing.assert_allclose(found, expected, rtol=0, atol=4e-4)


def test_interpolated_kernels():
    """They sum to 1, keep whole pixels, and transmit up to half the highest frequency."""
    paths = np.array([[[2.0, -3.0]] * 2, [[0.5, 0.25]] * 2, [[-1.3, 0.5], [2.0, 1.0]]])
    still, between, moving = kernels = interpolated(paths, 7, 7)
    np.testing.assert_allclose(kernels.sum(axis=(1, 2)), 1, atol=1e-6)
    np.testing.assert_allclose(still, np.eye(15)[4][:, None] * np.eye(15)[9], atol=1e-6)
    waves = np.exp(-2j * np.pi * 0.25 * (np.arange(15) - 7))
    assert abs(waves @ between @ waves) == pytest.approx(1, abs=0.03)
    assert moving.max() < 0.5
    assert np.isnan(interpolated(paths, 6, 7)).all()
