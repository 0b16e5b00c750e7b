"""Laws of the rasteriser."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.raster import rasterize

HALF_HEIGHT, HALF_WIDTH = 9, 12

# Float32 rounds entries, which are at most 1, by 6e-8; the Numba kernel never steps less than 1e-9 of a segment, at
# each of some ten grid lines crossed.
ATOL = 2e-7


def raster(path):
    return rasterize(np.array(path, dtype=np.float64)[None], HALF_HEIGHT, HALF_WIDTH)[0]


def random_paths(count=30, samples=17, seed=0):
    """Return smooth paths that reach 8 px down and 11 px across; every third one moves along one axis only."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2 * np.pi, samples)
    waves = rng.normal(size=(count, 3, 2))[:, :, None] * np.sin(np.arange(1, 4)[:, None] * t + 1.0)[None, :, :, None]
    paths = waves.sum(axis=1)
    paths *= [10.9, 7.9] / np.abs(paths).max(axis=1, keepdims=True)
    paths[1::3, :, 0] = 0.3
    paths[2::3, :, 1] = -2.0
    return paths


def centroid(kernel):
    dy, dx = np.mgrid[-HALF_HEIGHT : HALF_HEIGHT + 1, -HALF_WIDTH : HALF_WIDTH + 1]
    return np.array([(kernel * dx).sum(dtype=np.float64), (kernel * dy).sum(dtype=np.float64)])


def time_mean(path):
    """Return the mean position over time of a path whose segments take equal times."""
    return 0.5 * (path[1:] + path[:-1]).mean(axis=0)


@pytest.mark.parametrize("path", random_paths(3))
def test_energy_is_one_and_none_is_negative(path):
    kernel = raster(path)
    assert kernel.shape == (2 * HALF_HEIGHT + 1, 2 * HALF_WIDTH + 1)
    assert kernel.dtype == np.float32
    assert abs(kernel.sum(dtype=np.float64) - 1) < 1e-6
    assert kernel.min() >= 0


@pytest.mark.parametrize("path", random_paths(3, seed=1))
def test_centroid_is_the_mean_over_time(path):
    # Bilinear weights keep the centroid; float32 rounds by 6e-8 of a reach below 12 px.
    np.testing.assert_allclose(centroid(raster(path)), time_mean(path), rtol=0, atol=1e-6)


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


@pytest.mark.parametrize("parts", [2, 7])
@pytest.mark.parametrize("path", random_paths(3, seed=2))
def test_splitting_segments_changes_nothing(path, parts):
    # Every segment is cut into equal parts, so times stay even.
    knots = np.arange(len(path))
    fine = np.linspace(0, len(path) - 1, parts * (len(path) - 1) + 1)
    split = np.stack([np.interp(fine, knots, path[:, axis]) for axis in (0, 1)], axis=1)
    np.testing.assert_allclose(raster(split), raster(path), rtol=0, atol=ATOL)


@pytest.mark.parametrize("path", random_paths(3, seed=3))
def test_mirrors_and_time_reversal(path):
    kernel = raster(path)
    np.testing.assert_allclose(raster(path * [-1, 1]), kernel[:, ::-1], rtol=0, atol=ATOL)
    np.testing.assert_allclose(raster(path * [1, -1]), kernel[::-1], rtol=0, atol=ATOL)
    np.testing.assert_allclose(raster(path[::-1]), kernel, rtol=0, atol=ATOL)
