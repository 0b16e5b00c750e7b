"""Shrinkage in the undecimated frame: the kernel against its twin, and the laws of the frame."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels import frame
from rsdeblur.kernels.frame import GATES, HALO, LEVELS, WORK
from tests.oracles.frame import combine_numpy, cut_block_numpy, put_block_numpy

COUNT = 3
SHAPE = 45, 58


def combined(planes, variances, means, factors, *, twin=False):
    out = np.empty([n - 2 * HALO for n in planes.shape[1:]], np.float32)
    work = np.zeros((WORK + len(planes), *planes.shape[1:]), np.float32)
    (combine_numpy if twin else frame.combine)(planes.copy(), variances, means, factors, GATES, work, out)
    return out


@pytest.fixture
def arguments():
    rng = np.random.default_rng(0)
    shapes = (COUNT, *SHAPE), (COUNT, LEVELS, 3), (COUNT,), (COUNT, LEVELS, 3, 3)
    planes, variances, means, factors = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    return planes, np.abs(variances), means, factors


@pytest.mark.parametrize("count", [1, 2, COUNT])
def test_kernel_and_twin_agree(arguments, count):
    parts = [array[:count] for array in arguments]
    # Sums of some hundred float32 values of about 1.
    np.testing.assert_allclose(combined(*parts), combined(*parts, twin=True), atol=2e-5)


@pytest.mark.parametrize("twin", [False, True])
def test_without_gates_the_pictures_come_back(arguments, twin):
    planes, variances, _, factors = arguments
    weights = np.array([2.0, -1.0, 0.5], np.float32)
    plain = np.zeros_like(factors)
    plain[..., 0] = weights[:, None, None]
    expected = np.tensordot(weights, planes, 1)[HALO:-HALO, HALO:-HALO]
    np.testing.assert_allclose(combined(planes, variances, weights, plain, twin=twin), expected, atol=1e-5)


@pytest.mark.parametrize("turn", [lambda p: p[:, ::-1], lambda p: p[:, :, ::-1], lambda p: p.swapaxes(1, 2)])
def test_a_mirrored_or_turned_picture_gives_the_same_result(arguments, turn):
    planes, variances, means, factors = arguments
    variances[:, :, 1], factors[:, :, 1] = variances[:, :, 0], factors[:, :, 0]
    result = combined(planes, variances, means, factors)
    turned = combined(np.ascontiguousarray(turn(planes)), variances, means, factors)
    np.testing.assert_allclose(turned, turn(result[None])[0], atol=2e-5)


def test_blocks_are_cut_mixed_and_put_back():
    rng = np.random.default_rng(1)
    picture = rng.random((9, 11, 3)).astype(np.float32)
    mix = np.linalg.qr(rng.normal(size=(3, 3)))[0].astype(np.float32)
    rows, columns = np.array([2, 1, 0, 0, 1, 2]), np.arange(11)
    for cut, put in ((frame.cut_block, frame.put_block), (cut_block_numpy, put_block_numpy)):
        planes, back = np.empty((3, 6, 11), np.float32), np.empty((6, 11, 3), np.float32)
        cut(picture, rows, columns, mix, planes)
        np.testing.assert_allclose(planes, np.moveaxis(picture[rows] @ mix.T, -1, 0), atol=1e-6)
        put(planes, mix, back)
        np.testing.assert_allclose(back, picture[rows], atol=1e-6)
