"""Comparison of motions by the sharp picture: its tiles, and the right motion against others."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Correction, Exposure, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.sharpness import (
    TILES,
    QuickSharpness,
    WholeSharpness,
    _RepeatingTiles,
    concentrations,
    contrast_shares,
)
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake


def test_tiles_without_blur_are_parts_of_the_picture():
    light = np.random.default_rng(0).random((90, 140), dtype=np.float32)
    tiles = _RepeatingTiles(light, (3, 5), nsr=0.01, softness=0.0)
    pixel = np.zeros((*TILES, 3, 5), np.float32)
    pixel[:, :, 1, 2] = 1.0
    parts = tiles.parts(tiles.solver(tiles.otfs(pixel)).solve(0.0, None))
    height, width = parts.shape[1:]
    parts = parts.reshape(*TILES, height, width)
    for row, y in enumerate(tiles.centres[0]):
        for column, x in enumerate(tiles.centres[1]):
            top, left = round(y - (height - 1) / 2), round(x - (width - 1) / 2)
            expected = light[top : top + height, left : left + width]
            # Rounding of the transforms.
            np.testing.assert_allclose(parts[row, column], expected, atol=1e-5)


def test_tiles_are_freed_of_the_softness():
    light = gaussian_filter(np.random.default_rng(0).random((90, 140), dtype=np.float32), 1.5, mode="wrap")
    soft = gaussian_filter(light, 0.7, mode="wrap")
    pixel = np.ones((*TILES, 1, 1), np.float32)
    sharp, expected = (
        _RepeatingTiles(picture, (3, 5), nsr=1e-4, softness=softness)
        for picture, softness in ((soft, 0.7), (light, 0.0))
    )
    parts, originals = (tiles.parts(tiles.solver(tiles.otfs(pixel)).solve(0.0, None)) for tiles in (sharp, expected))
    # Beside the parts, the ends of the tiles fade into each other; one that is softened there is not what it would be.
    inside = np.s_[:, 3:-3, 3:-3]
    assert np.abs(parts - originals)[inside].mean() < 0.1 * np.abs(sharp.observed_parts - originals)[inside].mean()


def test_every_tile_counts_by_its_contrast_alone():
    tiles = np.random.default_rng(0).random((3, 20, 30), dtype=np.float32)
    shares = contrast_shares(tiles)
    np.testing.assert_allclose(shares.sum(), 1.0)
    brighter = tiles * np.array([1.0, 10.0, 0.1], np.float32)[:, None, None]
    np.testing.assert_allclose(concentrations(brighter), concentrations(tiles), rtol=1e-5)


def test_a_flat_picture_stays():
    """Under any kernel, even one that wraps around a tile."""
    light = np.full((64, 64), 0.5, np.float32)
    tiles = _RepeatingTiles(light, (3, 3), nsr=0.0, softness=0.0)
    solver = tiles.solver(tiles.otfs(np.full((*TILES, 71, 83), 1 / (71 * 83), np.float32)))
    np.testing.assert_allclose(tiles.parts(solver.solve(1.0, None)), 0.5, rtol=1e-4)


def test_the_right_motion_is_the_sharpest():
    log, camera, exposure = hand_shake(1.2, seed=5), Camera(192, 144, 280.0, readout_time=0.02), Exposure(0.5, 1 / 20)
    true = Recording(log, camera, exposure)
    picture = simulate(scene(172, 224), log, camera, exposure, noise=0.005).blurred.mean(axis=2)
    sharpness = QuickSharpness(picture, true)
    for measure in (WholeSharpness(picture, true), sharpness):
        least = measure.of(true)
        for wrong in (Correction(drift_x=3.0), Correction(drift_y=-3.0), Correction(scale=0.3), Correction(scale=-0.3)):
            assert measure.of(true.corrected(wrong)) > least + 0.01
    straight = np.linspace(-0.5, 0.5, 33)[:, None] * (9.0, 0.0)
    by_line, by_larger, by_same = sharpness.under_others(true, (straight, 1.4, 1.0), threads=2)
    assert by_line > least + 0.01
    # `scale` is a logarithm.
    larger = sharpness.of(true.corrected(Correction(scale=float(np.log(1.4)))))
    # Rotations are not quite linear in the focal length; measured: 0.003 apart.
    np.testing.assert_allclose(by_larger, larger, atol=5e-3)
    assert by_same == least
    # A log that ends before the exposure describes no motion.
    assert sharpness.of(true.corrected(Correction(offset=5.0))) == np.inf
