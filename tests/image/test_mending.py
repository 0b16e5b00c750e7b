"""Beside clipped light a result keeps to the photo's colours, below black it fades to the photo; all else stays."""

import numpy as np
import pytest
from numpy.typing import NDArray

from rsdeblur import Camera, Exposure, Translation, deblur, hand_shake, scene, simulate
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.mending import fade_undershoot, keep_colours_near_clipped

# A window is 5 cells of 8 px: limits hold up to 2 cells from clipped pixels, and set in over another one. The weight
# is interpolated to the pixels of one more.
SIZE = (15, 21)
FAR = 32


def pictures(height: int = 120, width: int = 160) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """A result of any colours, and a photo of even grey whose left is clipped."""
    sharp = np.random.default_rng(0).uniform(-0.5, 2, (height, width, 3)).astype(np.float32)
    photo = np.full((height, width, 3), 128, np.uint8)
    photo[:, :24] = 255
    return sharp, photo


def test_colours_beside_clipped_pixels_are_those_of_the_photo() -> None:
    sharp, photo = pictures()
    limited = sharp.copy()
    keep_colours_near_clipped(limited, EncodedImage(photo, "srgb"), 0, SIZE)
    np.testing.assert_array_equal(limited[:, 24 + FAR :], sharp[:, 24 + FAR :])
    roots = np.copysign(np.sqrt(np.abs(limited)), limited)[:, 24:28]
    # The photo is grey: a step of 8 bits to either side is left of the colours, at most.
    assert np.ptp(roots[roots.mean(axis=2) <= 1], axis=1).max() <= 2.01 / 255
    bright = np.copysign(np.sqrt(np.abs(sharp)), sharp).mean(axis=2) > 1
    np.testing.assert_array_equal(limited[bright], sharp[bright])


def test_what_is_white_over_a_whole_psf_gets_no_darker() -> None:
    sharp, photo = pictures()
    # A white stripe that is narrower than the PSF says nothing.
    photo[:, 96:104] = 255
    limited = sharp.copy()
    keep_colours_near_clipped(limited, EncodedImage(photo, "srgb"), 0, SIZE)
    luma = np.copysign(np.sqrt(np.abs(limited)), limited).mean(axis=2)
    # The limit fades from the centre of the last white cell on. Limited chroma adds up to less than a step of 8 bits.
    assert luma[:, :20].min() >= 1 - 1 / 255
    assert luma[:, 96:104].min() < 0.9


def test_a_photo_without_clipped_pixels_is_not_touched() -> None:
    """Floats that exceed 1 were not clipped there."""
    sharp, photo = pictures()
    beyond = (photo / np.float32(255)).astype(np.float32)
    beyond[-1, -1] = 1.5
    for encoded in (EncodedImage(np.minimum(photo, np.uint8(254)), "srgb"), EncodedImage(beyond, "linear")):
        limited = sharp.copy()
        keep_colours_near_clipped(limited, encoded, 0, SIZE)
        np.testing.assert_array_equal(limited, sharp)


def test_a_coloured_photo_that_is_overexposed_gains_and_linear_filters_stay_linear(monkeypatch):
    camera, exposure, log = Camera(192, 144, 260.0), Exposure(0.2, 0.05), hand_shake(0.5, seed=4)
    # Channels clip one after the other.
    light, _, rolling = simulate(np.array([4, 3, 2], np.float32) * scene(184, 232), log, camera, exposure, noise=0.004)
    photo, truth = np.clip(light, 0, 1), np.clip(rolling, 0, 1)

    def error(**options: str) -> float:
        image = deblur(photo, log, camera, exposure, check=False, **options).image
        return float(np.square(np.clip(image, 0, 1) - truth).mean())

    limited, linear = error(), error(prior="wiener")
    monkeypatch.setattr("rsdeblur.pipeline.steps.keep_colours_near_clipped", lambda *_, **__: None)
    assert limited < error()
    assert linear == error(prior="wiener")


def fading(height: int = 90, width: int = 70) -> tuple[NDArray[np.float32], EncodedImage]:
    random = np.random.default_rng(0)
    sharp, blurred = random.uniform(0.1, 1, (2, height, width, 3)).astype(np.float32)
    return sharp, EncodedImage(blurred, "linear")


def test_light_above_black_is_not_touched() -> None:
    sharp, encoded = fading()
    faded = sharp.copy()
    fade_undershoot(faded, encoded, 0, SIZE)
    np.testing.assert_array_equal(faded, sharp)


def test_only_the_blurred_picture_is_left_where_much_light_is_below_black() -> None:
    sharp, encoded = fading()
    sharp[30:70, 20:60] = -0.5
    faded = sharp.copy()
    fade_undershoot(faded, encoded, 0, SIZE)
    np.testing.assert_allclose(faded[35:65, 25:55], encoded.values[35:65, 25:55], atol=1e-6)
    # The Gaussian ends at 4 standard deviations of 0.15 PSFs each, and cells are half of one wide.
    np.testing.assert_array_equal(faded[:12], sharp[:12])


@pytest.mark.parametrize("peak", [2.0**-14, 0.0])
def test_dark_pictures_fade_as_bright_ones(peak: float) -> None:
    """Priors take the bright parts of a picture for 1e-3 at least; here, only a black picture has none."""
    sharp, encoded = fading()
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
