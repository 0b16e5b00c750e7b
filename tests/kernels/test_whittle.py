"""Likelihood of periodograms: derivatives and invariances."""

import numpy as np
import pytest

from rsdeblur.kernels.whittle import Tiles, fit_gains, information

TILES, FREQUENCIES = 12, 160
SECTORS = np.arange(0, FREQUENCIES + 1, 20)
PLACE = np.arange(TILES) % 2
LEVELS = np.array([0.3, 1.0])
RNG = np.random.default_rng(0)
FREQUENCY = RNG.uniform(0.02, 0.5, FREQUENCIES)
NOISE = np.full((TILES, FREQUENCIES), 0.1, np.float32)


def expected(theta):
    """Return power at two places that depends smoothly on two parameters."""
    blur, tilt = theta
    shape = np.exp(-20 * blur * FREQUENCY**2 + tilt * np.sin(20 * FREQUENCY)) / FREQUENCY**1.5
    return np.stack([shape, shape * np.exp(-(FREQUENCY**2))]).astype(np.float32)


GAINS = np.exp(RNG.normal(size=(TILES, len(SECTORS) - 1)))
SIGNAL = np.repeat(GAINS, np.diff(SECTORS), axis=1) * expected((1.0, 0.3))[PLACE]
POWER = ((SIGNAL + NOISE) * RNG.exponential(size=SIGNAL.shape)).astype(np.float32)


def tiles(theta, factor=1.0):
    return Tiles(POWER, NOISE, np.float32(factor) * expected(theta), PLACE, SECTORS)


def nats(theta, stiffness):
    return fit_gains(tiles(theta), LEVELS[1:], stiffness)[0].sum()


@pytest.mark.parametrize("stiffness", [0.0, 1e4])
def test_the_gradient_is_that_of_the_nats(stiffness):
    theta, step = np.array([1.1, 0.2]), 1e-3
    _, *fitted = fit_gains(tiles(theta), LEVELS[1:], stiffness)
    axes = step * np.eye(2)
    slopes = np.stack([np.log(expected(theta + axis) / expected(theta - axis)) / np.float32(2 * step) for axis in axes])
    gradient, fisher = information(tiles(theta), slopes, tuple(fitted), stiffness)
    differences = [(nats(theta + axis, stiffness) - nats(theta - axis, stiffness)) / (2 * step) for axis in axes]
    # The gains are found to 2 percent, which changes the gradient at second order.
    np.testing.assert_allclose(gradient.sum(axis=0), differences, rtol=0.05)
    assert (np.linalg.eigvalsh(fisher) > -1e-9).all()


def test_power_of_the_scene_does_not_count():
    """Gains absorb any factor on the expected power."""
    once, more = (fit_gains(tiles((1.0, 0.3), factor), LEVELS, 20.0) for factor in (1.0, 5.0))
    # Newton's steps end when the logarithms change by less than 0.02.
    np.testing.assert_allclose(once[0], more[0], rtol=1e-4)
