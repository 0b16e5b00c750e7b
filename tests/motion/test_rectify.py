"""Laws of the rectification: a rolling-shutter picture becomes the picture of a single moment."""

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio

from rsdeblur import Camera, Exposure, GyroLog, scene, simulate
from rsdeblur.motion import Capture
from rsdeblur.motion.rectify import rectify

HEIGHT, WIDTH, PAD = 80, 96, 16
EXPOSURE = Exposure(0.12, 0.02)
INSIDE = np.s_[12:-12, 12:-12]


def camera_of(readout_time=0.03, **options):
    return Camera(WIDTH, HEIGHT, 110.0, readout_time=readout_time, **options)


@pytest.fixture(scope="module")
def large():
    """Return a scene that continues beyond the frame and contains no detail too fine for a spline."""
    picture = scene(HEIGHT + 2 * PAD, WIDTH + 2 * PAD, seed=2)
    spectrum = np.fft.rfft2(picture, axes=(0, 1))
    fy, fx = np.fft.fftfreq(picture.shape[0])[:, None, None], np.fft.rfftfreq(picture.shape[1])[:, None]
    spectrum *= np.exp(-0.5 * (2 * np.pi * 0.8) ** 2 * (fx**2 + fy**2))
    return np.fft.irfft2(spectrum, picture.shape[:2], axes=(0, 1)).astype(np.float32)


@pytest.mark.parametrize("direction", ["top-down", "bottom-up"])
@pytest.mark.parametrize("seed", range(3))
def test_the_rolling_picture_becomes_the_rectified_one(large, shaky_log, direction, seed):
    log, camera = shaky_log(seed=seed), camera_of(readout_direction=direction)
    truth = simulate(large, log, camera, EXPOSURE)
    image, coverage = rectify(truth.rolling, Capture.from_log(log, camera, EXPOSURE))
    before, after = (
        peak_signal_noise_ratio(truth.rectified[INSIDE], p[INSIDE], data_range=1) for p in (truth.rolling, image)
    )
    # Errors of two spline interpolations of a picture blurred by 0.8 px; a skew of a pixel or more would be larger.
    assert after > 45
    assert after > before + 12
    assert coverage[INSIDE].all()


@pytest.mark.parametrize("rate", [(0, 0, 0), (2, -1, 3)])
def test_without_readout_it_is_the_identity(large, rate):
    log = GyroLog(np.linspace(0, 0.4, 81), np.tile(np.float64(rate), (81, 1)))
    image = large[:HEIGHT, :WIDTH]
    rectified, coverage = rectify(image, Capture.from_log(log, camera_of(0.0), EXPOSURE))
    # Float32 spline coefficients.
    np.testing.assert_allclose(rectified, image, atol=3e-6)
    assert coverage.all()


@pytest.mark.parametrize("rate", [1.0, -1.0])
def test_coverage_marks_what_no_row_saw(rate):
    # A pan of 1 rad/s about y moves the picture by f omega = 110 px/s: rows 15 ms from the middle are off by 1.65 px.
    log = GyroLog(np.linspace(0, 0.4, 81), np.tile([0.0, rate, 0.0], (81, 1)))
    ramp = np.tile(np.arange(WIDTH, dtype=np.float32)[:, None], (HEIGHT, 1, 1))
    image, coverage = rectify(ramp, Capture.from_log(log, camera_of(), EXPOSURE))
    # Positive rates move the scene to the left: the first rows show it too far right and miss its right end.
    corners = coverage[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_array_equal(corners, [True, False, False, True] if rate > 0 else [False, True, True, False])
    assert coverage[:, 3:-3].all()
    assert coverage[HEIGHT // 2].all()
    # Where no row saw the scene, the border pixel is repeated.
    repeated = image[~coverage][:, 0]
    np.testing.assert_allclose(np.minimum(repeated, WIDTH - 1 - repeated), 0.0, atol=1e-3)
    # Elsewhere the ramp is moved back.
    assert image[0, 40, 0] - 40 == pytest.approx(np.sign(rate) * 1.65, abs=0.1)
