"""Laws of kernels that paint and measure; test_twins.py compares all kernels with their oracles."""

import numpy as np
import pytest
import scipy.fft

from rsdeblur.kernels import chroma, whittle
from rsdeblur.kernels.raster import interpolated, rasterize
from rsdeblur.kernels.tone import END, to_srgb
from rsdeblur.kernels.whittle import Tiles, fit_gains, information, smoothed_power
from tests.oracles.geometry import rasterize_numpy

# A few roundings of values up to 1; slopes up to 4 divide by variances down to FLAT.
FLOAT32, SLOPED = 1e-6, 1e-4


@pytest.fixture(params=[(1, 1), (2, 7), (37, 50)], ids=str)
def picture(request):
    return np.random.default_rng(0).random((*request.param, 3), dtype=np.float32)


def joined(luma, half, peak):
    out = np.empty((*luma.shape[:2], 3), np.float32)
    chroma.join(luma, half, peak, out)
    return out


def test_an_even_colour_comes_back(picture):
    """Where all pixels have the same ratios of red, green and blue, the brightness says all."""
    coloured = picture[..., :1] * np.float32([0.9, 0.5, 0.1])
    luma, half = chroma.separate(coloured)
    # Things much darker than the bright parts count as grey.
    np.testing.assert_allclose(joined(luma, half, 1.0), coloured, atol=chroma.DARK)


def test_ringing_below_black_is_not_amplified():
    """Where the brightness is about zero, ratios to it mean nothing."""
    rng = np.random.default_rng(2)
    luma = rng.normal(0.0, 0.02, (64, 80, 1)).astype(np.float32)
    half = rng.normal([0.05, -0.03, 0.0], 0.02, (32, 40, 3)).astype(np.float32)
    out = joined(luma, half, 1.0)
    # The mean of the colours, and at most four times what the brightness differs from its mean, 0.1 at most.
    assert np.abs(out).max() < 0.1 + 4 * 0.15


@pytest.fixture(params=[(8, 8), (6, 4), (64, 64)], ids=str)
def noise_tiles(request):
    return np.random.default_rng(0).normal(size=(3, *request.param)).astype(np.float32)


def test_the_whole_spectrum_is_smoothed(noise_tiles):
    """Half a spectrum gives the same as the whole one, convolved with 1/6, 2/3, 1/6 along both axes."""
    power = np.abs(np.fft.fft2(noise_tiles)) ** 2
    for axis in (1, 2):
        power = 2 / 3 * power + (np.roll(power, 1, axis) + np.roll(power, -1, axis)) / 6
    half = power[..., : noise_tiles.shape[2] // 2 + 1]
    np.testing.assert_allclose(smoothed_power(scipy.fft.rfft2(noise_tiles)), half, rtol=1e-4, atol=1e-5 * half.max())


# Dark and bright, below black and beyond white, and either side of the end of the straight part.
LIGHT = np.concatenate(
    [
        np.linspace(-2.0, 2.0, 3001, dtype=np.float32),
        np.nextafter(np.repeat(END, 2), np.array([0, 1], np.float32)),
        np.array([END, -END, 0.0, 1e-40, 1e12], np.float32),
    ]
)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_are_the_rounded_clipped_values(dtype: type) -> None:
    most = np.iinfo(dtype).max
    levels, is_finite = to_srgb(LIGHT, dtype)
    assert levels.dtype == dtype
    assert is_finite
    np.testing.assert_array_equal(levels, np.rint(to_srgb(LIGHT)[0].clip(0, 1) * np.float32(most)))
    for value in (np.nan, np.inf, -np.inf):
        assert not to_srgb(np.append(LIGHT, np.float32(value)), dtype)[1]


HALF_HEIGHT, HALF_WIDTH = 9, 12

# Gauss points in steps of a tenth of a pixel do not see where in a step the bilinear window has its kink.
ATOL = 2e-4


def random_paths(count=9, samples=17, seed=0):
    """Return smooth paths that reach 8 px down and 11 px across; every third one moves along one axis only."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2 * np.pi, samples)
    waves = rng.normal(size=(count, 3, 2))[:, :, None] * np.sin(np.arange(1, 4)[:, None] * t + 1.0)[None, :, :, None]
    paths = waves.sum(axis=1)
    paths *= [10.9, 7.9] / np.abs(paths).max(axis=1, keepdims=True)
    paths[1::3, :, 0] = 0.3
    paths[2::3, :, 1] = -2.0
    return paths


def test_paths_over_many_pixels_are_traced_as_by_the_oracle():
    paths = random_paths()
    kernels = rasterize(paths, HALF_HEIGHT, HALF_WIDTH)
    assert kernels.min() >= 0
    np.testing.assert_allclose(kernels.sum(axis=(1, 2), dtype=np.float64), 1, atol=1e-6)
    np.testing.assert_allclose(kernels, rasterize_numpy(paths, HALF_HEIGHT, HALF_WIDTH), rtol=0, atol=ATOL)
    dy, dx = np.mgrid[-HALF_HEIGHT : HALF_HEIGHT + 1, -HALF_WIDTH : HALF_WIDTH + 1]
    centroids = np.einsum("nyx,ayx->na", kernels.astype(float), np.stack([dx, dy]))
    # Bilinear weights keep the mean over time; float32 rounds by 6e-8 of a reach below 12 px.
    np.testing.assert_allclose(centroids, 0.5 * (paths[:, 1:] + paths[:, :-1]).mean(axis=1), rtol=0, atol=1e-6)


@pytest.mark.parametrize(("x", "y"), [(0, 0), (5, -3), (-11, 8)])
def test_a_point_on_a_pixel_is_a_delta(x, y):
    kernel = rasterize(np.array([[[x, y], [x, y]]], dtype=np.float64), HALF_HEIGHT, HALF_WIDTH)[0]
    expected = np.zeros_like(kernel)
    expected[HALF_HEIGHT + y, HALF_WIDTH + x] = 1.0
    np.testing.assert_array_equal(kernel, expected)


def test_interpolated_kernels():
    """They sum to 1, keep whole pixels, and transmit up to half the highest frequency."""
    paths = np.array([[[2.0, -3.0]] * 2, [[0.5, 0.25]] * 2, [[-1.3, 0.5], [2.0, 1.0]]])
    still, between, moving = kernels = interpolated(paths, 7, 7)
    np.testing.assert_allclose(kernels.sum(axis=(1, 2)), 1, atol=1e-6)
    np.testing.assert_allclose(still, np.eye(15)[4][:, None] * np.eye(15)[9], atol=1e-6)
    waves = np.exp(-2j * np.pi * 0.25 * (np.arange(15) - 7))
    assert abs(waves @ between @ waves) == pytest.approx(1, abs=0.03)
    assert moving.max() < 0.5
    assert np.isnan(interpolated(paths, 6, 7)[0]).all()


PLACES, FREQUENCIES = 12, 160
SECTORS = np.arange(0, FREQUENCIES + 1, 20)
PLACE = np.arange(PLACES) % 2
LIGHTS = np.array([0.3, 1.0])
RNG = np.random.default_rng(0)
FREQUENCY = RNG.uniform(0.02, 0.5, FREQUENCIES)
NOISE = np.full((PLACES, FREQUENCIES), 0.1, np.float32)


def power_of(theta):
    """Return power at two places that depends smoothly on two parameters."""
    blur, tilt = theta
    shape = np.exp(-20 * blur * FREQUENCY**2 + tilt * np.sin(20 * FREQUENCY)) / FREQUENCY**1.5
    return np.stack([shape, shape * np.exp(-(FREQUENCY**2))]).astype(np.float32)


GAINS = np.exp(RNG.normal(size=(PLACES, len(SECTORS) - 1)))
SIGNAL = np.repeat(GAINS, np.diff(SECTORS), axis=1) * power_of((1.0, 0.3))[PLACE]
POWER = ((SIGNAL + NOISE) * RNG.exponential(size=SIGNAL.shape)).astype(np.float32)


def observed(theta, factor=1.0):
    return Tiles(POWER, NOISE, np.float32(factor) * power_of(theta), PLACE, SECTORS)


def nats(theta, stiffness):
    return fit_gains(observed(theta), LIGHTS[1:], stiffness)[0].sum()


@pytest.mark.parametrize("stiffness", [0.0, 1e4])
def test_the_gradient_is_that_of_the_nats(stiffness):
    theta, step = np.array([1.1, 0.2]), 1e-3
    _, *fitted = fit_gains(observed(theta), LIGHTS[1:], stiffness)
    axes = step * np.eye(2)
    slopes = np.stack([np.log(power_of(theta + axis) / power_of(theta - axis)) / np.float32(2 * step) for axis in axes])
    gradient, fisher = information(observed(theta), slopes, tuple(fitted), stiffness)
    differences = [(nats(theta + axis, stiffness) - nats(theta - axis, stiffness)) / (2 * step) for axis in axes]
    # The gains are found to 2 percent, which changes the gradient at second order.
    np.testing.assert_allclose(gradient.sum(axis=0), differences, rtol=0.05)
    assert (np.linalg.eigvalsh(fisher) > -1e-9).all()


def test_tiles_are_fitted_alike_alone_and_together(monkeypatch):
    """C fits each tile alone, 16 frequencies at a time; NumPy takes the steps of several tiles together."""
    fits = [fit_gains(observed((1.0, 0.3)), LIGHTS, 20.0)]
    monkeypatch.setattr(whittle, "fit_tiles", whittle.fit_tiles_numpy)
    monkeypatch.setattr(whittle, "TOGETHER", 5)
    fits.append(fit_gains(observed((1.0, 0.3)), LIGHTS, 20.0))
    for alone, together in zip(*fits, strict=True):
        np.testing.assert_allclose(alone, together, rtol=2e-6)  # float32 terms of sums


def test_power_of_the_scene_does_not_count():
    """Gains absorb any factor on the power_of power."""
    once, more = (fit_gains(observed((1.0, 0.3), factor), LIGHTS, 20.0) for factor in (1.0, 5.0))
    # Newton's steps end when the logarithms change by less than 0.02.
    np.testing.assert_allclose(once[0], more[0], rtol=1e-4)
