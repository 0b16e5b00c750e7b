"""Waves and grain at frequencies that the motion removed."""

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, deblur, hand_shake, scene, simulate
from rsdeblur.estimate.cepstrum import cepstral_match
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.encoded import EncodedImage

RECORDING = hand_shake(0.3, seed=3), Camera(512, 448, 400.0, readout_time=0.02), Exposure(0.08, 1 / 40)
NOISE = 0.003


@pytest.fixture(scope="module")
def blurred():
    """A capture of 512x448 px, of which 42 tiles are compared."""
    return simulate(scene(500, 580), *RECORDING, noise=NOISE).blurred


def match(blurred, sharp, factor=1.0, threads=1):
    photo, result = (EncodedImage.of(np.float32(factor) * each, "linear") for each in (blurred, sharp))
    return cepstral_match(photo, result, Recording(*RECORDING).capture(), factor * NOISE, threads=threads)


def test_grain_is_where_the_motion_removed_most(blurred):
    right, *grainy = (deblur(blurred, *RECORDING, prior="wiener", nsr=nsr).image for nsr in ("auto", 1e-4, 1e-6))
    matches = [match(blurred, each) for each in (blurred, right, *grainy)]
    # Measured: 0.27, 0.14, 0.02, -0.24. The blurred picture itself has least there.
    assert matches == sorted(matches, reverse=True)
    assert matches[1] > 0.1
    assert matches[3] < -0.1


def test_neither_brightness_nor_threads_change_it(blurred):
    sharp = deblur(blurred, *RECORDING, prior="wiener").image
    assert match(blurred, sharp, threads=2) == match(blurred, sharp)
    # Scaling by a power of two is exact, but the least power is a constant.
    assert match(blurred, sharp, factor=4.0) == pytest.approx(match(blurred, sharp), abs=1e-3)


def test_grain_makes_a_result_doubtful_where_an_alternative_leads():
    """The motion is 1.4 times too long, with a hundredth of the right strength."""
    log, camera, exposure = RECORDING
    long = replace(camera, focal_length=(560.0, 560.0))
    picture = simulate(scene(500, 580), *RECORDING, noise=NOISE).blurred
    check = deblur(picture, log, long, exposure, prior="wiener", nsr=1e-5).check
    assert check.lead < 0
    assert check.cepstral_match < 0
    assert "grain" in " ".join(check.reasons)
    assert deblur(picture, log, camera, exposure, prior="wiener").check.cepstral_match is None


def test_it_needs_ten_tiles_with_detail(blurred):
    flat = np.full_like(blurred, 0.5)
    assert match(flat, flat) is None
    few = blurred.copy()
    few[:, 64:] = 0.5
    assert match(few, blurred) is None
