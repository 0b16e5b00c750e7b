"""Laws of separating brightness and colours."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels import chroma

# A few roundings of values up to 1; slopes up to 4 divide by variances down to FLAT.
FLOAT32, SLOPED = 1e-6, 1e-4


@pytest.fixture(params=[(1, 1), (2, 7), (37, 50)], ids=str)
def picture(request):
    return np.random.default_rng(0).random((*request.param, 3), dtype=np.float32)


def joined(luma, half, peak):
    out = np.empty((*luma.shape[:2], 3), np.float32)
    chroma.join(luma, half, peak, out)
    return out


def test_a_grey_picture_comes_back(picture):
    grey = np.repeat(picture[..., :1], 3, axis=-1)
    luma, half = chroma.separate(grey)
    np.testing.assert_allclose(luma, picture[..., :1], atol=FLOAT32)
    np.testing.assert_allclose(joined(luma, half, 1.0), grey, atol=SLOPED)


def test_an_even_colour_comes_back(picture):
    """Where all pixels have the same ratios of red, green and blue, the brightness says all."""
    coloured = picture[..., :1] * np.float32([0.9, 0.5, 0.1])
    luma, half = chroma.separate(coloured)
    # Things much darker than the bright parts count as grey.
    np.testing.assert_allclose(joined(luma, half, 1.0), coloured, atol=chroma.DARK)


def test_a_smooth_picture_comes_back():
    y, x = np.mgrid[:60, :80] / 100
    smooth = np.stack([x, y, 1 - x * y], axis=-1).astype(np.float32)
    # Interpolated linearly between pixels of twice the size: exact but for the bend of x y and the ends of the picture.
    luma, half = chroma.separate(smooth)
    again = joined(luma, half, 1.0)
    np.testing.assert_allclose(again[2:-2, 2:-2], smooth[2:-2, 2:-2], atol=1e-3)


def test_ringing_below_black_is_not_amplified():
    """Where the brightness is about zero, ratios to it mean nothing."""
    rng = np.random.default_rng(2)
    luma = rng.normal(0.0, 0.02, (64, 80, 1)).astype(np.float32)
    half = rng.normal([0.05, -0.03, 0.0], 0.02, (32, 40, 3)).astype(np.float32)
    out = joined(luma, half, 1.0)
    # The mean of the colours, and at most four times what the brightness differs from its mean, 0.1 at most.
    assert np.abs(out).max() < 0.1 + 4 * 0.15
