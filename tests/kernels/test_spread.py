"""Laws of the spread of paths over a grid."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.spread import interpolated


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
