"""Orientations at and between samples; their laws are those of the track, in tests/motion/test_track.py."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.orientation import integrated, orientations
from tests.oracles.orientation import integrated_numpy, orientations_numpy, rotation_matrix


def test_the_kernel_equals_its_twin():
    """Between samples, at them, beyond the ends, and without a rotation."""
    random = np.random.default_rng(0)
    t, omega = np.cumsum(random.uniform(0.5, 1.5, 8)), random.normal(size=(8, 3))
    omega[3:5] = 0.0
    rotations = rotation_matrix(random.normal(size=(8, 3)))
    times = np.concatenate([random.uniform(t[0] - 1, t[-1] + 1, 48), t, [t[3] + 1e-12, t[3] + 0.1]]).reshape(2, 29)
    found = orientations(times, t, omega, rotations)
    assert found.shape == (2, 29, 3, 3)
    # Rounding of sums of products of some radians.
    np.testing.assert_allclose(found, orientations_numpy(times, t, omega, rotations), atol=1e-14)


def test_the_integral_equals_its_twin():
    random = np.random.default_rng(1)
    t, omega = np.cumsum(random.uniform(0.5, 1.5, 30)), random.normal(size=(30, 3))
    omega[3:5] = 0.0
    # Rounding of 29 products of matrices.
    np.testing.assert_allclose(integrated(t, omega), integrated_numpy(t, omega), atol=1e-13)
