"""Light streaks: which trails are found, and which motions they agree with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Correction, Exposure, Uncertainty, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.search import Search
from rsdeblur.estimate.streaks import (
    MOST_NATS,
    LightStreaks,
)
from rsdeblur.simulation.shake import hand_shake

EXPOSURE = Exposure(0.5, 1 / 15)
CAMERA = Camera(320, 240, 420.0)
TRUE = Recording(hand_shake(1.2, seed=5), CAMERA, EXPOSURE)
WRONG = TRUE.corrected(Correction(drift_x=6.0, drift_y=5.0))
PLACES = (60, 60), (60, 160), (60, 260), (180, 80), (180, 180), (180, 270)


def pictured(sharp, noise=0.003):
    """Return the grey picture of a scene of the camera's size, under the true motion."""
    scene = np.pad(sharp, 40, mode="edge").astype(np.float32)
    return np.asarray(simulate(scene, TRUE.log, CAMERA, TRUE.exposure, noise=noise).blurred, np.float32)


def points(size=0.8):
    """Return a grey scene with points of light."""
    light = np.zeros((CAMERA.height, CAMERA.width))
    for row, col in PLACES:
        light[row, col] = 40.0
    return 0.2 + gaussian_filter(light, size)


@pytest.fixture(scope="module")
def glints():
    return pictured(points())


def test_the_true_motion_explains_them(glints):
    streaks = LightStreaks(glints, WRONG)
    true, wrong, none = (streaks.nats(each) for each in (TRUE, WRONG, WRONG.corrected(Correction(scale=-3.0))))
    assert true > wrong + 10
    assert true > none + 10
    assert true <= len(streaks.streaks) * MOST_NATS


@pytest.mark.parametrize("sharp", ["flat", "line", "edge"])
def test_lines_edges_and_flat_areas_have_none(sharp):
    scene = np.full((CAMERA.height, CAMERA.width), 0.2)
    if sharp == "line":
        scene[118:121] = 1.0
    if sharp == "edge":
        scene[:, 160:] = 0.8
    streaks = LightStreaks(pictured(scene), TRUE)
    assert streaks.streaks == []
    assert streaks.nats(WRONG) == 0.0


def test_the_search_follows_them(glints):
    """Spectra and sharp picture of six points on grey prove little; their trails do."""
    deviations = Uncertainty(drift=0.01, scale=0.0).deviations(CAMERA, EXPOSURE)
    score = Score.of_photos([glints], [WRONG], deviations, 1)
    drifts = [place[0, 1:3] * deviations[1:3] for place in Search(score)._followed(lambda *_: None)]
    assert len(drifts) == 2
    np.testing.assert_allclose(drifts[0], (-6.0, -5.0), atol=1.0)  # px, of a trail of 20 px
