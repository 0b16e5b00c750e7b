"""Points as seen from the poses of rows."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.poses import pinhole_paths, row_directions
from tests.oracles.poses import pinhole_paths_numpy, row_directions_numpy


def test_the_kernel_equals_its_twin():
    """Between rows, beyond the first and the last one, and where there is no row or no point."""
    random = np.random.default_rng(0)
    matrices, world = random.normal(size=(20, 12)), random.normal(size=(4, 6, 3))
    rows = random.uniform(-8, 18, (4, 6))
    rows[0, :4] = np.nan, np.inf, -np.inf, -5.0
    rows[1, 0], world[2, 3] = 14.0, np.nan
    found = row_directions(world, rows, matrices)
    # Rounding of sums of four products.
    np.testing.assert_allclose(found, row_directions_numpy(world, rows, matrices), atol=1e-14)
    assert np.isnan(found[2, 3]).all()
    assert np.isfinite(np.delete(found.reshape(-1, 3), 15, axis=0)).all()


def test_paths_of_a_pinhole_equal_their_twin():
    """With points behind the camera, and beyond the first and the last row."""
    random = np.random.default_rng(1)
    pose = np.hstack([np.eye(3), np.zeros((3, 1))]).ravel()
    matrices = pose + 0.02 * random.normal(size=(20, 12)).cumsum(axis=0)
    orientation = np.eye(3) + 0.1 * random.normal(size=(4, 6, 3, 3))
    position, scene = (
        0.1 * random.normal(size=(4, 6, 3)),
        np.array([0.0, 0.0, 1.0]) + 0.2 * random.normal(size=(4, 5, 3)),
    )
    scene[1, 2, 2] = -1.0
    rows, cols = np.array([-3.0, 0.0, 4.5, 15.0]), np.linspace(0, 9, 5)
    arguments = orientation, position, scene, rows, cols, matrices, (9.0, 8.0, 4.5, 5.0), 3
    paths = pinhole_paths(*arguments)
    # Rounding, which each of three steps may magnify: between rows, poses change by some 1e-2.
    np.testing.assert_allclose(paths, pinhole_paths_numpy(*arguments), atol=1e-11)
    assert np.isnan(paths[1, 2]).all()
    assert np.isfinite(np.delete(paths.reshape(20, 6, 2), 7, axis=0)).all()
