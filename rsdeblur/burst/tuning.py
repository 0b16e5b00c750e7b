"""Measurements of several frames of one scene: their shares, and the strengths that follow for all together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rsdeblur.estimate.blur_spectra import BlurSpectra
from rsdeblur.estimate.strength import PATH_ERROR, Tuning

# Error of the paths as a share of the PSF's radius, where the least blurred frame of a burst is chosen, before other
# frames show how large the errors are: real motion errs by that much.
FRAME_ERROR_SHARE = 0.03
# Error of resampling the frames of a burst, px: of their alignment and, where pictures are as sharp as their pixels, of
# interpolation. Only their shares depend on it. Chosen on eight bursts (docs/developer/decisions.md).
RESAMPLING_ERROR = 0.25


def combined(
    frames: Sequence[Tuning], *, tile_errors: Sequence[float] | None = None
) -> tuple[Tuning, tuple[float, ...]]:
    """Combine the measurements of several frames of one scene.

    A frame counts by its share: the inverse of its :attr:`Tuning.noise_power`, divided by the sum over all frames.
    Frames other than the reference are resampled, which is an error of their blurred picture.

    Parameters
    ----------
    frames : sequence of Tuning
        Measurements of each frame, the reference first, whose energy counts for all.
    tile_errors : sequence of float, optional
        Mean square of the path errors that tiles add to each frame, px^2. Only the shares depend on them, because
        strengths were measured with tiles.

    Returns
    -------
    tuning : Tuning
        Measurements of a picture that is as informative as all frames together.
    shares : tuple of float
        Share of each frame; they sum to 1.
    """
    first = frames[0]
    power = np.array([frame.noise_power(first.energy) for frame in frames])
    errors = np.zeros(len(frames)) if tile_errors is None else np.array(tile_errors, dtype=np.float64)
    errors[1:] += RESAMPLING_ERROR**2
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
    """Return the further errors of the paths as a share of both radii, up to 1.

    `error` is the mean square of the errors of both frames together, px^2.
    """
    excess = max(error - tuning.path_error - other.path_error, 0.0)
    return float(np.sqrt(min(excess / max(tuning.radius**2 + other.radius**2, PATH_ERROR**2), 1.0)))


def restoration_error(tuning: Tuning, energy: float) -> float:
    """Return the expected mean squared error of the best linear restoration from a frame alone.

    `energy` is E of the sharp picture.
    """
    signal = energy * tuning.spectra.signal
    errors = energy * (FRAME_ERROR_SHARE * tuning.radius) ** 2
    noise = tuning.noise_power(energy) + errors + tuning.border_error * signal
    known = noise + tuning.spectra.power * signal
    return float(np.divide(signal * noise, known, out=np.zeros_like(known), where=known > 0).mean())
