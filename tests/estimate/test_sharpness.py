"""Comparison of motions by the sharp picture: its tiles, and the right motion against others."""

from __future__ import annotations

import numpy as np

from rsdeblur import Camera, Correction, Exposure, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.sharpness import (
    TILES,
    QuickSharpness,
    WholeSharpness,
    _RepeatingTiles,
)
from rsdeblur.simulation.scene import scene
from rsdeblur.simulation.shake import hand_shake


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
