"""Shrinkage in the undecimated frame: laws of the frame."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels import frame
from rsdeblur.kernels.frame import GATES, HALO, LEVELS, WORK

COUNT = 3
SHAPE = 45, 58


def combined(planes, variances, means, factors):
    out = np.empty([n - 2 * HALO for n in planes.shape[1:]], np.float32)
    work = np.zeros((WORK + len(planes), *planes.shape[1:]), np.float32)
    frame.combine(planes.copy(), variances, means, np.repeat(factors, 2, axis=-1)[..., ::2], GATES, work, out)
    return out


@pytest.fixture
def arguments():
    rng = np.random.default_rng(0)
    shapes = (COUNT, *SHAPE), (COUNT, LEVELS, 3), (COUNT,), (COUNT, LEVELS, 3, 3)
    planes, variances, means, factors = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    return planes, np.abs(variances), means, factors


def test_without_gates_the_pictures_come_back(arguments):
    planes, variances, _, factors = arguments
    weights = np.array([2.0, -1.0, 0.5], np.float32)
    plain = np.zeros_like(factors)
    plain[..., 0] = weights[:, None, None]
    expected = np.tensordot(weights, planes, 1)[HALO:-HALO, HALO:-HALO]
    np.testing.assert_allclose(combined(planes, variances, weights, plain), expected, atol=1e-5)


@pytest.mark.parametrize("turn", [lambda p: p[:, ::-1], lambda p: p[:, :, ::-1], lambda p: p.swapaxes(1, 2)])
def test_a_mirrored_or_turned_picture_gives_the_same_result(arguments, turn):
    planes, variances, means, factors = arguments
    variances[:, :, 1], factors[:, :, 1] = variances[:, :, 0], factors[:, :, 0]
    result = combined(planes, variances, means, factors)
    turned = combined(np.ascontiguousarray(turn(planes)), variances, means, factors)
    np.testing.assert_allclose(turned, turn(result[None])[0], atol=2e-5)
