"""Frames of a burst, measured one by one and aligned with one of them; their shares in the result."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur._util.threads import share, share_map, thread_count
from rsdeblur.burst.frames import BurstFrame, FrameFit, reduced_bank
from rsdeblur.choices import Auto
from rsdeblur.image.highlights import HighlightSplit
from rsdeblur.motion.paths import Capture
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.steps import StageClock, tuned_part
from rsdeblur.pipeline.tiles import few_psfs
from rsdeblur.psf import tile_centres
from rsdeblur.tuning.strength import PATH_ERROR, BlurSpectra, Tuning

# A frame whose mean weight over the reference's detail is less contributes nothing: its motion or its scene is another.
LEAST_SUPPORT = 0.5
# Least variance of a frame that may be the reference, as a share of that of the middle one (a quarter of the light has
# a sixteenth).
LEAST_VARIANCE = 0.01
# Share of the least further error of any frame that is the reference's own; the rest is that of its alignment.
OWN = 0.5
# Error of the paths as a share of the PSF's radius, where the least blurred frame of a burst is chosen, before other
# frames show how large the errors are: real motion errs by that much.
FRAME_ERROR_SHARE = 0.03
# Error of resampling the frames of a burst, px: of their alignment and, where pictures are as sharp as their pixels, of
# interpolation. Only their shares depend on it. Chosen on eight bursts (docs/developer/decisions.md).
RESAMPLING_ERROR = 0.25


def measured(splits: Sequence[HighlightSplit], captures: Sequence[Capture], options: Options) -> list[BurstFrame]:
    """Measure each frame on its own, aligned with itself; threads share the frames."""
    noise = None if options.noise == "auto" else options.noise

    def measure(n: int) -> BurstFrame:
        rows, bank = tuned_part(splits[n].encoded.shape, few_psfs(captures[n], threads=1))
        one_filter, continued = options.has_one_psf, options.mode_in_effect != "rowwise"
        light = splits[n].remainder(rows)
        tuning = Tuning.of(light, bank, noise=noise, one_filter=one_filter, continued=continued)
        return BurstFrame(splits[n], captures[n], captures[n], tuning)

    # A frame of 12 megapixels takes 0.16 GiB.
    return share_map(measure, range(len(splits)), min(4, thread_count(options.threads)))


@dataclass(frozen=True, slots=True, eq=False)
class AlignedBurst:
    """Frames aligned with the reference, whose index is `index`."""

    index: int
    frames: tuple[BurstFrame, ...]

    @property
    def reference(self) -> BurstFrame:
        """The frame whose pose the result has."""
        return self.frames[self.index]

    @property
    def used(self) -> list[int]:
        """Indices of the frames that contribute, the reference first."""
        others = [n for n, frame in enumerate(self.frames) if frame.fit and frame.fit.support >= LEAST_SUPPORT]
        return [self.index, *others]


def aligned(
    frames: Sequence[BurstFrame], reference: int | Auto, clock: StageClock, threads: int | None
) -> AlignedBurst:
    """Fit all frames to the reference, or to the sharpest frame that most others agree with; threads share them."""
    if not validate.is_auto(reference):
        return _fitted(int(reference), frames, clock, threads)
    # A frame of a covered lens expects no error, because it shows nothing; it is no reference.
    variances = np.array([frame.split.remainder(slice(None), step=4).var() for frame in frames])
    faint = variances < LEAST_VARIANCE * np.median(variances)
    energy = float(np.mean([frames[n].tuning.energy for n in np.flatnonzero(~faint).tolist()]))
    errors = np.array([restoration_error(frame.tuning, energy) for frame in frames])
    errors[faint] = np.inf
    tried = []
    for index in np.argsort(errors, kind="stable").tolist():
        tried.append(_fitted(index, frames, clock, threads))
        if 2 * (len(tried[-1].used) - 1) >= len(frames) - 1:
            return tried[-1]
    return max(tried, key=lambda burst: len(burst.used))


def _fitted(index: int, alone: Sequence[BurstFrame], clock: StageClock, threads: int | None) -> AlignedBurst:
    frames = [replace(frame, reference=alone[index].capture) for frame in alone]
    reference = frames[index]
    height, width, _ = reference.encoded.shape
    # Equally blurred pictures are computed in 8 bands and 4 strips.
    rows, cols = tile_centres(min(8, height), height), tile_centres(min(4, width), width)
    report = clock.within("align")
    banks = share_map(lambda frame: reduced_bank(frame.paths(rows, cols), reference.factor), frames, threads)
    fits: dict[int, FrameFit] = {}

    def fit(thread: int, n: int) -> None:
        if n != index:
            fits[n] = frames[n].fitted(reference, (banks[n], banks[index]))
        # Only the calling thread calls functions of the user.
        if thread == 0:
            report((len(fits) + 1) / len(frames))

    share(fit, range(len(frames)), threads)
    error_shares = []
    for n, found in fits.items():
        frame = frames[n]
        error_share = path_error_share(frame.tuning, reference.tuning, found.path_error * frame.factor**2)
        noise = tuple(octave / found.gain for octave in frame.tuning.octave_noise)
        tuning = with_path_errors(replace(frame.tuning, octave_noise=noise), error_share)
        frames[n] = replace(frame, fit=found, tuning=tuning)
        if found.support >= LEAST_SUPPORT:
            error_shares.append(error_share)
    # The errors of the reference are in all differences, so they are not larger than the least of these.
    tuning = with_path_errors(reference.tuning, OWN * min(error_shares, default=0.0))
    frames[index] = replace(reference, tuning=tuning)
    return AlignedBurst(index, tuple(frames))


def combined(frames: Sequence[Tuning], tile_errors: ArrayLike = 0.0) -> tuple[Tuning, tuple[float, ...]]:
    """Return the measurements of a picture as informative as all frames together, and the share of each frame.

    The first frame is the reference, whose energy counts for all. The share of a frame is the inverse of its
    :attr:`Tuning.noise_power`, divided by the sum over all frames. Frames other than the reference are resampled, which
    is an error of their blurred picture. `tile_errors` are the mean squares of the path errors that tiles add to each
    frame, px^2. Only the shares depend on them, because strengths were measured with tiles.
    """
    first = frames[0]
    power = np.array([frame.noise_power(first.energy) for frame in frames])
    errors = np.asarray(tile_errors) + RESAMPLING_ERROR**2 * (np.arange(len(frames)) > 0)
    # What is wrong by e px changes the blurred picture by e times its gradient.
    left = np.array([frame.spectra.gradient_left for frame in frames])
    precision = 1.0 / (power + first.energy * left * errors)
    shares = precision / precision.sum()

    def mean(values: Sequence[float]) -> float:
        return float(shares @ np.array(values))

    # Errors of the frames are independent, so they average out.
    variances = np.square(shares) @ np.square([frame.octave_noise for frame in frames])
    path_error = float(np.square(shares) @ np.array([frame.path_error for frame in frames]))
    tuning = Tuning(
        tuple(np.sqrt(variances).tolist()),
        first.energy,
        float(np.sqrt(mean([frame.radius**2 for frame in frames]))),
        mean([frame.border_error for frame in frames]),
        BlurSpectra.mean([frame.spectra for frame in frames], shares),
        path_error,
        first.channels,
    )
    return tuning, tuple(shares.tolist())


def with_path_errors(tuning: Tuning, share: float) -> Tuning:
    """Return the measurements with further errors of the paths, a share of the radius."""
    return replace(tuning, path_error=tuning.path_error + (share * tuning.radius) ** 2)


def path_error_share(tuning: Tuning, other: Tuning, error: float) -> float:
    """Return the further errors of the paths as a share of both radii, up to 1; `error` is that of both, px^2."""
    excess = max(error - tuning.path_error - other.path_error, 0.0)
    return float(np.sqrt(min(excess / max(tuning.radius**2 + other.radius**2, PATH_ERROR**2), 1.0)))


def restoration_error(tuning: Tuning, energy: float) -> float:
    """Return the expected mean squared error of the best linear restoration from a frame alone, if E is `energy`."""
    signal = energy * tuning.spectra.signal
    errors = energy * (FRAME_ERROR_SHARE * tuning.radius) ** 2
    noise = tuning.noise_power(energy) + errors + tuning.border_error * signal
    known = noise + tuning.spectra.power * signal
    return float(np.divide(signal * noise, known, out=np.zeros_like(known), where=known > 0).mean())
