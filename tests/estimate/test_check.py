"""The check of a result: right and wrong motion, what cannot be judged, the return of the input."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rsdeblur import Camera, Correction, Exposure, InputError, deblur, hand_shake, scene, simulate
from rsdeblur.estimate import Refinement
from rsdeblur.estimate.check import doubted_by
from rsdeblur.estimate.search import OTHER_AXES

RECORDING = hand_shake(0.3, seed=3), Camera(320, 256, 350.0, readout_time=0.02), Exposure(0.08, 1 / 25)


@pytest.fixture(scope="module")
def pictures():
    """A capture of 320x256 px with about 15 px of blur."""
    return simulate(scene(300, 380), *RECORDING, noise=0.003)


@pytest.fixture(scope="module")
def capture(pictures):
    return pictures.blurred, *RECORDING


@pytest.fixture(scope="module")
def restored(pictures):
    """Restore the capture, clipped, with total variation: with the right motion or a wrong one, once for all tests."""
    log, camera, exposure = RECORDING

    @cache
    def restore(*, right, fallback=False):
        moved = log if right else wrong(log)
        blurred = pictures.blurred.clip(0, 1)
        return deblur(blurred, moved, camera, exposure, prior="tv", fallback=fallback)

    return restore


def wrong(log):
    return replace(log, omega=log.omega * (3.0, -3.0, 1.0))


def test_the_right_motion_is_good_and_a_wrong_one_bad(restored):
    good, bad = (restored(right=right).check for right in (True, False))
    assert (good.verdict, good.reasons) == ("good", ())
    assert bad.verdict == "bad"
    assert "does not fit" in " ".join(bad.reasons)
    assert good.lead > bad.lead
    assert good.ringing < bad.ringing


@pytest.mark.parametrize("weight", [1.0, 1e20])
def test_fog_is_not_good(capture, weight):
    check = deblur(*capture, weight=weight).check
    assert check.verdict == "doubtful"
    # Measured: 0.05 and 0.00; the right weight has 5.0.
    assert check.detail < 0.5
    assert "lost" in check.reasons[-1]


@pytest.mark.parametrize(
    ("accepted", "gain", "factor", "verdict"),
    [
        (True, 30.0, 1.2, "good"),
        (True, 30.0, 1.4, "doubtful"),
        (True, 30.0, 0.7, "doubtful"),
        (False, 30.0, 1.2, "doubtful"),
        (False, 3.0, 1.2, "good"),
        (False, 30.0, 1.1, "good"),
    ],
)
def test_a_focal_length_in_doubt_makes_a_result_doubtful(restored, accepted, gain, factor, verdict):
    values, sd = Correction(scale=float(np.log(factor))), Correction(scale=0.04)
    found = Refinement(*RECORDING, None, accepted, "", values, sd, 0.5, gain, 0.02)
    check = doubted_by(found, restored(right=True).check)
    assert check.verdict == verdict
    assert bool(check.reasons) == (verdict == "doubtful")
    # Where other axes explain as much, nothing is good; nor where a drift takes the place of the motion.
    assert doubted_by(replace(found, reason=OTHER_AXES), restored(right=True).check).verdict == "doubtful"
    drifted = doubted_by(replace(found, accepted=True, confidence=0.0), restored(right=True).check)
    assert "a drift" in drifted.reasons[-1]


def test_half_a_turn_is_found_though_spectra_are_the_same():
    log, camera, exposure = hand_shake(0.3, seed=5), RECORDING[1], Exposure(0.08, 1 / 20)
    blurred = simulate(scene(300, 380), log, camera, exposure, noise=0.003).blurred
    turned = replace(log, omega=log.omega * (-1.0, -1.0, 1.0))
    right = deblur(blurred, log, camera, exposure, prior="wiener").check
    wrong = deblur(blurred, turned, camera, exposure, prior="wiener", fallback=True)
    # Measured: 0.077 lower and 0.071 higher; the bounds are 0.01 and 0.03.
    assert right.half_turn < -0.05
    assert wrong.check.half_turn > 0.06
    assert wrong.check.verdict == "bad"
    assert "upside down" in " ".join(wrong.check.reasons)
    np.testing.assert_allclose(wrong.image, blurred, atol=1e-6)  # float32
    part = deblur(blurred[:150], log, camera.cropped(0, 0, 320, 150), exposure, prior="wiener").check
    assert part.half_turn == 0.0


def test_a_reason_is_given_where_nothing_can_be_judged(capture):
    blurred, log, camera, exposure = capture
    still = deblur(blurred, replace(log, omega=0 * log.omega), camera, exposure, prior="wiener").check
    assert (still.verdict, still.lead) == ("cannot tell", None)
    assert "too little" in still.reasons[0]
    small = deblur(blurred[:60, :60], log, camera.cropped(0, 0, 60, 60), exposure, prior="wiener").check
    assert (small.verdict, small.lead) == ("cannot tell", None)
    assert "too small" in small.reasons[0]
    assert deblur(blurred, log, camera, exposure, check=False, prior="wiener").check is None


def test_pictures_without_detail_are_not_judged_and_give_no_warnings(capture):
    _, log, camera, exposure = capture
    noise = np.random.default_rng(0).normal(0.5, 0.01, (256, 320)).astype(np.float32)
    for picture in (np.zeros((256, 320), np.float32), np.full((256, 320), 128, np.uint8), noise):
        check = deblur(picture, log, camera, exposure, prior="wiener").check
        assert (check.verdict, check.lead) == ("cannot tell", None)
        assert "no detail" in check.reasons[0]


def test_fallback_returns_the_input_where_the_result_is_bad(capture, restored):
    blurred, log, camera, exposure = capture
    light = blurred.clip(0, 1)
    result, replaced = (restored(right=False, fallback=fallback) for fallback in (False, True))
    assert replaced.check == replace(result.check, replaced=True)
    np.testing.assert_allclose(replaced.image, light, atol=1e-6)  # float32
    good, kept = (restored(right=True, fallback=fallback) for fallback in (False, True))
    np.testing.assert_array_equal(kept.image, good.image)
    levels = np.empty(light.shape, np.uint16)
    deblur(light, wrong(log), camera, exposure, prior="tv", fallback=True, out=levels)
    np.testing.assert_allclose(levels, 65535 * light, atol=0.51)  # rounded
    with pytest.raises(InputError, match="fallback"):
        deblur(light, log, camera, exposure, geometry="rectify", fallback=True, prior="wiener")
