"""Correction of what frames share: simulated errors, right recordings, and frames that disagree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, InputError, Uncertainty, refine_frames, scene, simulate
from rsdeblur.estimate.refine_frames import _Frames
from rsdeblur.estimate.rival_axes import OTHER_AXES
from rsdeblur.simulation.shake import hand_shake

CAMERA = Camera(288, 216, 420.0, readout_time=0.02)
EXPOSURES = [Exposure(start, 1 / 20) for start in (0.3, 0.6, 0.9)]
LOG = hand_shake(1.4, seed=5)
# Only the clock may be wrong: the search is short.
CLOCK = Uncertainty(scale=0.0, readout=0.0, roll=0.0)


@pytest.fixture(scope="module")
def pictures():
    return [
        simulate(scene(248, 320, seed=n), LOG, CAMERA, each, noise=0.005).blurred for n, each in enumerate(EXPOSURES)
    ]


def test_a_wrong_clock_is_found(pictures):
    found = refine_frames(pictures, LOG, replace(CAMERA, time_offset=9e-3), EXPOSURES, uncertainty=CLOCK)
    assert found.accepted, found.reason
    # Paths differ by 2.4 to 4.5 px before, and by up to 0.5 px with 1 ms left. Measured: 0.2 ms.
    assert found.camera.time_offset == pytest.approx(0.0, abs=1e-3)
    assert found.values.offset == pytest.approx(found.camera.time_offset - 9e-3)
    assert found.values.scale == found.sd.scale == found.values.drift_x == 0.0
    assert 0.0 < found.sd.offset < CLOCK.offset
    assert found.log is LOG


def test_a_right_recording_stays(pictures):
    found = refine_frames(iter(pictures), LOG, CAMERA, EXPOSURES, uncertainty=CLOCK)
    assert not found.accepted
    assert found.reason
    assert found.camera is CAMERA
    assert found.log is LOG


def test_the_clock_of_one_frame_is_not_that_of_all(pictures):
    """The first frame was exposed 9 ms after it says so: the others contradict its correction."""
    exposures = [Exposure(EXPOSURES[0].start - 9e-3, 1 / 20), *EXPOSURES[1:]]
    assert not refine_frames(pictures, LOG, CAMERA, exposures, uncertainty=CLOCK).accepted


def test_wrong_axes_are_named(pictures, monkeypatch):
    # The correction of a motion about wrong axes, as it would be accepted but for the right axes.
    monkeypatch.setattr(_Frames, "_worth", lambda self, place: 1000.0)
    monkeypatch.setattr(_Frames, "falls", lambda self, place: np.array([0.1, 0.1, 0.11]))
    found = refine_frames(pictures, LOG, replace(CAMERA, imu_to_camera="YxZ"), EXPOSURES, uncertainty=CLOCK)
    assert found.reason == OTHER_AXES


@pytest.mark.parametrize("count", [1, 2])
def test_each_of_several_frames_needs_an_exposure(pictures, count):
    with pytest.raises(InputError, match=rf"two images or more, and as many exposures, got {count} and"):
        refine_frames(pictures[:count], LOG, CAMERA, EXPOSURES[: 1 if count == 1 else 3])
