"""Light below black fades towards the blurred picture, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rsdeblur import Camera, Exposure, Translation, deblur, simulate
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.undershoot import fade_undershoot
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake

SIZE = (15, 21)


def pictures(height: int = 90, width: int = 70) -> tuple[NDArray[np.float32], EncodedImage]:
    random = np.random.default_rng(0)
    sharp, blurred = random.uniform(0.1, 1, (2, height, width, 3)).astype(np.float32)
    return sharp, EncodedImage(blurred, "linear")


def test_light_above_black_is_not_touched() -> None:
    sharp, encoded = pictures()
    faded = sharp.copy()
    fade_undershoot(faded, encoded, 0, SIZE)
    np.testing.assert_array_equal(faded, sharp)


def test_only_the_blurred_picture_is_left_where_much_light_is_below_black() -> None:
    sharp, encoded = pictures()
    sharp[30:70, 20:60] = -0.5
    faded = sharp.copy()
    fade_undershoot(faded, encoded, 0, SIZE)
    np.testing.assert_allclose(faded[35:65, 25:55], encoded.values[35:65, 25:55], atol=1e-6)
    # The Gaussian ends at 4 standard deviations of 0.15 PSFs each, and cells are half of one wide.
    np.testing.assert_array_equal(faded[:12], sharp[:12])


@pytest.mark.parametrize("peak", [2.0**-14, 0.0])
def test_dark_pictures_fade_as_bright_ones(peak: float) -> None:
    """Priors take the bright parts of a picture for 1e-3 at least; here, only a black picture has none."""
    sharp, encoded = pictures()
    sharp[30:70, 20:60] = -0.5
    dark, light = peak * sharp, sharp.copy()
    fade_undershoot(dark, EncodedImage(peak * encoded.values, encoded.transfer), 0, SIZE, peak)
    fade_undershoot(light, encoded, 0, SIZE)
    # A power of two scales floats exactly, so nothing is rounded differently.
    np.testing.assert_array_equal(dark, peak * light)


def test_a_wrong_motion_leaves_no_black_stripes_and_a_right_one_loses_nothing() -> None:
    camera, exposure, log = Camera(192, 144, 260.0), Exposure(0.2, 0.05), hand_shake(0.5, seed=4)
    blurred, _, rolling = simulate(0.05 + 0.95 * scene(184, 232), log, camera, exposure, noise=0.004)
    right, wrong = (
        deblur(blurred, log, camera, exposure, translation=moved, check=False).image
        for moved in (None, Translation.drift((8, 4), camera, exposure))
    )
    assert (wrong < -0.01).mean() < 1e-3
    error = np.square(np.clip(right, 0, 1) - rolling).mean()
    assert error < np.square(blurred - rolling).mean() / 2
