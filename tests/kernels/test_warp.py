"""Averages over warps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur.kernels.warp import average_warps


@pytest.mark.parametrize(("dx", "dy"), [(0, 0), (3, 0), (0, -5), (-40, 60)])
def test_whole_pixels_shift_and_edges_mirror(dx, dy):
    picture, pad = np.random.default_rng(0).random((24, 31, 3)), 70
    spline = np.stack(
        [ndimage.spline_filter(plane, 3, output=np.float32, mode="mirror") for plane in np.moveaxis(picture, 2, 0)], -1
    )
    warps = np.tile(np.eye(3), (24, 1, 1, 1))
    warps[..., :2, 2] = dx, dy
    # numpy's "reflect" is the spline's "mirror": the border pixel is not repeated.
    wide = np.pad(picture, ((pad, pad), (pad, pad), (0, 0)), mode="reflect")
    expected = wide[pad + dy : pad + dy + 24, pad + dx : pad + dx + 31]
    # Sixteen float32 products of values below 1 with weights that sum to 1, and a float32 fraction of a pixel.
    np.testing.assert_allclose(average_warps(spline, warps, 31), expected, atol=2e-6)
