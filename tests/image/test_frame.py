"""The upright frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from skimage.transform import resize

from rsdeblur import Camera
from rsdeblur.image.frame import upright


@pytest.mark.parametrize("scale", [1.0, 0.83, 0.5, 1 / 3, 0.21, 1.4])
def test_pictures_are_reduced_as_by_scikit_image(scale):
    light = np.random.default_rng(0).random((97, 131), dtype=np.float32)
    camera = Camera(131, 97, 100.0)
    small = camera.scaled(scale)
    expected = resize(light, (small.height, small.width), order=1, anti_aliasing=True)
    # The same bits here; versions of either library may round otherwise.
    np.testing.assert_allclose(upright(light, camera, scale), expected, atol=1e-6)
    # Horizontal readout turns the reduced picture a quarter clockwise.
    turned = upright(light, replace(camera, readout_direction="left-right"), scale)
    np.testing.assert_allclose(turned, np.rot90(expected, -1), atol=1e-6)
