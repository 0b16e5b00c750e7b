"""Other mountings of the gyro that may explain a blurred picture better than a corrected recording does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import PARAMETERS, Recording
from rsdeblur.estimate.mounting import rotations
from rsdeblur.estimate.posterior import UNDESCRIBED, Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, QuickSharpness
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.types import FloatArray

OTHER_AXES = "other axes of the gyro explain the picture better: are imu_to_camera and the readout direction right?"
# Offsets with which mountings are compared first, standard deviations; then the likeliest are fitted, with these free.
OFFSETS, FITTED, FREE = (-1.5, 0.0, 1.5), 4, ("scale", "offset")


def rival_lead(
    spectra: TileSpectra,
    sharpness: QuickSharpness,
    found: Recording,
    recording: Recording,
    deviations: FloatArray,
    *,
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
    deviations : ndarray, shape (6,)
        Standard deviations of its errors.
    threads : int or None
        Threads that share the work; None means all processors.
    """
    own, nats, clear = recording.camera.imu_to_camera, spectra.score(found), sharpness.of(found)
    free = [name for name in FREE if deviations[PARAMETERS.index(name)] > 0]
    places = np.zeros((len(OFFSETS), len(PARAMETERS)))
    places[:, PARAMETERS.index("offset")] = OFFSETS

    def tried(turn: FloatArray) -> tuple[float, Posterior, FloatArray]:
        camera = replace(recording.camera, imu_to_camera=turn @ own)
        posterior = Posterior(spectra, replace(recording, camera=camera), deviations)
        lead, best = max((posterior.lead(place, nats), n) for n, place in enumerate(places))
        return lead, posterior, places[best]

    def fitted_lead(rival: tuple[float, Posterior, FloatArray]) -> float:
        _, posterior, place = rival
        try:
            fitted = posterior.descend(place, free) if free else place
        except UNDESCRIBED:
            return -np.inf
        return posterior.lead(fitted, nats) + NATS_PER_FALL * (clear - sharpness.of(posterior.corrected(fitted)))

    # Left-handed axes have the spectra of right-handed ones.
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    rivals = sorted(share_map(tried, turns, threads), key=lambda rival: -rival[0])
    return max(share_map(fitted_lead, rivals[:FITTED], threads))
