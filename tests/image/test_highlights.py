"""Clipped highlights: found, separated from the picture, added back."""

from functools import partial

import numpy as np
import pytest
from scipy import ndimage

import rsdeblur
from rsdeblur import Camera, Exposure, GyroLog, hand_shake, scene, simulate
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.image.highlights import at_full_scale, find_spots
from rsdeblur.simulation import Simulation

# The check of a result changes no picture and has its own tests.
deblur = partial(rsdeblur.deblur, check=False)

EXPOSURE = Exposure(0.05, 0.04)
CAMERA = Camera(160, 128, 180.0, readout_time=0.03)
# Row and column in the frame, radius in px, light.
LAMPS = ((40, 40, 2.0, 12.0), (84, 110, 1.0, 40.0))


@pytest.fixture(scope="module")
def log() -> GyroLog:
    return hand_shake(0.2, strength=1.5, seed=3)


@pytest.fixture(scope="module")
def night(log: GyroLog) -> Simulation:
    """Two lamps before a dim shelf."""
    light = 0.12 * scene(168, 200)
    y, x = np.mgrid[:168, :200]
    for row, col, radius, value in LAMPS:
        disc = np.clip(radius + 0.5 - np.hypot(y - row - 20, x - col - 20), 0, 1)
        light = light + value * ndimage.gaussian_filter(disc, 0.7)[..., None]
    return simulate(light.astype(np.float32), log, CAMERA, EXPOSURE, noise=0.003)


def streaks(truth: np.ndarray, image: np.ndarray) -> float:
    """Return the mean squared error around the lamps, without the lamps."""
    lamps = ndimage.binary_dilation(truth.max(axis=-1) > 0.5, iterations=2)
    near = ndimage.binary_dilation(lamps, iterations=20) & ~lamps
    return float(np.square(image.clip(0, 1) - truth.clip(0, 1))[near].mean())


@pytest.mark.parametrize(("mode", "prior"), [("global", "tv"), ("banded", "wiener"), ("rowwise", "tv")])
def test_streaks_around_lamps_drop(night: Simulation, log: GyroLog, mode: str, prior: str) -> None:
    recorded = night.blurred.clip(0, 1)
    plain, careful = (
        deblur(recorded, log, CAMERA, EXPOSURE, mode=mode, prior=prior, saturation=saturation).image
        for saturation in ("ignore", "always")
    )
    # Measured factors of 44 to 107: the shelf is dim, and in light streaks are nearly all of the error.
    assert streaks(night.rolling, careful) < streaks(night.rolling, plain) / 10
    # The brightest pixel has a light of 20, recorded as 1. Measured: restored to 10.
    assert careful.max() > 5


@pytest.fixture(scope="module")
def dim(log: GyroLog) -> np.ndarray:
    """Simulate a picture without clipped pixels."""
    return simulate(0.9 * scene(168, 200), log, CAMERA, EXPOSURE).blurred.clip(0, 0.99)


@pytest.mark.parametrize("mode", ["banded", "rowwise"])
def test_without_clipped_pixels_nothing_changes(dim: np.ndarray, log: GyroLog, mode: str) -> None:
    picture = dim[..., :1]
    stored = np.rint(picture * 255).astype(np.uint8)
    for image in (picture, stored):
        a, b = (
            deblur(image, log, CAMERA, EXPOSURE, mode=mode, saturation=s, prior="wiener") for s in ("ignore", "always")
        )
        np.testing.assert_array_equal(a.image, b.image)


def test_a_bright_wall_is_no_highlight(log: GyroLog) -> None:
    """Next to light that is nearly as bright, little was cut off: the picture does not change."""
    wall = np.full((168, 200), 0.8, dtype=np.float32)
    wall[40:100, 60:140] = 1.2
    picture = simulate(wall, log, CAMERA, EXPOSURE).blurred.clip(0, 1)
    a, b = (deblur(picture, log, CAMERA, EXPOSURE, saturation=s, prior="wiener") for s in ("ignore", "always"))
    np.testing.assert_array_equal(a.image, b.image)


def test_spots_are_at_full_scale_with_what_touches_it() -> None:
    values = np.zeros((6, 6, 1), dtype=np.uint8)
    values[1, 1:4, 0] = 255, 251, 249
    values[5, 5, 0] = 252
    as_float = values.astype(np.float32) / np.float32(255)
    for stored in (values, as_float, values.astype(np.uint16) * 257):
        (spot,) = find_spots(EncodedImage(stored, "linear"))
        assert (spot.rows, spot.cols) == (slice(1, 2), slice(1, 3))
        assert spot.lost[..., 0].tolist() == [[True, True]]
    assert np.argwhere(at_full_scale(values)).tolist() == [[1, 1, 0]]
    # A float picture that exceeds 1 was not clipped there.
    as_float[0, 0] = 1.5
    assert not find_spots(EncodedImage(as_float, "linear"))
    assert not at_full_scale(as_float).any()


def test_by_day_glints_count_beside_white_things(log: GyroLog) -> None:
    """A glint, and a white plate that is no larger than trails: the glint is taken out, the plate is not."""
    camera, light = Camera(400, 320, 180.0, readout_time=0.03), np.full((360, 440, 1), 0.3, dtype=np.float32)
    light[120:122, 120:122] = 10
    light[240:270, 260:310] = 1.5
    picture = simulate(light, log, camera, EXPOSURE).blurred.clip(0, 1)
    auto, plain = (
        deblur(picture, log, camera, EXPOSURE, saturation=s, prior="wiener", nsr=0.01).image for s in ("auto", "ignore")
    )
    # Measured: 9.8 and 3.8; the glint has a light of 10.
    assert auto[96:106, 94:106].max() > 2 * plain.max()
    # The filter reaches this far with a thousandth of the glint.
    np.testing.assert_allclose(auto[200:, 220:], plain[200:, 220:], atol=0.01)


def test_overexposed_daylight_is_harmed_little(log: GyroLog) -> None:
    """White books and walls in the sun are clipped, too, but they are not lamps."""
    seen = simulate(5 * scene(168, 200), log, CAMERA, EXPOSURE, noise=0.003)
    recorded = seen.blurred.clip(0, 1)
    assert (recorded == 1).any(axis=2).mean() > 0.7
    plain, careful = (
        deblur(recorded, log, CAMERA, EXPOSURE, saturation=s, prior="wiener").image for s in ("ignore", "always")
    )
    error, then = (np.square(image.clip(0, 1) - seen.rolling.clip(0, 1)).mean() for image in (plain, careful))
    # Measured: 1.006 times as large; 1.5 times if walls count as highlights.
    assert then < 1.1 * error
