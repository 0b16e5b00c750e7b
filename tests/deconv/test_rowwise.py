"""RowDeconvolver: against dense systems, and the laws of all solvers of this package."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur.deconv import DerivativePrior, RowBlur, RowDeconvolver
from rsdeblur.estimate.strength import LENS
from rsdeblur.simulation.scene import scene
from tests.deconv.test_rowwise_blur import H, W, still_paths, wavy_paths

# Transforms of values near 1 in float32, times a gain of at most 1 / (2 sqrt(nsr)) = 5.
FLOAT32 = 2e-5


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(7).random((H, W, 3), dtype=np.float32)


def test_undoes_its_own_blur():
    """Without noise a tiny nsr restores a picture to 50 dB and more, if it is as soft as a lens leaves it.

    Near the highest frequency, hardly anything of a path's blur is left.
    """
    paths = wavy_paths(rows=90, cols=(60.0,), down=1.0, across=2.0)
    blur = RowBlur(paths, 120)
    sharp = gaussian_filter(scene(*blur.latent_shape[:2])[..., 1], LENS, mode=("nearest", "wrap"))
    deconvolver = RowDeconvolver(paths, (90, 120), nsr=1e-6, border="periodic")
    result = deconvolver.apply(blur.forward(sharp))
    # Rows near top and bottom are partly unknown: more unknowns than data.
    error = (result - sharp[-blur.top : 90 - blur.top])[24:-24]
    assert -10 * np.log10(np.mean(error**2)) > 50


@pytest.mark.parametrize("cols", [(16.0,), (5.0, 16.0, 27.0)])
@pytest.mark.parametrize("border", ["blend", "periodic"])
@pytest.mark.parametrize("prior", [None, DerivativePrior("gradient", 1e-9)], ids=["wiener", "hardly any prior"])
def test_no_motion_is_the_identity(picture, cols, border, prior):
    result = RowDeconvolver(still_paths(cols=cols), picture.shape, nsr=0.05, border=border).apply(picture, prior=prior)
    np.testing.assert_allclose(result, picture, atol=FLOAT32)


def test_auto_takes_conjugate_gradients_for_tall_psfs():
    assert RowDeconvolver(wavy_paths(), (H, W)).solver == "direct"
    tall = wavy_paths(rows=700, down=330.0, samples=700)
    assert RowDeconvolver(tall, (700, W)).solver == "cg"


def test_strips_leave_no_seams():
    """Strips that share their paths differ from the whole only by what lies beyond their margins."""
    picture = scene(80, 240)
    paths = wavy_paths(rows=80, cols=(119.5,))
    several = type(paths)(np.repeat(paths.displacements, 4, axis=1), paths.rows, np.array([30.0, 90.0, 150.0, 210.0]))
    whole, striped = (RowDeconvolver(p, picture.shape).apply(picture) for p in (paths, several))
    inside = np.s_[:, 24:-24]
    leak = np.sqrt(np.mean((striped - whole)[inside] ** 2))
    # The same bound as for Deconvolver.
    assert leak < 0.02 * np.sqrt(np.mean((whole - picture)[inside] ** 2))


def test_unseen_rows_are_reported_and_filled(picture):
    """Paths displaced by 5 rows: every row sees the row 5 rows below it, and no row sees the first 5."""
    paths = still_paths()
    moved = type(paths)(paths.displacements - np.array([0.0, 5.0]), paths.rows, paths.cols)
    assert RowDeconvolver(paths, picture.shape).coverage.all()
    deconvolver = RowDeconvolver(moved, picture.shape)
    np.testing.assert_array_equal(deconvolver.coverage, np.repeat(np.arange(H) >= 5, W).reshape(H, W))
    result = deconvolver.apply(picture)
    np.testing.assert_allclose(result[5:], picture[:-5], atol=FLOAT32)
    assert result[:5].min() > 0.3
    assert result[:5].max() < 0.7
