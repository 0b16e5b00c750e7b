"""Other mountings of the gyro that may explain blurred photos better than a corrected recording does."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, PhotoLikelihood, Posterior
from rsdeblur.estimate.score import HOPELESS, NATS_PER_NUMBER, PROOFS, Score
from rsdeblur.estimate.search import WIDEST
from rsdeblur.estimate.sharpness import NATS_PER_FALL, SHORTER
from rsdeblur.estimate.streaks import lead_of
from rsdeblur.motion.axes import rotations
from rsdeblur.types import FloatArray

OTHER_AXES = "other axes of the gyro explain the picture as well: are imu_to_camera and the readout direction right?"
# Nats by which a correction must be likelier than the best one with other axes: those of a number.
AHEAD_OF_AXES = NATS_PER_NUMBER
# All mountings are compared by the spectra at some clock offsets. The likeliest mountings are fitted, with these
# parameters free, and compared by the sharp picture: there, and at those offsets that are not hopeless, because the fit
# knows the spectra alone.
FREE = ("scale", "offset")
# Likeliest mountings, or clock offsets, that are fitted.
FITTED = 4


def rival_lead(score: Score, found: Sequence[Recording]) -> float:
    """Return by how many nats the photos are likelier with the best other mounting than with corrected recordings."""
    photos = score.photos
    own = photos[0].likelihood.recording.camera.imu_to_camera
    nats = [photo.likelihood.spectra.score(each) for photo, each in zip(photos, found, strict=True)]
    clear = [photo.quick.of(each) for photo, each in zip(photos, found, strict=True)]
    lengths = [each.capture().mean_length for each in found]
    traced = [photo.streaks.nats(each) for photo, each in zip(photos, found, strict=True)]
    steps = score.posterior.directions(["offset"])
    shares = (-1.0, -0.5, 0.0, 0.5, 1.0)
    places = [score.nothing + share * WIDEST * steps[0] for share in shares] if steps else [score.nothing]
    free = [name for name in FREE if name in score.posterior.free]

    def tried(turn: FloatArray) -> tuple[Posterior, list[float]]:
        """Return how likely corrections of another mounting are, and its leads at the places of all offsets."""
        turned = []
        for photo in photos:
            recording = photo.likelihood.recording
            other = replace(recording, camera=replace(recording.camera, imu_to_camera=turn @ own))
            turned.append(PhotoLikelihood(photo.likelihood.spectra, other, score.deviations))
        posterior = Posterior(turned, score.deviations)
        return posterior, [posterior.lead(place, nats) for place in places]

    def by_pictures(n: int, other: Recording) -> float:
        """Return by how much a photo is likelier with another recording by its streaks and its sharp picture."""
        fall = clear[n] - photos[n].quick.of(other)
        # With shorter paths, the corrected recording may be clearer because it removes less blur: that counts little.
        if lengths[n] < SHORTER * other.capture().mean_length:
            fall = max(fall, -PROOFS["usual"].fall)
        return lead_of(photos[n].streaks.nats(other), traced[n]) + NATS_PER_FALL * fall

    def evidence(posterior: Posterior, place: FloatArray) -> float:
        others = enumerate(posterior.recordings(place))
        return posterior.lead(place, nats) + sum(by_pictures(n, other) for n, other in others)

    def whole_lead(rival: tuple[Posterior, list[float]]) -> float:
        posterior, leads = rival
        compared = [place for place, lead in zip(places, leads, strict=True) if lead >= HOPELESS]
        if free:
            with suppress(*UNDESCRIBED):
                compared.append(posterior.descend(places[int(np.argmax(leads))], free))
        return max((evidence(posterior, place) for place in compared), default=-np.inf)

    # Left-handed axes have the spectra of right-handed ones.
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    rivals = sorted(share_map(tried, turns, score.threads), key=lambda rival: -max(rival[1]))
    return max(share_map(whole_lead, rivals[:FITTED], score.threads))
