"""Laws of the rasteriser."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.raster import rasterize
from tests.oracles.geometry import rasterize_numpy

HALF_HEIGHT, HALF_WIDTH = 9, 12

# Float32 rounds entries, which are at most 1, by 6e-8; the Numba kernel never steps less than 1e-9 of a segment, at
# each of some ten grid lines crossed.
ATOL = 2e-7


def raster(path):
    return rasterize(np.array(path, dtype=np.float64)[None], HALF_HEIGHT, HALF_WIDTH)[0]


def random_paths(count=9, samples=17, seed=0):
    """Return smooth paths that reach 8 px down and 11 px across; every third one moves along one axis only."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2 * np.pi, samples)
    waves = rng.normal(size=(count, 3, 2))[:, :, None] * np.sin(np.arange(1, 4)[:, None] * t + 1.0)[None, :, :, None]
    paths = waves.sum(axis=1)
    paths *= [10.9, 7.9] / np.abs(paths).max(axis=1, keepdims=True)
    paths[1::3, :, 0] = 0.3
    paths[2::3, :, 1] = -2.0
    return paths


def test_paths_over_many_pixels_are_traced_as_by_the_oracle():
    paths = random_paths()
    kernels = rasterize(paths, HALF_HEIGHT, HALF_WIDTH)
    assert kernels.min() >= 0
    np.testing.assert_allclose(kernels.sum(axis=(1, 2), dtype=np.float64), 1, atol=1e-6)
    np.testing.assert_allclose(kernels, rasterize_numpy(paths, HALF_HEIGHT, HALF_WIDTH), rtol=0, atol=ATOL)
    dy, dx = np.mgrid[-HALF_HEIGHT : HALF_HEIGHT + 1, -HALF_WIDTH : HALF_WIDTH + 1]
    centroids = np.einsum("nyx,ayx->na", kernels.astype(float), np.stack([dx, dy]))
    # Bilinear weights keep the mean over time; float32 rounds by 6e-8 of a reach below 12 px.
    np.testing.assert_allclose(centroids, 0.5 * (paths[:, 1:] + paths[:, :-1]).mean(axis=1), rtol=0, atol=1e-6)


@pytest.mark.parametrize(("x", "y"), [(0, 0), (5, -3), (-11, 8)])
def test_a_point_on_a_pixel_is_a_delta(x, y):
    kernel = raster([[x, y], [x, y]])
    expected = np.zeros_like(kernel)
    expected[HALF_HEIGHT + y, HALF_WIDTH + x] = 1.0
    np.testing.assert_array_equal(kernel, expected)


def test_a_point_between_pixels_is_bilinear():
    kernel = raster([[2.25, -1.5], [2.25, -1.5]])
    np.testing.assert_allclose(kernel[7:9, 14:16], [[0.375, 0.125], [0.375, 0.125]], atol=ATOL)


def test_a_straight_path_is_integrated_exactly():
    # An inner pixel gets the integral of its tent, one share; the end pixels get half a share.
    kernel = raster([[-4, 0], [4, 0]])
    row = np.array([0.5, *[1.0] * 7, 0.5]) / 8
    np.testing.assert_allclose(kernel[HALF_HEIGHT, HALF_WIDTH - 4 : HALF_WIDTH + 5], row, atol=ATOL)
    # Shares of the corners along the diagonal of a cell: the integral of (1 - t)^2 is 1/3, of t (1 - t) 1/6.
    np.testing.assert_allclose(raster([[0, 0], [1, 1]])[9:11, 12:14], [[1 / 3, 1 / 6], [1 / 6, 1 / 3]], atol=ATOL)
