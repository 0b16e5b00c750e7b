"""Fit of one camera to several blurred photos, by the spectra of their tiles and by the sharp pictures."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_map
from rsdeblur.errors import CoverageError
from rsdeblur.estimate.correction import SHARED, Recording, Uncertainty
from rsdeblur.estimate.posterior import UNDESCRIBED, PhotoLikelihood, Posterior, costs_of
from rsdeblur.estimate.sharpness import NATS_PER_FALL, QuickSharpness
from rsdeblur.estimate.spectra import TileSpectra, spectra_side
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.types import FloatArray

# How uncertain a camera's start values are.
START = Uncertainty(scale=0.3, offset=0.015, readout=0.5, roll=0.01, drift=0.0, acceleration=0.0)
# Readout time of which deviations are taken where the start has none, s.
USUAL_READOUT = 0.02
# Most steps of a fit.
STEPS = 8


class PhotoFit(NamedTuple):
    """Numbers that photos share under one mounting and readout direction, fitted.

    Parameters
    ----------
    posterior : Posterior
        The photos, with the camera from which the fit began.
    place : ndarray, shape (N, 8)
        Correction of that camera.
    recordings : list of Recording
        The recordings with this correction.
    nats : list of ndarray
        Nats of the tiles of each photo.
    free : tuple of str
        Parameters that were fitted.
    """

    posterior: Posterior
    place: FloatArray
    recordings: list[Recording]
    nats: list[FloatArray]
    free: tuple[str, ...]

    @property
    def camera(self) -> Camera:
        """The corrected camera."""
        return self.recordings[0].camera


class PhotoSet:
    """The photos with their recordings, and how well cameras explain them."""

    def __init__(self, lights: list[NDArray[np.float32]], recordings: list[Recording]) -> None:
        self._lights, self.recordings = lights, recordings
        self._sides = [spectra_side(each) for each in recordings]
        self._spectra: dict[bool, list[TileSpectra]] = {}
        self._sharpness: dict[bool, list[QuickSharpness]] = {}

    def __len__(self) -> int:
        return len(self.recordings)

    @property
    def start(self) -> Camera:
        """The camera with the start values."""
        return self.recordings[0].camera

    @cached_property
    def deviations(self) -> FloatArray:
        """Standard deviations of corrections."""
        return START.deviations(replace(self.start, readout_time=USUAL_READOUT), self.recordings[0].exposure)

    def spectra(self, camera: Camera) -> list[TileSpectra]:
        """Return the spectra of the photos, in the upright frame of a camera."""
        key = camera.horizontal_readout
        if key not in self._spectra:
            # The start's offset, for which the logs describe the exposures.
            start = replace(self.start, readout_direction=camera.readout_direction)
            recordings = [replace(each, camera=start) for each in self.recordings]
            self._spectra[key] = [
                TileSpectra(light, recording, side=side, threads=1)
                for light, recording, side in zip(self._lights, recordings, self._sides, strict=True)
            ]
        return self._spectra[key]

    def nats(self, recordings: Sequence[Recording]) -> list[FloatArray]:
        """Return the nats of the tiles of each photo.

        Raises
        ------
        CoverageError, ClockError, GapError
            If a log does not describe an exposure.
        """
        pairs = list(zip(self.spectra(recordings[0].camera), recordings, strict=True))
        return share_map(lambda pair: pair[0].score(pair[1]), pairs, None)

    def best(self, cameras: Sequence[Camera]) -> list[int]:
        """Return the places of cameras in the order of their likelihood by the spectra, the best first.

        Raises
        ------
        CoverageError
            If the logs describe the exposures under none of them.
        """
        described, every = [], []
        for place, camera in enumerate(cameras):
            with suppress(*UNDESCRIBED):
                every.append(self.nats([replace(each, camera=camera) for each in self.recordings]))
                described.append(place)
        if not described:
            raise CoverageError(
                "the logs cover the exposures under no offset of the search; widen it, or check the clocks"
            )
        costs = sum(costs_of(np.array(photo)) for photo in zip(*every, strict=True))
        return [described[place] for place in np.argsort(costs, kind="stable")]

    def fit(self, camera: Camera, free: tuple[str, ...] = SHARED) -> PhotoFit:
        """Fit corrections of a camera."""
        photos = [
            PhotoLikelihood(spectra, replace(recording, camera=camera), self.deviations)
            for spectra, recording in zip(self.spectra(camera), self.recordings, strict=True)
        ]
        posterior = Posterior(photos, self.deviations, threads=None)
        free = tuple(name for name in free if name != "readout" or camera.readout_time)
        place = posterior.descend(posterior.nothing, free, steps=STEPS) if free else posterior.nothing
        recordings = posterior.recordings(place)
        return PhotoFit(posterior, place, recordings, self.nats(recordings), free)

    def leads(self, fit: PhotoFit, other: PhotoFit) -> FloatArray:
        """Return how much more likely the spectra and the sharpness of each photo are with one fit than another, nats.

        Both must be read along the same axis: the numbers of different frames do not compare.
        """
        leads = fit.posterior.photo_leads(fit.place, other.nats)
        # The prior of the fit is shared out among the photos.
        return leads - fit.posterior.prior(fit.place) / len(self) + self.clearer(fit, other)

    def blur(self, fit: PhotoFit) -> float:
        """Return the mean length of the blur, px."""
        return float(np.mean([each.capture().mean_length for each in fit.recordings]))

    def likeliest(self, fits: Sequence[PhotoFit]) -> PhotoFit:
        """Return the likeliest fit."""
        best = fits[0]
        for fit in fits[1:]:
            best = fit if self.leads(fit, best).sum() > 0 else best
        return best

    def clearer(self, fit: PhotoFit, other: PhotoFit, *, mirrored: bool = False) -> FloatArray:
        """Return how much clearer each sharp picture is with one fit than with another, nats; see `leads`.

        If `mirrored`, the log of the other fit is taken with reversed axes.
        """
        recordings = [mirrored_log(each) for each in other.recordings] if mirrored else other.recordings
        pairs = zip(self._measures(fit), recordings, fit.recordings, strict=True)
        return NATS_PER_FALL * np.array([measure.of(theirs) - measure.of(own) for measure, theirs, own in pairs])

    def _measures(self, fit: PhotoFit) -> list[QuickSharpness]:
        key = fit.camera.horizontal_readout
        if key not in self._sharpness:
            pairs = zip(self._lights, fit.recordings, strict=True)
            self._sharpness[key] = [QuickSharpness(light, recording) for light, recording in pairs]
        return self._sharpness[key]


def mirrored_log(recording: Recording) -> Recording:
    """Return a recording whose log is reversed, and so every path of the blur."""
    log = recording.log
    return replace(recording, log=GyroLog(log.t, -log.omega, log.epoch_ns))
