"""Wiener filters of OTFs: agreement with the NumPy twin, and their place among the filters."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.wiener import invert
from tests.oracles.wiener import invert_numpy

NSR, SCALE = np.float32(0.01), np.float32(0.5)


def otfs(count: int, length: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return (rng.normal(size=(count, length)) + 1j * rng.normal(size=(count, length))).astype(np.complex64)


@pytest.mark.parametrize(("block", "count"), [(0, 8), (1, 8), (2, 8), (0, 4)])
def test_twins_agree(block: int, count: int) -> None:
    one, other = np.full((2, 3, 2, 4, 10), 7, np.complex64)
    invert(otfs(count, 10), NSR, SCALE, block, 1, one)
    invert_numpy(otfs(count, 10), NSR, SCALE, block, 1, other)
    # Rounding of some operations in float32.
    np.testing.assert_allclose(one, other, rtol=1e-6)


def test_without_noise_the_filter_is_the_inverse() -> None:
    spectra, out = otfs(4, 10), np.empty((1, 1, 4, 10), np.complex64)
    invert(spectra, np.float32(0), np.float32(1), 0, 0, out)
    # Rounding in float32, larger where real and imaginary parts cancel.
    np.testing.assert_allclose(out[0, 0] * spectra, 1.0, rtol=1e-5)
