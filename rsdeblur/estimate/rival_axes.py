"""Other mountings of the gyro that may explain blurred photos better than a corrected recording does."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, PhotoLikelihood, Posterior
from rsdeblur.estimate.score import Score
from rsdeblur.estimate.sharpness import NATS_PER_FALL, SHORTER
from rsdeblur.estimate.streaks import lead_of
from rsdeblur.motion.axes import rotations
from rsdeblur.types import FloatArray

OTHER_AXES = "other axes of the gyro explain the picture as well: are imu_to_camera and the readout direction right?"
# Most that the corrected recording may be clearer than other axes by shorter paths, as a fall of log l1 / l2.
MOST_OF_SHORTER = 0.01
# Clock offsets with which all mountings are compared by the spectra, standard deviations. The likeliest mountings are
# fitted, with these parameters free, and compared by the sharp picture: there, and at those offsets that are no less
# likely than this, nats, because the fit knows the spectra alone.
OFFSETS, FITTED, FREE, LEAST_COMPARED = (-3.0, -1.5, 0.0, 1.5, 3.0), 4, ("scale", "offset"), -20.0


class Rival(NamedTuple):
    """Another mounting: how likely its corrections are, and its leads at the places of all offsets."""

    posterior: Posterior
    leads: list[float]


def rival_lead(score: Score, found: Sequence[Recording], deviations: FloatArray, *, threads: int | None) -> float:
    """Return by how many nats the photos are likelier with the best other mounting than with corrected recordings.

    `deviations` are the standard deviations of the errors of the recordings as given, shape (8,).
    """
    photos = score.photos
    own = photos[0].likelihood.recording.camera.imu_to_camera
    nats = [photo.likelihood.spectra.score(each) for photo, each in zip(photos, found, strict=True)]
    clear = [photo.measures.quick.of(each) for photo, each in zip(photos, found, strict=True)]
    lengths = [each.capture().mean_length for each in found]
    traced = [photo.measures.streaks.nats(each) for photo, each in zip(photos, found, strict=True)]
    steps = score.posterior.directions(["offset"])
    places = [score.nothing + offset * steps[0] for offset in OFFSETS] if steps else [score.nothing]
    free = [name for name in FREE if name in score.posterior.free]

    def tried(turn: FloatArray) -> Rival:
        turned = []
        for likelihood, _ in photos:
            camera = replace(likelihood.recording.camera, imu_to_camera=turn @ own)
            recording = replace(likelihood.recording, camera=camera)
            turned.append(PhotoLikelihood(likelihood.spectra, recording, deviations))
        posterior = Posterior(turned, deviations)
        return Rival(posterior, [posterior.lead(place, nats) for place in places])

    def by_pictures(n: int, other: Recording) -> float:
        """Return by how much a photo is likelier with another recording by its streaks and its sharp picture."""
        measures = photos[n].measures
        fall = clear[n] - measures.quick.of(other)
        # With shorter paths, the corrected recording may be clearer because it removes less blur.
        if lengths[n] < SHORTER * other.capture().mean_length:
            fall = max(fall, -MOST_OF_SHORTER)
        return lead_of(measures.streaks.nats(other), traced[n]) + NATS_PER_FALL * fall

    def evidence(posterior: Posterior, place: FloatArray) -> float:
        others = enumerate(posterior.recordings(place))
        return posterior.lead(place, nats) + sum(by_pictures(n, other) for n, other in others)

    def whole_lead(rival: Rival) -> float:
        posterior, leads = rival
        compared = [place for place, lead in zip(places, leads, strict=True) if lead >= LEAST_COMPARED]
        if free:
            with suppress(*UNDESCRIBED):
                compared.append(posterior.descend(places[int(np.argmax(leads))], free))
        return max((evidence(posterior, place) for place in compared), default=-np.inf)

    # Left-handed axes have the spectra of right-handed ones.
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    rivals = sorted(share_map(tried, turns, threads), key=lambda rival: -max(rival.leads))
    return max(share_map(whole_lead, rivals[:FITTED], threads))
