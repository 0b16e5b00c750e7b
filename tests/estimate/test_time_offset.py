"""The clock offset from one picture: known offsets of simulated captures, and motions that do not determine it."""

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, find_time_offset, from_linear, hand_shake, scene, simulate
from rsdeblur.estimate.search import OTHER_AXES

CAMERA = Camera(224, 160, 350.0, readout_time=0.03)
EXPOSURE = Exposure(0.5, 1 / 25)
LOG, GENTLE = (hand_shake(1.0, seed=2, strength=strength) for strength in (1.0, 0.7))
SEARCH = (-0.02, 0.02)


def photo(log, exposure=EXPOSURE):
    return simulate(scene(176, 240), log, CAMERA, exposure, noise=0.005).blurred


def test_the_right_offset_is_found():
    """Of a turned photo of 16 bits; the log is late, which the camera file knows."""
    stored = np.rint(65535 * from_linear(photo(LOG).clip(0, 1), "srgb")).astype(np.uint16)
    camera = replace(CAMERA.turned(), time_offset=0.01)
    found = find_time_offset(np.rot90(stored, -1), LOG.shifted(-0.01), camera, EXPOSURE, search=SEARCH)
    # Requirement: 2 ms.
    assert found.time_offset == pytest.approx(0.01, abs=2e-3), found.reason
    assert found.scores.min() == 0
    # Candidates are 4 ms apart and count from the camera's offset.
    assert found.offsets[0] == pytest.approx(0.01 + SEARCH[0], abs=4e-3)


def test_several_photos_share_an_offset_and_a_readout_time_that_is_a_guess():
    exposures = [EXPOSURE, Exposure(0.3, 1 / 25)]
    pictures = [photo(GENTLE, each) for each in exposures]
    guess = replace(CAMERA, readout_time=0.02, readout_sd=0.01)
    found = find_time_offset(pictures, GENTLE, guess, exposures, search=(-0.01, 0.01))
    # As for one picture: the requirement is 2 ms.
    assert found.camera.time_offset == pytest.approx(0.0, abs=2e-3)
    # The guess is 10 ms off, with which the offset alone is; measured 24 ms.
    assert abs(found.camera.readout_time - CAMERA.readout_time) < 8e-3
    assert abs(found.camera.time_offset) < abs(found.best)


def test_constant_rates_give_no_answer():
    log = GyroLog(np.arange(0, 1.0, 0.005), np.tile([0.3, 0.9, 0.1], (200, 1)))
    search = find_time_offset(photo(log), log, CAMERA, EXPOSURE, search=SEARCH)
    assert search.time_offset is None
    assert search.reason


def test_axes_turned_by_half_a_turn_give_no_answer():
    """The spectra are those of the right axes; the sharp picture is not, and the right axes explain it better."""
    camera = replace(CAMERA, imu_to_camera=np.diag([-1, -1, 1]))
    found = find_time_offset(photo(GENTLE), GENTLE, camera, EXPOSURE, search=SEARCH)
    assert found.time_offset is None
    assert found.reason == OTHER_AXES


def test_a_motion_that_the_log_lacks_is_not_found_at_another_moment():
    """The photo has a straight blur, and some moment of the log has a motion that resembles it."""
    steady = GyroLog(np.arange(0, 1.0, 0.005), np.tile([0.3, 0.5, 0.05], (200, 1)))
    camera, exposure = Camera(320, 240, 350.0, readout_time=0.03), Exposure(0.5, 1 / 15)
    picture = simulate(scene(260, 340), steady, camera, exposure, noise=0.005).blurred
    log = hand_shake(1.2, seed=1, strength=1.5)
    found = find_time_offset(picture, log, camera, exposure, search=(-0.3, 0.3))
    assert found.time_offset is None
