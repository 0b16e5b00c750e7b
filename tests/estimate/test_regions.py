"""Drift by region: the map of depths, labels that are alike, and a scene of two depths."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Correction, Exposure, Uncertainty, hand_shake, scene, simulate
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.regions import DriftByRegion, with_factors
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.search import Search
from rsdeblur.estimate.sharpness import TILES
from rsdeblur.estimate.streaks import MOST_NATS, LightStreaks
from rsdeblur.motion import BlurPaths

CAMERA, EXPOSURE = Camera(512, 384, 600.0, readout_time=0.02), Exposure(0.5, 1 / 20)
LOG = hand_shake(1.2, seed=5, strength=0.4)
DRIFT = Correction(drift_x=5.0, drift_y=-2.0)
CENTRES = tuple((np.arange(count) + 0.5) / count for count in TILES)


def span(recording, row, col):
    """Return the way of a point of the upright picture from the first to the last moment, px."""
    path = BlurPaths.from_capture(recording.capture(), [row], [col]).displacements[0, 0]
    return path[-1] - path[0]


@pytest.mark.parametrize("direction", ["top-down", "left-right"])
def test_factors_hold_in_the_upright_picture(direction):
    camera = replace(CAMERA, readout_direction=direction)
    recording = Recording(hand_shake(1.2, strength=0.0), camera, EXPOSURE)
    upright = recording.capture().camera
    factors = np.ones(TILES)
    factors[:, 2:], factors[4:] = 2.0, 0.5
    moved, whole = with_factors(recording, DRIFT, factors, CENTRES), recording.corrected(DRIFT)
    for region, factor in (((0, 0), 1.0), ((0, 3), 2.0), ((5, 0), 0.5)):
        place = [at[n] * side for at, n, side in zip(CENTRES, region, (upright.height, upright.width), strict=True)]
        # The map spans the picture from its first to its last pixel, which is half a pixel less on either side.
        np.testing.assert_allclose(span(moved, *place), factor * span(whole, *place), rtol=0.02)


@pytest.fixture(scope="module", params=[1.0, 3.0])
def found(request):
    """A picture whose right half drifts `nearer` times as far as the left: that number, its scores, and the search."""
    true, sharp, nearer = Recording(LOG, CAMERA, EXPOSURE), scene(424, 552), request.param
    halves = [
        simulate(sharp, LOG, CAMERA, EXPOSURE, noise=0.004, translation=true.corrected(drift).translation).blurred
        for drift in (DRIFT, replace(DRIFT, drift_x=nearer * DRIFT.drift_x, drift_y=nearer * DRIFT.drift_y))
    ]
    light = np.concatenate([halves[0][:, :256], halves[1][:, 256:]], axis=1).mean(axis=2)
    deviations = Uncertainty().deviations(CAMERA, EXPOSURE)
    score = Score.of_photos([light], [true], deviations, 1)
    return nearer, score, DriftByRegion(score)


def place(**values):
    """Return a correction of one photo in standard deviations."""
    deviations = Uncertainty().deviations(CAMERA, EXPOSURE)
    row = np.divide(Correction(**values).vector, deviations, out=np.zeros(len(deviations)), where=deviations > 0)
    return row[None]


DRIFTED = place(drift_x=DRIFT.drift_x, drift_y=DRIFT.drift_y)


def test_two_depths_are_found_and_one_is_left(found):
    nearer, score, by_region = found
    best = by_region.best([DRIFTED], over=DRIFTED)
    if nearer == 1.0:
        assert best is None
    else:
        # The columns beside the border belong to both.
        assert best.factors[:, 3].mean() > 2.0 * best.factors[:, 0].mean()
        assert best.score > score.of(DRIFTED)
    assert by_region.best([place(offset=0.01)], over=None) is None


LONG = Exposure(0.5, 1 / 15)
SMALL = Camera(320, 240, 420.0)
TRUE = Recording(hand_shake(1.2, seed=5), SMALL, LONG)
WRONG = TRUE.corrected(Correction(drift_x=6.0, drift_y=5.0))
PLACES = (60, 60), (60, 160), (60, 260), (180, 80), (180, 180), (180, 270)


def pictured(sharp, noise=0.003):
    """Return the grey picture of a scene of the camera's size, under the true motion."""
    scene = np.pad(sharp, 40, mode="edge").astype(np.float32)
    return np.asarray(simulate(scene, TRUE.log, SMALL, TRUE.exposure, noise=noise).blurred, np.float32)


def points(size=0.8):
    """Return a grey scene with points of light."""
    light = np.zeros((SMALL.height, SMALL.width))
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
    scene = np.full((SMALL.height, SMALL.width), 0.2)
    if sharp == "line":
        scene[118:121] = 1.0
    if sharp == "edge":
        scene[:, 160:] = 0.8
    streaks = LightStreaks(pictured(scene), TRUE)
    assert streaks.streaks == []
    assert streaks.nats(WRONG) == 0.0


def test_the_search_follows_them(glints):
    """Spectra and sharp picture of six points on grey prove little; their trails do."""
    deviations = Uncertainty(drift=0.01, scale=0.0).deviations(SMALL, LONG)
    score = Score.of_photos([glints], [WRONG], deviations, 1)
    drifts = [place[0, 1:3] * deviations[1:3] for place in Search(score)._followed(lambda *_: None)]
    assert len(drifts) == 2
    np.testing.assert_allclose(drifts[0], (-6.0, -5.0), atol=1.0)  # px, of a trail of 20 px
