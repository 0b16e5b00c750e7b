"""Other mountings of the gyro that may explain a blurred picture better than a corrected recording does."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import PARAMETERS, Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, SHORTER, QuickSharpness
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.estimate.streaks import LightStreaks, lead_of
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


def rival_lead(
    spectra: TileSpectra,
    sharpness: QuickSharpness,
    found: Recording,
    recording: Recording,
    deviations: FloatArray,
    *,
    streaks: LightStreaks | None = None,
    threads: int | None,
) -> float:
    """Return by how many nats a picture is likelier with the best other mounting than with a corrected recording.

    Parameters
    ----------
    spectra, sharpness
        Both measures of the picture.
    found : Recording
        The corrected recording.
    recording : Recording
        The recording as given.
    deviations : ndarray, shape (8,)
        Standard deviations of its errors.
    streaks : LightStreaks, optional
        Light streaks of the picture.
    threads : int or None
        Threads that share the work; None means all processors.
    """
    own, nats, clear = recording.camera.imu_to_camera, spectra.score(found), sharpness.of(found)
    length, traced = found.capture().mean_length, streaks.nats(found) if streaks else 0.0
    free = [name for name in FREE if deviations[PARAMETERS.index(name)] > 0]
    offsets = OFFSETS if "offset" in free else (0.0,)
    places = [offset * (np.arange(len(PARAMETERS)) == PARAMETERS.index("offset")) for offset in offsets]

    def tried(turn: FloatArray) -> Rival:
        camera = replace(recording.camera, imu_to_camera=turn @ own)
        posterior = Posterior(spectra, replace(recording, camera=camera), deviations)
        return Rival(posterior, [posterior.lead(place, nats) for place in places])

    def fall(posterior: Posterior, place: FloatArray) -> float:
        other = posterior.corrected(place)
        fall = clear - sharpness.of(other)
        # With shorter paths, the corrected recording may be clearer because it removes less blur.
        shorter = length < SHORTER * other.capture().mean_length
        return max(fall, -MOST_OF_SHORTER) if shorter else fall

    def evidence(posterior: Posterior, place: FloatArray) -> float:
        led = lead_of(streaks.nats(posterior.corrected(place)), traced) if streaks else 0.0
        return posterior.lead(place, nats) + led + NATS_PER_FALL * fall(posterior, place)

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
