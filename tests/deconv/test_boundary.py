"""Pictures made periodic: the picture itself does not change, and no seam is left."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.paper.continuations import reflected, tapered
from rsdeblur import PsfBank
from rsdeblur.deconv.boundary import extended, smooth

H, W = 60, 85


@pytest.fixture
def light():
    return np.random.default_rng(0).random((H, W, 3), dtype=np.float32)


@pytest.fixture
def bank():
    kernels = np.random.default_rng(1).random((2, 2, 9, 15), dtype=np.float32)
    return PsfBank(kernels / kernels.sum(axis=(2, 3), keepdims=True), [20.0, 40.0], [20.0, 60.0])


def test_a_constant_stays_one(bank):
    flat = np.full((H, W, 1), 0.3, dtype=np.float32)
    for longer in (extended(flat, bank), reflected(flat, H + 7, W + 4), tapered(flat, bank.kernels[0, 0])):
        np.testing.assert_allclose(longer, 0.3, atol=1e-6)


@pytest.mark.parametrize("shape", [(1, 40, 1), (40, 1, 1), (1, 1, 1)])
def test_lines_of_pixels_are_filled_too(shape):
    line = np.random.default_rng(0).random(shape, dtype=np.float32)
    longer = smooth(line, shape[0] + 5, shape[1] + 7)
    np.testing.assert_array_equal(longer[: shape[0], : shape[1]], line)
    assert line.min() - 1e-6 <= longer.min()
    assert longer.max() <= line.max() + 1e-6


def test_the_smooth_filling_has_no_laplacian(light):
    longer = smooth(light, H + 11, W + 9).astype(np.float64)
    laplacian = sum(np.roll(longer, by, axis) for axis in (0, 1) for by in (-1, 1)) - 4 * longer
    # Not where two parts meet, and not along their straight sides: each part is harmonic on its own.
    for part in (np.s_[H:, 1 : W - 1], np.s_[1 : H - 1, W:], np.s_[H + 1 : -1, W + 1 : -1]):
        np.testing.assert_allclose(laplacian[part], 0, atol=1e-5)
    # A harmonic function stays within the range of its border.
    assert light.min() - 1e-6 <= longer.min()
    assert longer.max() <= light.max() + 1e-6
