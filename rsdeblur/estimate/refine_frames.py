"""Correction of what the frames of one recording share: focal length, clock, readout time and roll bias.

As in :mod:`rsdeblur.estimate.refine`, spectra propose and the sharp pictures decide, but of several frames together.
What misleads a single frame, a moving thing or an edge that looks like a blur, misleads few of many. A drift is a
frame's own, and is not corrected here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import share_map, thread_count
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.estimate.correction import PARAMETERS, Correction, Recording, Uncertainty, uncertainty_of
from rsdeblur.estimate.posterior import Posterior
from rsdeblur.estimate.quick_sharpness import NATS_PER_FALL, QuickSharpness
from rsdeblur.estimate.refine import grey_light, spectra_side
from rsdeblur.estimate.rival_axes import OTHER_AXES, rival_lead
from rsdeblur.estimate.search import LEAST_FALL, LEAST_WORTH, MOST_DEVIATIONS, STARTS, TOO_FAR, adjusted
from rsdeblur.estimate.shared_posterior import SHARED, SharedPosterior
from rsdeblur.estimate.spectra import TileSpectra
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.translation import Translation
from rsdeblur.types import FloatArray, Progress

# Parameters that are searched together, few first, because few are more credible than many. Descents begin from the
# best place so far and from the best places of a grid: the values of each parameter, in standard deviations.
MODELS: tuple[dict[str, FloatArray], ...] = (
    {"offset": np.linspace(-3.0, 3.0, 25)},
    {"scale": np.linspace(-2.0, 2.0, 9)},
    {"readout": np.linspace(-2.5, 2.5, 11)},
    {"scale": np.linspace(-1.0, 1.0, 3), "offset": np.linspace(-3.0, 3.0, 7), "readout": np.linspace(-2.0, 2.0, 3)},
    dict.fromkeys(SHARED, np.zeros(1)),
)
# Frames that are enough to correct a recording.
REFINED_FRAMES = 6
# Places of a grid, likeliest first, that are compared by the sharp pictures; and parameters that these adjust at last,
# by which steps, in standard deviations.
COMPARED, ADJUSTED, STEPS = 6, ("scale", "offset", "readout"), (0.6, 0.3)
# Nats that a parameter costs.
NATS_PER_PARAMETER = 10.0
# Frames must agree: the mean of their falls is at least so many times its standard error.
LEAST_AGREEMENT = 2.0


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class FramesRefinement:
    """Result of :func:`refine_frames`: the recording of all frames.

    Parameters
    ----------
    log, camera
        The recording, corrected where the correction is accepted, as given otherwise.
    accepted : bool
        Whether the correction is accepted.
    reason : str
        Why it is not; empty otherwise.
    values : Correction
        The most likely correction, accepted or not; without a drift.
    sd : Correction
        Standard deviations of its numbers.
    gain : float
        How much likelier the correction is than none, nats.
    fall : float
        Mean fall of the logarithm of l1 / l2 of the sharp frames' gradients.
    """

    log: GyroLog
    camera: Camera
    accepted: bool
    reason: str
    values: Correction
    sd: Correction
    gain: float
    fall: float


def refine_frames(
    images: Iterable[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    translation: Translation | None = None,
    uncertainty: Uncertainty | None = None,
    free: str | Collection[str] | None = None,
    transfer: Transfer | Auto = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> FramesRefinement:
    """Correct focal length, clock, readout time and roll bias by several blurred frames of one recording.

    Parameters
    ----------
    images : iterable of array_like, shape (H, W) or (H, W, C)
        The blurred frames, at least two, as for :func:`rsdeblur.deblur`; six that are spread over a clip are plenty.
        They are taken one by one.
    log, camera
        The motion and the camera of all frames.
    exposures : sequence of Exposure
        Time of each frame.
    translation : Translation, optional
        Translation of the camera, if it is known.
    uncertainty : Uncertainty, optional
        How far the recording may be wrong; default `Uncertainty(offset=8e-3)`. Its drift and its acceleration have no
        effect.
    free : str or collection of str, optional
        Which of "scale", "offset", "readout" and "roll" may be corrected; default all.
    transfer : {"auto", "linear", "srgb"} or float
        How values encode light, as for :func:`rsdeblur.deblur`.
    threads : int, optional
        Number of threads; default all processors. Any number gives the same result.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    FramesRefinement
        The recording as given where the frames do not contradict it clearly, or disagree.

    Raises
    ------
    InputError
        If an argument is out of range, or a picture is too small.
    CoverageError, ClockError, GapError
        If the log does not describe an exposure.

    Examples
    --------
    >>> import rsdeblur
    >>> found = rsdeblur.refine_frames(frames, log, camera, exposures)  # doctest: +SKIP
    >>> rsdeblur.deblur(frames[0], found.log, found.camera, exposures[0])  # doctest: +SKIP
    """
    exposures = exposure_list(exposures)
    for exposure in exposures:
        check_recording(log, camera, exposure, translation)
    validate.callback("progress", progress)
    # Several frames distinguish an offset from a motion of the hand, so it may be larger than for one.
    uncertainty = uncertainty_of(uncertainty, free, Uncertainty(offset=8e-3))
    report = progress or (lambda *_: None)
    lights = [grey_light(image, transfer, camera) for image in validate.items("images", images)]
    if len(lights) != len(exposures) or len(lights) < 2:
        raise InputError(
            f"there must be two images or more, and as many exposures, got {len(lights)} and {len(exposures)}"
        )
    recordings = [Recording(log, camera, exposure, translation) for exposure in exposures]
    frames = _Frames(lights, recordings, uncertainty, thread_count(threads))
    best = frames.best(report)
    reason = frames.verdict(best)
    found = frames.corrected(best)
    deviations = frames.deviations
    return FramesRefinement(
        log if reason else found.log,
        camera if reason else found.camera,
        accepted=not reason,
        reason=reason,
        values=Correction(*(best * deviations).tolist()),
        sd=Correction(*(frames.spread(best) * deviations).tolist()),
        gain=frames.gain(best),
        fall=float(frames.falls(best).mean()),
    )


class _Frames:
    """The frames, and the worth of corrections that they share."""

    def __init__(
        self,
        lights: Sequence[NDArray[np.float32]],
        recordings: Sequence[Recording],
        uncertainty: Uncertainty,
        threads: int,
    ) -> None:
        camera, self._threads = recordings[0].camera, threads
        known = [name not in SHARED for name in PARAMETERS]
        self.deviations = np.where(known, 0.0, uncertainty.deviations(camera, recordings[0].exposure))
        self._free = [name for name, deviation in zip(PARAMETERS, self.deviations, strict=True) if deviation > 0]
        self._recordings, self._nothing = recordings, np.zeros(len(PARAMETERS))
        pairs = list(zip(lights, recordings, strict=True))
        self._spectra = [
            TileSpectra(light, each, side=spectra_side(each), soft=True, threads=1) for light, each in pairs
        ]
        self._sharpness = [QuickSharpness(light, each) for light, each in pairs]
        self._photos = [
            Posterior(spectra, each, self.deviations) for spectra, each in zip(self._spectra, recordings, strict=True)
        ]
        self._shared = SharedPosterior(self._photos)
        self._sparsities: dict[bytes, FloatArray] = {}

    def corrected(self, place: FloatArray) -> Recording:
        """Return the recording of the first frame with a correction."""
        return self._photos[0].corrected(place)

    def gain(self, place: FloatArray) -> float:
        """Return how much likelier the spectra are than without a correction, nats."""
        return self._shared.gain(place, self._nothing)

    def falls(self, place: FloatArray) -> FloatArray:
        """Return how much the logarithm of l1 / l2 falls in each frame."""
        return self._sparsity(self._nothing) - self._sparsity(place)

    def spread(self, place: FloatArray) -> FloatArray:
        """Return the standard deviations of all parameters, as shares of those of the prior."""
        spread = np.zeros(len(PARAMETERS))
        if self._free:
            spread[_places(self._free)] = self._shared.deviations(place, self._free)
        return spread

    def best(self, report: Progress) -> FloatArray:
        """Return the best of all corrections that the spectra suggest, adjusted by the sharp pictures."""
        best, worth = self._nothing, 0.0
        for n, model in enumerate(MODELS):
            report("search", n / len(MODELS))
            grid = {name: values for name, values in model.items() if name in self._free}
            if not grid:
                continue
            for start in [best, *self._starts(grid)]:
                place = self._shared.descend(start, list(grid))
                other = self._worth(place) - NATS_PER_PARAMETER * len(grid)
                if other > worth:
                    best, worth = place, other
        axes = _places(name for name in ADJUSTED if name in self._free)
        return adjusted(best, lambda places: [self._worth(place) for place in places], axes, report, steps=STEPS)

    def verdict(self, place: FloatArray) -> str:
        """Return why a correction is not credible; nothing if it is."""
        if self._worth(place) < LEAST_WORTH:
            return "the frames do not contradict the recording, or not clearly"
        if np.abs(place).max() > MOST_DEVIATIONS:
            return TOO_FAR
        falls = self.falls(place)
        if falls.mean() < LEAST_FALL:
            return "the sharp frames do not become clearer"
        if falls.mean() < LEAST_AGREEMENT * falls.std(ddof=1) / np.sqrt(len(falls)):
            return "the frames disagree"

        def lead(n: int) -> float:
            found, recording = self._photos[n].corrected(place), self._recordings[n]
            return rival_lead(self._spectra[n], self._sharpness[n], found, recording, self.deviations, threads=1)

        return OTHER_AXES if sum(share_map(lead, range(len(self._photos)), self._threads)) > 0 else ""

    def _starts(self, grid: Mapping[str, FloatArray]) -> list[FloatArray]:
        """Return the best places of a grid."""
        values = list(product(*grid.values()))
        places = np.zeros((len(values), len(PARAMETERS)))
        places[:, _places(grid)] = values
        likely = places[np.argsort([-self.gain(place) for place in places])[:COMPARED]]
        return list(likely[np.argsort([-self._worth(place) for place in likely])[:STARTS]])

    def _worth(self, place: FloatArray) -> float:
        gain = self.gain(place)
        return gain if gain < 0 else gain + NATS_PER_FALL * float(self.falls(place).sum())

    def _sparsity(self, place: FloatArray) -> FloatArray:
        key = place.tobytes()
        if key not in self._sparsities:
            pairs = list(zip(self._sharpness, self._photos, strict=True))
            values = share_map(lambda pair: pair[0].of(pair[1].corrected(place)), pairs, self._threads)
            self._sparsities[key] = np.array(values)
        return self._sparsities[key]


def _places(names: Iterable[str]) -> list[int]:
    return [PARAMETERS.index(name) for name in names]
