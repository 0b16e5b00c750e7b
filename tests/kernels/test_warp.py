"""Laws of averaging over warps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur.kernels.warp import average_warps

HEIGHT, WIDTH = 24, 31

# Sixteen float32 products of values below 1 with weights that sum to 1, and a float32 fraction of a pixel.
ATOL = 2e-6


def spline(picture):
    planes = np.atleast_3d(np.asarray(picture, dtype=np.float64))
    return np.stack(
        [ndimage.spline_filter(plane, 3, output=np.float32, mode="mirror") for plane in np.moveaxis(planes, 2, 0)], -1
    )


def noise(height=HEIGHT, width=WIDTH, channels=2):
    return np.random.default_rng(0).random((height, width, channels))


def shifts(*displacements, rows=HEIGHT):
    """Return warps to (x + dx, y + dy), equal for all rows."""
    warps = np.tile(np.eye(3), (rows, len(displacements), 1, 1))
    warps[..., :2, 2] = displacements
    return warps


def test_identity_returns_the_picture():
    picture = noise()
    np.testing.assert_allclose(average_warps(spline(picture), shifts((0, 0)), WIDTH), picture, atol=ATOL)


@pytest.mark.parametrize(("dx", "dy"), [(3, 0), (0, -5), (-40, 60)])
def test_whole_pixels_shift_and_edges_mirror(dx, dy):
    picture = noise()
    pad = 70
    # numpy's "reflect" is the spline's "mirror": the border pixel is not repeated.
    wide = np.pad(picture, ((pad, pad), (pad, pad), (0, 0)), mode="reflect")
    expected = wide[pad + dy : pad + dy + HEIGHT, pad + dx : pad + dx + WIDTH]
    np.testing.assert_allclose(average_warps(spline(picture), shifts((dx, dy)), WIDTH), expected, atol=ATOL)


def test_a_cubic_picture_is_interpolated_exactly():
    def picture(x, y):
        x, y = x / 64, y / 64
        return 0.3 + x - 0.7 * y + x * y - x**2 + y**3

    y, x = np.mgrid[:64, :64].astype(float)
    # Projective warps of the middle 16 pixels; mirrored ends of the spline fade as 0.27 per pixel, 0.27^20 = 4e-12.
    warp = np.array([[0.95, 0.05, 23.3], [-0.04, 1.02, 25.1], [2e-4, -1e-4, 1.0]])
    y1, x1 = np.mgrid[:16, :16].astype(float)
    w = warp[2, 0] * x1 + warp[2, 1] * y1 + 1
    expected = picture((0.95 * x1 + 0.05 * y1 + 23.3) / w, (-0.04 * x1 + 1.02 * y1 + 25.1) / w)
    seen = average_warps(spline(picture(x, y)), np.tile(warp, (16, 1, 1, 1)), 16)[..., 0]
    np.testing.assert_allclose(seen, expected, atol=ATOL)
