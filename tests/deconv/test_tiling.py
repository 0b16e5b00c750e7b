"""Laws of the tiles: their weights sum to one, and each is longer than its part by the margin."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.deconv.tiling import Tiling, hat_weights
from rsdeblur.psf import tile_centres

N = 1000

# (centres, kernel, margin): even tiles, uneven ones, ones beyond the picture's ends, and one for each position.
CASES = {
    "one": (tile_centres(1, N), 9, 20),
    "two": (tile_centres(2, N), 9, 20),
    "many": (tile_centres(16, N), 31, 17),
    "uneven": (np.array([3.0, 100.2, 130.9, 700.0, 998.5]), 5, 0),
    "beyond": (np.array([-80.0, 300.0, 1100.0]), 7, 11),
    "dense": (tile_centres(N, N), 3, 6),
}


def rebuilt(tiling):
    total = np.zeros(N)
    for tile in tiling.tiles:
        total[tile.first : tile.first + len(tile.weights)] += tile.weights
    return total


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.mark.parametrize("periodic", [False, True])
def test_weights_sum_to_one_and_are_positive(case, periodic):
    tiling = Tiling.plan(case[0], N, *case[1:], periodic=periodic)
    assert len(tiling.tiles) == len(case[0])
    # Two float32 weights meet at a position.
    np.testing.assert_allclose(rebuilt(tiling), 1.0, rtol=0, atol=1e-6)
    for tile in tiling.tiles:
        assert tile.weights.min() > 0
        assert tile.weights.dtype == np.float32


@pytest.mark.parametrize("periodic", [False, True])
def test_a_tile_is_longer_than_its_part_by_a_margin_that_fades(case, periodic):
    centres, kernel, margin = case
    tiling = Tiling.plan(centres, N, kernel, margin, periodic=periodic)
    longest = max(len(tile.weights) for tile in tiling.tiles)
    for tile in tiling.tiles:
        assert tile.start <= tile.first
        # The fade at the tile's end lies beyond its part of the picture.
        assert tile.first + len(tile.weights) <= tile.start + tiling.length - tiling.taper
    if tiling.length < N:
        assert tiling.taper == tiling.length - longest >= margin


def test_weights_interpolate_linearly():
    centres = np.array([10.0, 14.0, 30.5])
    values = np.array([3.0, -1.0, 7.0])
    expected = np.interp(np.arange(50), centres, values)
    np.testing.assert_allclose(values @ hat_weights(centres, 50), expected, atol=1e-12)
