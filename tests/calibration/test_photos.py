"""Calibration from photos: a known camera, logs that must be refused, and what photos share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, CoverageError, Exposure, GyroLog, InputError, calibrate_photos, hand_shake, scene, simulate
from rsdeblur.calibration.photos import _decided, _without
from rsdeblur.motion.axes import imu_to_camera

WIDTH, HEIGHT, FOCAL = 240, 192, 300.0
OFFSET = 5e-3
TRUTH = Camera(
    WIDTH, HEIGHT, FOCAL, readout_time=0.02, readout_direction="bottom-up", imu_to_camera="yzX", time_offset=OFFSET
)
START = Camera(WIDTH, HEIGHT, 1.1 * FOCAL, readout_time=0.02)
EXPOSURES = [Exposure(start, 0.06) for start in (1.0, 2.2, 3.1, 4.3)]
LOG = hand_shake(5.5, strength=0.8, seed=8)
RECORDED = LOG.shifted(-OFFSET)


@pytest.fixture(scope="module")
def photos():
    """Four different pictures, as no scene is seen twice."""
    whole = scene(2 * HEIGHT + 64, 2 * WIDTH + 64)
    corners = ((0, 0), (0, WIDTH), (HEIGHT, 0), (HEIGHT, WIDTH))
    scenes = [whole[top : top + HEIGHT + 32, left : left + WIDTH + 32] for top, left in corners]
    camera = replace(TRUTH, time_offset=0.0)
    pairs = zip(scenes, EXPOSURES, strict=True)
    return [simulate(each, LOG, camera, exposure, noise=0.005).blurred.mean(axis=2) for each, exposure in pairs]


@pytest.fixture(scope="module")
def calibration(photos):
    return calibrate_photos(photos, EXPOSURES, RECORDED, START, search=(0.0, 0.0))


def test_the_mounting_is_found(calibration):
    assert calibration.accepted, calibration.reason
    assert calibration.mounting == "yzX"
    assert np.array_equal(calibration.camera.imu_to_camera, TRUTH.imu_to_camera)
    assert calibration.photos == len(EXPOSURES)
    assert calibration.confidence >= 0.95


def test_what_is_determined_is_within_three_deviations(calibration):
    camera = calibration.camera
    truth = {"time_offset": OFFSET, "focal_length": FOCAL, "readout_time": TRUTH.readout_time}
    for name, each in calibration.values.items():
        assert each.sd is None or abs(each.value - truth[name]) < 3 * each.sd, name
    assert calibration.values["focal_length"].determined
    assert camera.focal_length[0] == calibration.values["focal_length"].value
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)


@pytest.mark.parametrize("marks", ["start", "middle", "end"])
def test_the_middle_row_keeps_its_time(marks):
    """An assumed readout time moves the offset so that the middle row is exposed when the photos say."""
    camera = replace(TRUTH, timestamp_marks=marks)
    assumed = _without(camera, "readout", replace(START, readout_time=0.008))
    assert assumed.readout_time == 0.008
    middle, again = (sum(EXPOSURES[0].span(each)) / 2 - each.time_offset for each in (camera, assumed))
    # `span` ends with the last row, which opens a row's time before the readout ends: half of 12 ms / 192.
    assert again == pytest.approx(middle, abs=4e-5)


@pytest.mark.parametrize(("name", "field"), [("scale", "focal_length"), ("offset", "time_offset")])
def test_what_is_assumed_has_its_start_value(name, field):
    assert getattr(_without(TRUTH, name, START), field) == getattr(START, field)


def test_a_left_handed_log_is_refused(photos):
    """The spectra of reversed paths are the same; the sharp pictures are not."""
    mirrored = GyroLog(RECORDED.t, -RECORDED.omega)
    found = calibrate_photos(photos, EXPOSURES, mirrored, START, search=(0.0, 0.0))
    assert not found.accepted
    assert "left-handed" in found.reason
    assert found.camera is START
    assert found.values == {}


@pytest.mark.parametrize(
    ("lead", "confident", "words"),
    [
        ((0, 0, 0), False, "do not decide between the axes XYZ and yXZ; give more"),
        ((900, -300, 0), False, "do not decide between the axes XYZ and yXZ; give more"),
        ((40, 50, 60), True, ""),
    ],
)
def test_photos_decide_together(lead, confident, words):
    """One photo that leads by much does not decide alone."""
    matrices = [imu_to_camera(name) for name in ("XYZ", "yXZ", "zxy")]
    leads = np.array([lead, (-1, 0, 0), (-200, -200, -200)], dtype=float)
    best, confidence, reason = _decided(matrices, leads)
    assert (best, confidence >= 0.95) == (0, confident)
    assert words in reason
    assert bool(reason) != confident


def test_a_left_handed_rival_is_named():
    mirror = -imu_to_camera("XYZ")
    reason = _decided([imu_to_camera("XYZ"), mirror], np.zeros((2, 3)))[2]
    assert "xyz, left-handed" in reason
    reason = _decided([imu_to_camera("XYZ"), mirror], np.array([[0.0] * 3, [50.0] * 3]))[2]
    assert "left-handed axes: read it with --orientation xyz" in reason


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"exposures": EXPOSURES[:2]}, "at least 3 photos, got 2"),
        ({"exposures": [*EXPOSURES, EXPOSURES[0]]}, "got 4 images and 5 exposures"),
        ({"log": None}, "log must be a GyroLog"),
        ({"log": [LOG, LOG]}, "got 2 logs and 4 exposures"),
        ({"search": (0.01, -0.01)}, "search must span"),
        ({"search": (-1.0, 1.0)}, "search must span"),
        ({"camera": replace(START, width=WIDTH + 1)}, "the camera"),
    ],
)
def test_wrong_arguments_are_refused(photos, changes, match):
    arguments = {"images": photos, "exposures": EXPOSURES, "log": RECORDED, "camera": START} | changes
    with pytest.raises(InputError, match=match):
        calibrate_photos(**arguments)


def test_a_search_beside_the_log_is_refused(photos):
    """The start's offset is right, those of the search are not."""
    with pytest.raises(CoverageError, match="under no offset of the search"):
        calibrate_photos(photos, EXPOSURES, RECORDED, START, search=(2.0, 2.0))
