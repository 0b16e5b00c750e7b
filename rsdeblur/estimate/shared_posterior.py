"""Corrections of one camera, its clock and its IMU that several photos share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsdeblur._util.threads import share
from rsdeblur.estimate.correction import PARAMETERS
from rsdeblur.estimate.posterior import Posterior, climb, damped
from rsdeblur.types import FloatArray

# What photos share. A drift is a photo's own: with one for each, photos whose camera did not move lengthen the focal
# length by 5 to 12 %.
SHARED = ("scale", "offset", "readout", "roll")


class SharedPosterior:
    """How likely corrections are, given the spectra of several photos.

    Parameters
    ----------
    photos : sequence of Posterior
        The photos, with the same deviations.
    """

    def __init__(self, photos: Sequence[Posterior]) -> None:
        self._photos = photos

    def gain(self, place: FloatArray, over: FloatArray) -> float:
        """Return how much more likely one correction is than another, nats."""
        gains = np.zeros(len(self._photos))

        def compare(_: int, n: int) -> None:
            gains[n] = self._photos[n].gain(place, over)

        share(compare, range(len(gains)), None)
        # The prior counts once.
        again = 0.5 * (len(gains) - 1)
        return float(gains.sum() + again * (place @ place - over @ over))

    def leads(self, place: FloatArray, others: Sequence[FloatArray]) -> FloatArray:
        """Return how much more likely a correction is than motions with the nats `others`, photo by photo.

        The prior of the correction is shared out among the photos; that of the others is ignored.
        """
        count = len(self._photos)
        again = 0.5 * (place @ place) * (count - 1) / count
        return np.array([photo.lead(place, nats) for photo, nats in zip(self._photos, others, strict=True)]) + again

    def descend(self, place: FloatArray, free: Sequence[str], *, steps: int = 8) -> FloatArray:
        """Return the local maximum that Fisher scoring reaches with some parameters free, the others as they are."""

        def information(place: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
            gradients, total = self._information(place, at)
            return gradients.sum(axis=0), total

        return climb(place, free, information, self.gain, steps=steps)

    def deviations(self, place: FloatArray, free: Sequence[str]) -> FloatArray:
        """Return standard deviations of the free parameters, as shares of those of the prior.

        They follow from how far the photos' gradients disagree at the maximum (Huber's sandwich), and from the
        information, as few photos agree by chance.
        """
        at = np.array([PARAMETERS.index(name) for name in free])
        gradients, information = self._information(place, at)
        inverse = np.linalg.inv(damped(information, 0.0))
        apart = gradients - gradients.mean(axis=0)
        scatter = apart.T @ apart * len(apart) / max(len(apart) - 1, 1)
        spread: FloatArray = np.sqrt(np.diag(inverse @ scatter @ inverse) + np.diag(inverse))
        return spread

    def _information(self, place: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradient of each photo, shape (photos, n), and the information of all, without the prior."""
        count = len(self._photos)
        gradients, information = np.zeros((count, len(at))), np.zeros((count, len(at), len(at)))

        def measure(_: int, n: int) -> None:
            gradients[n], information[n] = self._photos[n].information(place, at)

        share(measure, range(count), None)
        total: FloatArray = information.sum(axis=0)
        return gradients, total
