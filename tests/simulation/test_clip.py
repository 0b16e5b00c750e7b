"""Simulated clips: one frame is a simulated photo, and a still camera films the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, InputError, Translation, hand_shake, scene, simulate, simulate_clip
from rsdeblur.simulation import Layer

CAMERA = Camera(96, 72, 110.0, readout_time=0.02, readout_direction="right-left")


@pytest.fixture(scope="module")
def sharp():
    return scene(112, 144)


@pytest.mark.parametrize("distortion", [{}, {"distortion_model": "radtan", "distortion": [0.1, 0.0, 0.01, 0.0]}])
def test_a_clip_of_one_frame_is_a_photo(sharp, distortion):
    """Both are the scene at the mid-exposure of the middle row."""
    log, exposure, camera = hand_shake(0.5, seed=3), Exposure(0.2, 0.03), replace(CAMERA, **distortion)
    (frame,) = simulate_clip(sharp, log, camera, [exposure], samples=12)
    photo = simulate(sharp, log, camera, exposure, samples=12).blurred
    # Both integrate alike; the middle of the readout, summed in another order, differs by float64's rounding.
    np.testing.assert_allclose(frame, photo, atol=1e-6)


def test_a_still_camera_films_the_scene(sharp):
    still = GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)))
    frames = list(simulate_clip(sharp, still, CAMERA, [Exposure(0.1, 0.02), Exposure(0.5, 0.02)]))
    assert len(frames) == 2
    for frame in frames:
        # float32 and the cubic interpolation at whole pixels
        assert np.abs(frame - sharp[20:92, 24:120]).max() < 1e-4


def test_refused(sharp):
    log = hand_shake(0.5)
    with pytest.raises(InputError, match="at least one exposure"):
        simulate_clip(sharp, log, CAMERA, [])
    # Arguments are checked before the first frame is requested.
    with pytest.raises(InputError, match="noise must be at most"):
        simulate_clip(sharp, log, CAMERA, [Exposure(0.2, 0.01)], noise=1e30)
    with pytest.raises(InputError, match="samples must be"):
        simulate_clip(sharp, log, CAMERA, [Exposure(0.2, 0.01)], samples=10**9)


STILL = GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)))
SLIDE = Translation([0.0, 0.9], [[0, 0, 0], [0.009, -0.018, 0]], depth=2.0)
EXPOSURES = [Exposure(0.1, 0.02), Exposure(0.5, 0.02)]


@pytest.fixture(scope="module")
def disc():
    """A mask of a disc in the middle of the scene."""
    return (np.hypot(*np.mgrid[-56:56, -72:72]) < 12).astype(float)


def places(frames):
    """Return the centres of gravity (x, y) of white frames."""
    return [np.array([np.average(axis, weights=frame) for axis in np.mgrid[:72, :96][::-1]]) for frame in frames]


class TestLayer:
    """Opaque layers replace the scene, transparent ones show it, and their pixels move as they should."""

    @pytest.mark.parametrize("opacity", [0.0, 0.3, 1.0])
    def test_even_layers_mix_two_clips(self, sharp, opacity):
        log, camera, other = hand_shake(0.7, seed=3), CAMERA, sharp[::-1].copy()
        layer = Layer(other, np.full(sharp.shape[:2], opacity))
        mixed, plain, covered = (
            list(simulate_clip(picture, log, camera, EXPOSURES, layers=layers))
            for picture, layers in ((sharp, [layer]), (sharp, []), (other, []))
        )
        for m, p, c in zip(mixed, plain, covered, strict=True):
            np.testing.assert_allclose(m, opacity * c + (1 - opacity) * p, atol=1e-5)

    @pytest.mark.parametrize("direction", ["top-down", "right-left"])
    def test_a_thing_moves_by_its_velocity(self, disc, direction):
        camera = Camera(96, 72, 110.0, readout_direction=direction)
        layer = Layer(np.ones_like(disc), disc, velocity=(20.0, -30.0))
        first, last = places(simulate_clip(np.zeros_like(disc), STILL, camera, EXPOSURES, layers=[layer]))
        np.testing.assert_allclose(last - first, 0.4 * np.array([20.0, -30.0]), atol=0.02)

    @pytest.mark.parametrize("direction", ["top-down", "right-left"])
    def test_near_things_move_by_more(self, disc, direction):
        """By f times the camera's way over their distance."""
        camera = Camera(96, 72, 110.0, readout_direction=direction)
        for depth, expected in ((None, 2.0), (2.0, 2.0), (0.5, 0.5)):
            layer = Layer(np.ones_like(disc), disc, depth=depth)
            first, last = places(
                simulate_clip(np.zeros_like(disc), STILL, camera, EXPOSURES, translation=SLIDE, layers=[layer])
            )
            way = 0.4 / 0.9 * np.array([0.009, -0.018])
            np.testing.assert_allclose(last - first, -110.0 * way / expected, atol=0.02)
