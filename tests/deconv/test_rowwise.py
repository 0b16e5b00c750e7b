"""RowBlur: a linear operator, its adjoint, and the simulator; RowDeconvolver: the laws of all solvers."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Exposure, scene, simulate
from rsdeblur.deconv import DerivativePrior, RowBlur, RowDeconvolver
from rsdeblur.kernels.raster import interpolated
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.tuning.strength import LENS

H, W = 40, 33


def wavy_paths(rows=H, cols=(W / 2,), *, down=3.0, across=5.0, samples=25):
    """Paths that turn and grow down the picture and from strip to strip."""
    y, t = np.arange(float(rows)), np.linspace(-1.0, 1.0, samples)
    angle = 2 * np.pi * (y[:, None, None] / rows + 0.1 * np.arange(len(cols))[:, None] + 0.2 * t)
    paths = np.stack([across * t * np.cos(angle), down * t * np.sin(angle) + 0.5 * np.cos(3 * t + angle)], axis=-1)
    return BlurPaths(paths, y, np.array(cols, dtype=float))


def still_paths(rows=H, cols=(W / 2,)):
    return BlurPaths(np.zeros((rows, len(cols), 2, 2)), np.arange(float(rows)), np.array(cols, dtype=float))


@pytest.mark.parametrize("cols", [(16.0,), (3.0, 12.0, 25.0)])
def test_adjoint_is_the_adjoint(cols):
    blur = RowBlur(wavy_paths(cols=cols), W, channels=2)
    rng = np.random.default_rng(0)
    latent, picture = rng.normal(size=blur.latent_shape), rng.normal(size=blur.picture_shape)
    forward, adjoint = np.vdot(blur.forward(latent), picture), np.vdot(latent, blur.adjoint(picture))
    assert abs(forward - adjoint) < 1e-5 * np.linalg.norm(latent) * np.linalg.norm(picture) / np.sqrt(latent.size)


def test_each_row_is_convolved_with_its_own_psf():
    paths = wavy_paths()
    blur = RowBlur(paths, W)
    latent = np.random.default_rng(1).random(blur.latent_shape[:2])
    half_width, half_height = (int(np.abs(paths.displacements[..., axis]).max()) + 5 for axis in (0, 1))
    expected = np.zeros((H, W))
    for (y, i, j), weight in np.ndenumerate(interpolated(paths.displacements[:, 0], half_height, half_width)):
        if weight:
            expected[y] += weight * np.roll(latent[y - (i - half_height) - blur.top], j - half_width)
    # float32 sums of a picture in [0, 1].
    np.testing.assert_allclose(blur.forward(latent), expected, atol=2e-6)


def test_offsets_of_many_pixels_shift():
    """Rectifying paths lie far from zero."""
    paths = still_paths()
    moved = BlurPaths(paths.displacements + np.array([40.0, -17.0]), paths.rows, paths.cols)
    blur = RowBlur(moved, W)
    latent = np.random.default_rng(3).random(blur.latent_shape[:2], dtype=np.float32)
    expected = np.roll(latent[17 - blur.top : H + 17 - blur.top], 40, axis=1)
    np.testing.assert_allclose(blur.forward(latent), expected, atol=1e-6)


def test_agrees_with_the_simulator(shaky_log):
    """The simulator warps the scene by cubic splines and shares no code with the paths."""
    camera, exposure = Camera(160, 120, 150.0, readout_time=0.03), Exposure(0.1, 1 / 30)
    log, world = shaky_log(), gaussian_filter(scene(200, 240), (1, 1, 0))
    seen = simulate(world, log, camera, exposure)
    capture = Capture.from_log(log, camera, exposure)
    cols = np.arange(8, 160, 16.0)
    blur = RowBlur(BlurPaths.every_row(capture, cols), 160, channels=3)
    # Beyond the frame lies a copy of its border rows.
    latent = seen.rolling[(np.arange(blur.latent_shape[0]) + blur.top).clip(0, 119)]
    inside = np.s_[16:-16, 24:-24]
    error = np.sqrt(np.mean((blur.forward(latent) - seen.blurred)[inside] ** 2))
    # PSFs are bilinear, and the scene is as soft as behind a lens. Measured: 0.0028 (51 dB), for a blur of 0.02.
    assert error < 0.004


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


def test_unseen_rows_are_filled(picture):
    """Paths displaced by 5 rows: every row sees the row 5 rows below it, and no row sees the first 5."""
    paths = still_paths()
    moved = type(paths)(paths.displacements - np.array([0.0, 5.0]), paths.rows, paths.cols)
    result = RowDeconvolver(moved, picture.shape).apply(picture)
    np.testing.assert_allclose(result[5:], picture[:-5], atol=FLOAT32)
    assert result[:5].min() > 0.3
    assert result[:5].max() < 0.7
