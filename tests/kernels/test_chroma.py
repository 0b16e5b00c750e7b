"""Laws of separating brightness and colours, on the Numba kernels and on their NumPy twins."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels import chroma
from tests.oracles.chroma import join_numpy, separate_numpy

SHAPES = [(1, 1), (2, 7), (37, 50), (64, 81), (200, 3)]
# A few roundings of values up to 1; slopes up to 4 divide by variances down to FLAT.
FLOAT32, SLOPED = 1e-6, 1e-4


@pytest.fixture(params=SHAPES, ids=str)
def picture(request):
    return np.random.default_rng(0).random((*request.param, 3), dtype=np.float32)


@pytest.fixture(params=[(chroma.separate, chroma.join), (separate_numpy, join_numpy)], ids=["fast", "numpy"])
def kernels(request):
    return request.param


def joined(luma, half, peak, *, join=chroma.join, **options):
    out = np.empty((*luma.shape[:2], 3), np.float32)
    join(luma, half, peak, out, **options)
    return out


def test_twins_agree(picture):
    luma, half = chroma.separate(picture)
    for ours, twin in zip((luma, half), separate_numpy(picture), strict=True):
        np.testing.assert_allclose(ours, twin, atol=FLOAT32)
    twin = joined(luma, half, 1.0, join=join_numpy)
    np.testing.assert_allclose(joined(luma, half, 1.0), twin, atol=SLOPED)


def test_threads_give_the_same_bits(picture):
    luma, half = chroma.separate(picture, 1)
    assert all(map(np.array_equal, (luma, half), chroma.separate(picture, 3)))
    np.testing.assert_array_equal(joined(luma, half, 1.0, threads=1), joined(luma, half, 1.0, threads=3))


def test_a_grey_picture_comes_back(picture, kernels):
    separate, join = kernels
    grey = np.repeat(picture[..., :1], 3, axis=-1)
    luma, half = separate(grey)
    np.testing.assert_allclose(luma, picture[..., :1], atol=FLOAT32)
    np.testing.assert_allclose(joined(luma, half, 1.0, join=join), grey, atol=SLOPED)


def test_an_even_colour_comes_back(picture, kernels):
    """Where all pixels have the same ratios of red, green and blue, the brightness says all."""
    separate, join = kernels
    coloured = picture[..., :1] * np.float32([0.9, 0.5, 0.1])
    luma, half = separate(coloured)
    # Things much darker than the bright parts count as grey.
    np.testing.assert_allclose(joined(luma, half, 1.0, join=join), coloured, atol=chroma.DARK)


def test_a_smooth_picture_comes_back(kernels):
    separate, join = kernels
    y, x = np.mgrid[:60, :80] / 100
    smooth = np.stack([x, y, 1 - x * y], axis=-1).astype(np.float32)
    # Interpolated linearly between pixels of twice the size: exact but for the bend of x y and the ends of the picture.
    luma, half = separate(smooth)
    again = joined(luma, half, 1.0, join=join)
    np.testing.assert_allclose(again[2:-2, 2:-2], smooth[2:-2, 2:-2], atol=1e-3)


def test_a_brighter_picture_comes_back_brighter(picture):
    """The constants are shares of the bright parts."""
    luma, half = chroma.separate(picture)
    once, tenfold = joined(luma, half, 1.0), joined(10 * luma, 10 * half, 10.0)
    np.testing.assert_allclose(tenfold, 10 * once, atol=10 * SLOPED)


def test_ringing_below_black_is_not_amplified(kernels):
    """Where the brightness is about zero, ratios to it mean nothing."""
    rng = np.random.default_rng(2)
    luma = rng.normal(0.0, 0.02, (64, 80, 1)).astype(np.float32)
    half = rng.normal([0.05, -0.03, 0.0], 0.02, (32, 40, 3)).astype(np.float32)
    out = joined(luma, half, 1.0, join=kernels[1])
    # The mean of the colours, and at most four times what the brightness differs from its mean, 0.1 at most.
    assert np.abs(out).max() < 0.1 + 4 * 0.15
