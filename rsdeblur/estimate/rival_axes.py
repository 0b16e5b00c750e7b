"""Other mountings of the gyro that may explain a blurred picture better than a corrected recording does."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rsdeblur._util.threads import share_map
from rsdeblur.estimate.correction import PARAMETERS, Recording
from rsdeblur.estimate.posterior import UNDESCRIBED, Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, QuickSharpness
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.motion.axes import rotations
from rsdeblur.types import FloatArray

OTHER_AXES = "other axes of the gyro explain the picture better: are imu_to_camera and the readout direction right?"
# Other offsets with which the likeliest mountings are compared, standard deviations, and how many; of these, the
# likeliest are fitted, with these parameters free.
OFFSETS, COMPARED, FITTED, FREE = (-1.5, 1.5), 8, 4, ("scale", "offset")


class Rival(NamedTuple):
    """Another mounting: its lead, how likely its corrections are, and its best place so far."""

    lead: float
    posterior: Posterior
    place: FloatArray


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
    nothing = np.zeros(len(PARAMETERS))
    places = [offset * (np.arange(len(PARAMETERS)) == PARAMETERS.index("offset")) for offset in OFFSETS]

    def tried(turn: FloatArray) -> Rival:
        camera = replace(recording.camera, imu_to_camera=turn @ own)
        posterior = Posterior(spectra, replace(recording, camera=camera), deviations)
        return Rival(posterior.lead(nothing, nats), posterior, nothing)

    def compared(rival: Rival) -> Rival:
        others = (Rival(rival.posterior.lead(place, nats), rival.posterior, place) for place in places)
        return max(rival, *others, key=lambda each: each.lead)

    def fitted_lead(rival: Rival) -> float:
        _, posterior, place = rival
        try:
            fitted = posterior.descend(place, free) if free else place
        except UNDESCRIBED:
            return -np.inf
        return posterior.lead(fitted, nats) + NATS_PER_FALL * (clear - sharpness.of(posterior.corrected(fitted)))

    # Left-handed axes have the spectra of right-handed ones.
    turns = [turn for turn in rotations() if not np.array_equal(turn, np.eye(3))]
    rivals = sorted(share_map(tried, turns, threads), key=lambda rival: -rival.lead)
    rivals = sorted(share_map(compared, rivals[:COMPARED], threads), key=lambda rival: -rival.lead)
    return max(share_map(fitted_lead, rivals[:FITTED], threads))
