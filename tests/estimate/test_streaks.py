"""Light streaks: which trails are found, and which motions they agree with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Correction, Exposure, Uncertainty, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.search import Search
from rsdeblur.estimate.streaks import (
    LEAST_EXTENT,
    MOST_NATS,
    MOST_TOGETHER,
    LightStreaks,
    find_streaks,
    lead_of,
    thin_things,
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


def test_every_point_has_a_trail(glints):
    streaks = LightStreaks(glints, TRUE)
    assert len(streaks.streaks) == len(PLACES)
    assert streaks.correlations(TRUE).min() > 0.9


def test_the_true_motion_explains_them(glints):
    streaks = LightStreaks(glints, WRONG)
    true, wrong, none = (streaks.nats(each) for each in (TRUE, WRONG, WRONG.corrected(Correction(scale=-3.0))))
    assert true > wrong + 10
    assert true > none + 10
    assert true <= len(streaks.streaks) * MOST_NATS


def test_a_trail_has_a_phase(glints):
    """Half a turn of the motion has the same spectra, but not the same trail."""
    camera = replace(CAMERA, imu_to_camera=np.diag([-1.0, -1.0, 1.0]) @ CAMERA.imu_to_camera)
    streaks = LightStreaks(glints, TRUE)
    assert streaks.nats(TRUE) > streaks.nats(replace(TRUE, camera=camera)) + 10


def test_brightness_does_not_matter(glints):
    one, other = (LightStreaks(factor * glints, TRUE).correlations(WRONG) for factor in (1.0, 0.25))
    np.testing.assert_allclose(one, other, atol=1e-5)  # rounding of float32


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


def test_a_motion_without_a_shape_has_none(glints):
    still = TRUE.corrected(Correction(scale=float(np.log(0.1 * LEAST_EXTENT / 20))))
    assert LightStreaks(glints, still).streaks == []


def test_a_log_that_ends_says_nothing(glints):
    streaks = LightStreaks(glints, TRUE)
    assert streaks.nats(replace(TRUE, exposure=Exposure(50.0, 1 / 15))) == 0.0


def test_thick_things_are_left_out():
    light = np.zeros((60, 60), np.float32)
    light[10:30, 10:30] = 1.0
    light[45:48, 10:50] = 1.0
    thin = thin_things(light)
    assert thin[12:28, 12:28].max() < 0.01
    assert thin[46, 15:45].min() > 0.9


def test_other_things_beside_a_trail_are_hidden():
    light = np.full((120, 120), 0.1, np.float32)
    light[50:52, 40:60], light[60:62, 45:65] = 1.0, 0.9
    streaks = find_streaks(gaussian_filter(light, 0.7), 20.0)
    assert len(streaks) == 2
    for each in streaks:
        assert (each.values[each.seen == 0] == 0).all()
        middle = each.seen.shape[0] // 2
        assert each.seen[middle - 3 : middle + 4, middle - 8 : middle + 9].all()
        assert not each.seen[[middle - 10, middle + 10]].all()


def test_leads_are_bounded():
    assert lead_of(1000.0, 0.0) == pytest.approx(MOST_TOGETHER)
    assert lead_of(3.0, 5.0) == -lead_of(5.0, 3.0)


def test_the_search_follows_them(glints):
    """Spectra and sharp picture of six points on grey prove little; their trails do."""
    deviations = Uncertainty(drift=0.01, scale=0.0).deviations(CAMERA, EXPOSURE)
    score = Score.of_photos([glints], [WRONG], deviations, 1)
    drifts = [place[0, 1:3] * deviations[1:3] for place in Search(score, 1)._followed(lambda *_: None)]
    assert len(drifts) == 2
    np.testing.assert_allclose(drifts[0], (-6.0, -5.0), atol=1.0)  # px, of a trail of 20 px
