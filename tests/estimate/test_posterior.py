"""The posterior over several photos: what they share, and what is a photo's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, Uncertainty, hand_shake, scene, simulate
from rsdeblur.estimate.correction import PARAMETERS, SHARED, Recording
from rsdeblur.estimate.posterior import PhotoLikelihood, Posterior
from rsdeblur.estimate.spectra import TileSpectra

CAMERA = Camera(240, 192, 300.0, readout_time=0.02)
LOG = hand_shake(2.5, strength=0.8, seed=8)
EXPOSURES = [Exposure(start, 0.06) for start in (1.0, 2.0)]
DEVIATIONS = Uncertainty(acceleration=0.0).deviations(CAMERA, EXPOSURES[0])
PLACE = np.array([0.5, 0.1, -0.2, 0.4, 0.2, -0.3, 0, 0])


@pytest.fixture(scope="module")
def photos():
    likelihoods = []
    for n, exposure in enumerate(EXPOSURES):
        recording = Recording(LOG, CAMERA, exposure)
        light = simulate(scene(224, 272, seed=n), LOG, CAMERA, exposure, noise=0.005).blurred.mean(axis=2)
        likelihoods.append(PhotoLikelihood(TileSpectra(light, recording, side=240), recording, DEVIATIONS))
    return likelihoods


def test_a_place_has_each_shared_number_once(photos):
    posterior = Posterior(photos, DEVIATIONS)
    place = np.tile(PLACE, (2, 1))
    assert len(posterior.directions(PARAMETERS)) == len(SHARED) + 2 * 2
    own = PLACE[1:3] @ PLACE[1:3]
    assert posterior.prior(place) == pytest.approx(0.5 * (PLACE @ PLACE + own))


def test_gains_of_photos_add(photos):
    """But for the prior of what they share, which counts once."""
    both, (one, other) = Posterior(photos, DEVIATIONS), (Posterior([each], DEVIATIONS) for each in photos)
    place = np.tile(PLACE, (2, 1))
    apart = one.gain(place[:1], one.nothing) + other.gain(place[1:], other.nothing)
    shared = PLACE @ PLACE - PLACE[1:3] @ PLACE[1:3]
    assert both.gain(place, both.nothing) == pytest.approx(apart + 0.5 * shared)


def test_descents_keep_what_is_shared_equal(photos):
    posterior = Posterior(photos, DEVIATIONS)
    begin = np.tile(PLACE, (2, 1))
    end = posterior.descend(begin, ("scale", "drift_x"), steps=2)
    shared = [PARAMETERS.index(name) for name in SHARED]
    assert np.array_equal(end[0, shared], end[1, shared])
    assert end[0, 1] != end[1, 1]
    assert posterior.gain(end, begin) > 0


def test_photos_that_agree_are_surer(photos):
    """A photo given twice has no scatter; the information of both is twice that of one, beside the prior."""
    posteriors = (Posterior([photos[0]] * count, DEVIATIONS) for count in (1, 2))
    one, two = (each.spread(each.nothing, ["offset"])[0, PARAMETERS.index("offset")] for each in posteriors)
    assert (2 / one**2 - 1 / two**2) == pytest.approx(1.0)


def test_threads_change_no_bits(photos):
    one, two = (Posterior(photos, DEVIATIONS, threads=threads) for threads in (1, 2))
    ends = [each.descend(each.nothing, SHARED, steps=1) for each in (one, two)]
    assert np.array_equal(*ends)


def test_a_log_that_ends_has_no_nats(photos):
    late = PhotoLikelihood(photos[0].spectra, replace(photos[0].recording, exposure=Exposure(50.0, 0.06)), DEVIATIONS)
    assert late.nats(np.zeros(len(PARAMETERS))) is None
    assert Posterior([late], DEVIATIONS).nats(np.zeros((1, len(PARAMETERS)))) is None
