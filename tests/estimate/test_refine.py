"""Correction of the recording by the picture: simulated errors, right recordings, drift by region, light streaks."""

from dataclasses import asdict, astuple, replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsdeblur import Camera, Correction, Exposure, Uncertainty, deblur, hand_shake, refine, scene, simulate
from rsdeblur.estimate import Refinement
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.regions import DriftByRegion, with_factors
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.search import OTHER_AXES, Search, agree
from rsdeblur.estimate.sharpness import TILES
from rsdeblur.estimate.streaks import MOST_NATS, LightStreaks
from rsdeblur.io.camera_file import CameraFile
from rsdeblur.motion import BlurPaths

CAMERA = Camera(288, 216, 420.0, readout_time=0.02)
EXPOSURE = Exposure(0.5, 1 / 20)
LOG = hand_shake(1.2, seed=5)


@pytest.fixture(scope="module")
def picture():
    return simulate(scene(248, 320), LOG, CAMERA, EXPOSURE, noise=0.005).blurred


def paths(recording):
    """Return the paths in nine places, each about its mean."""
    capture = recording.capture()
    rows, cols = (np.linspace(0, n - 1, 3) for n in (capture.camera.height, capture.camera.width))
    displacements = BlurPaths.from_capture(capture, rows, cols, samples=33).displacements
    return displacements - displacements.mean(axis=2, keepdims=True)


def distance(recording, other):
    """Return the root mean square distance of the paths, px."""
    return float(np.sqrt(np.square(paths(recording) - paths(other)).sum(axis=-1).mean()))


def test_a_drift_is_an_even_path():
    """Over the exposure, the scene moves by the drift, whatever the camera's other motion."""
    still = Recording(hand_shake(1.2, strength=0.0), CAMERA, EXPOSURE)
    path = paths(still.corrected(Correction(drift_x=6.0, drift_y=-3.0)))
    # To first order in the angle of view, of which the drift is 1/70.
    np.testing.assert_allclose(path[1, 1, -1] - path[1, 1, 0], [6.0, -3.0], atol=0.05)


def test_an_unknown_acceleration_is_found():
    """It bends the drift by 3 px, so an even drift explains nothing. It is only searched with known axes."""
    log, exposure = hand_shake(1.2, seed=5, strength=0.5), Exposure(0.4, 0.3)
    given, unsure = Recording(log, CAMERA, exposure), Uncertainty(acceleration=0.5, drift=0.01)
    true = given.corrected(Correction(drift_x=5.0, acceleration_y=-270.0))
    photo = simulate(scene(248, 320), log, CAMERA, exposure, noise=0.005, translation=true.translation).blurred
    bent = refine(photo, log, CAMERA, exposure, uncertainty=unsure, free=("drift", "acceleration"), known_axes=True)
    assert bent.accepted, bent.reason
    refined = Recording(bent.log, bent.camera, bent.exposure, bent.translation)
    # As for the drift above.
    assert distance(refined, true) < 0.25 * distance(given, true)


def test_an_unknown_drift_is_found(picture):
    true = Recording(LOG, CAMERA, EXPOSURE)
    given = true.corrected(Correction(drift_x=3.0, drift_y=-2.0))
    found = refine(picture, given.log, given.camera, given.exposure, translation=given.translation, free="drift")
    assert found.accepted, found.reason
    refined = Recording(found.log, found.camera, found.exposure, found.translation)
    # A quarter of the error is a goal that the authors of the method would call refined.
    assert distance(refined, true) < 0.25 * distance(given, true)
    assert found.values.offset == found.sd.offset == 0.0


def test_a_right_recording_stays(picture):
    found, again = (refine(picture, LOG, CAMERA, EXPOSURE, free="drift", threads=threads) for threads in (2, 1))
    assert (again.gain, again.fall) == (found.gain, found.fall), "threads change bits"
    assert not found.accepted
    assert found.reason
    assert found.camera is CAMERA
    assert found.log is LOG
    assert found.translation is None


def test_a_wrong_clock_is_corrected_by_the_offset_alone(picture):
    """Although other numbers would explain a part of it as well, each of them costs."""
    true = Recording(LOG, CAMERA, EXPOSURE)
    given = true.corrected(Correction(offset=0.01))
    found = refine(picture, given.log, given.camera, given.exposure)
    assert found.accepted, found.reason
    assert [name for name, value in asdict(found.values).items() if value] == ["offset"]
    # As for the drift above.
    assert distance(Recording(found.log, found.camera, found.exposure), true) < 0.25 * distance(given, true)


@pytest.mark.parametrize("is_guess", [True, False])
def test_a_guess_of_the_readout_needs_no_clearer_picture(picture, monkeypatch, is_guess):
    """Its half: the spectra suffice for a guess, but not against a time that is known."""
    monkeypatch.setattr(Score, "whole_falls", lambda self, places: np.zeros((len(places), len(self.photos))))
    true = Recording(LOG, CAMERA, EXPOSURE)
    given = replace(true, camera=replace(CAMERA, readout_time=0.01, readout_sd=0.01 * is_guess))
    found = refine(
        picture, given.log, given.camera, given.exposure, uncertainty=Uncertainty(readout=1.0), free="readout"
    )
    assert found.accepted is is_guess, found.reason
    if is_guess:  # as for the drift above
        assert distance(Recording(found.log, found.camera, found.exposure), true) < 0.25 * distance(given, true)


def test_cameras_state_how_sure_they_are():
    camera = replace(CAMERA, readout_sd=0.005, time_offset_sd=0.001)
    for uncertainty, offset in ((Uncertainty(), 0.001), (Uncertainty(offset=0.0), 0.0)):
        numbers = Correction(*uncertainty.deviations(camera, EXPOSURE))
        assert (numbers.offset, numbers.readout) == (offset, 0.25)
    assert CameraFile(camera, "toml").with_overrides(time_offset=0.1).camera.time_offset_sd == 0.0


def test_exposures_of_microseconds_are_not_searched(picture):
    """Their trial drifts would need PSFs of gigabytes."""
    found = refine(picture, LOG, CAMERA, Exposure(0.5, 3e-6))
    assert not found.accepted
    assert "so short" in found.reason


EXPOSURES = [Exposure(start, 1 / 20) for start in (0.3, 0.6, 0.9)]


@pytest.fixture(scope="module")
def several():
    return [
        simulate(scene(248, 320, seed=n), LOG, CAMERA, each, noise=0.005).blurred for n, each in enumerate(EXPOSURES)
    ]


def test_several_photos_share_the_clock(several):
    late = replace(CAMERA, time_offset=9e-3)
    found = refine(several[:2], LOG, late, EXPOSURES[:2], free="offset")
    assert all(each.accepted for each in found), found[0].reason
    assert len({each.camera.time_offset for each in found}) == 1
    # Paths differ by 2.4 to 4.5 px before, and by up to 0.5 px with 1 ms left.
    assert found[0].camera.time_offset == pytest.approx(0.0, abs=1e-3)
    assert 0.0 < found[0].sd.offset < 8e-3
    assert [each.exposure for each in found] == EXPOSURES[:2]


def test_the_clock_of_one_photo_is_not_that_of_all(several):
    """The first one was exposed 9 ms after it says so: the others contradict its correction."""
    exposures = [Exposure(EXPOSURES[0].start - 9e-3, 1 / 20), *EXPOSURES[1:]]
    assert not refine(several, LOG, CAMERA, exposures, free="offset")[0].accepted


@pytest.mark.parametrize(
    ("falls", "agreed"),
    [
        ([0.02, 0.03, 0.025], True),
        # A photo that becomes far clearer contradicts the others no more than one that becomes as clear.
        ([0.02, 0.07, 0.15, 0.001, 0.02], True),
        ([0.0, -0.001, 0.15], False),
        ([0.05, -0.04, 0.03, -0.05, 0.01], False),
        ([-0.05], True),
    ],
)
def test_photos_agree_where_most_become_clearer(falls, agreed):
    assert agree(np.array(falls)) is agreed


def test_few_pixels_prove_nothing():
    camera = Camera(96, 60, 420.0, readout_time=0.02)
    found = refine(np.random.default_rng(0).random((60, 96)), LOG, camera, EXPOSURE)
    assert not found.accepted
    assert "smaller than 64 px" in found.reason
    assert found.sd == Correction(*Uncertainty().deviations(camera, EXPOSURE).tolist())


def test_wrong_axes_are_named(picture):
    """A correction of a motion about the wrong axes makes the picture clearer, but the right axes do so more.

    They do so at another clock offset, too: of 14 ms, 2.8 standard deviations, as a phone's may be wrong by.
    """
    wrong = replace(CAMERA, imu_to_camera="YxZ", time_offset=CAMERA.time_offset + 0.014)
    assert not np.array_equal(wrong.imu_to_camera, CAMERA.imu_to_camera)
    found = refine(picture, LOG, wrong, EXPOSURE)
    assert not found.accepted
    assert found.camera is wrong
    assert found.reason == OTHER_AXES


def test_deblur_uses_the_corrected_recording(picture, monkeypatch):
    camera = replace(CAMERA, time_offset=2e-3)
    found = Refinement(LOG, camera, EXPOSURE, None, True, "", Correction(offset=2e-3), Correction(), 0.9, 9.0, 0.05)
    monkeypatch.setattr("rsdeblur.pipeline.plan.refine", lambda *_, **__: found)
    result = deblur(picture, LOG, CAMERA, EXPOSURE, prior="wiener", refine=True)
    assert result.refinement is found
    np.testing.assert_array_equal(result.image, deblur(picture, LOG, camera, EXPOSURE, prior="wiener").image)


def test_nothing_uncertain_is_left_as_it_is(picture):
    """A global shutter has no readout time to correct."""
    fixed = Uncertainty(scale=0.0, drift=0.0, offset=0.0, roll=0.0)
    found = refine(picture, LOG, replace(CAMERA, readout_time=0.0), EXPOSURE, uncertainty=fixed)
    assert not found.accepted
    assert found.sd == Correction()


LARGE, SHUTTER = Camera(512, 384, 600.0, readout_time=0.02), Exposure(0.5, 1 / 20)
CALM = hand_shake(1.2, seed=5, strength=0.4)
DRIFT = Correction(drift_x=5.0, drift_y=-2.0)
CENTRES = tuple((np.arange(count) + 0.5) / count for count in TILES)


def span(recording, row, col):
    """Return the way of a point of the upright picture from the first to the last moment, px."""
    path = BlurPaths.from_capture(recording.capture(), [row], [col]).displacements[0, 0]
    return path[-1] - path[0]


@pytest.mark.parametrize("direction", ["top-down", "left-right"])
def test_factors_hold_in_the_upright_picture(direction):
    camera = replace(LARGE, readout_direction=direction)
    recording = Recording(hand_shake(1.2, strength=0.0), camera, SHUTTER)
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
    true, sharp, nearer = Recording(CALM, LARGE, SHUTTER), scene(424, 552), request.param
    halves = [
        simulate(sharp, CALM, LARGE, SHUTTER, noise=0.004, translation=true.corrected(drift).translation).blurred
        for drift in (DRIFT, replace(DRIFT, drift_x=nearer * DRIFT.drift_x, drift_y=nearer * DRIFT.drift_y))
    ]
    light = np.concatenate([halves[0][:, :256], halves[1][:, 256:]], axis=1).mean(axis=2)
    deviations = Uncertainty().deviations(LARGE, SHUTTER)
    score = Score.of_photos([light], [true], deviations, 1)
    return nearer, score, DriftByRegion(score)


def place(**values):
    """Return a correction of one photo in standard deviations."""
    deviations = Uncertainty().deviations(LARGE, SHUTTER)
    row = np.divide(astuple(Correction(**values)), deviations, out=np.zeros(len(deviations)), where=deviations > 0)
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
