"""Triage: the blur of many exposures from the gyro log alone, without their pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rsdeblur._util import validate
from rsdeblur.choices import DROP, KEEP
from rsdeblur.errors import CoverageError, InputError
from rsdeblur.motion.arguments import exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import Capture
from rsdeblur.types import FloatArray, Progress

Decision = Literal["keep", "deblur", "drop", "unknown"]
DECISIONS: tuple[Decision, ...] = ("keep", "deblur", "drop", "unknown")


@dataclass(frozen=True, slots=True, eq=False)
class Triage:
    """Blur of a series of exposures, and what to do with each picture.

    Parameters
    ----------
    lengths : ndarray, shape (n,)
        Length of the longest path that a point of the picture draws during its exposure, px; NaN where it is unknown.
    reasons : tuple of str or None
        Reason why the blur of an exposure is unknown; None where it is known.
    keep, drop : float
        Thresholds, see :func:`triage`.
    """

    lengths: FloatArray
    reasons: tuple[str | None, ...]
    keep: float = KEEP
    drop: float = DROP

    def __len__(self) -> int:
        return len(self.reasons)

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Decision for each exposure: "keep", "deblur", "drop", or "unknown" where the blur is."""
        return tuple(
            "unknown" if np.isnan(n) else "keep" if n <= self.keep else "deblur" if n <= self.drop else "drop"
            for n in self.lengths
        )

    @property
    def counts(self) -> dict[Decision, int]:
        """Number of exposures for each decision."""
        decisions = self.decisions
        return {decision: decisions.count(decision) for decision in DECISIONS}


def triage(
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    keep: float = KEEP,
    drop: float = DROP,
    progress: Progress | None = None,
) -> Triage:
    """Measure the blur of many exposures from the gyro log, and decide which pictures to keep, deblur or drop.

    No picture is read. Only rotation counts: blur by focus, by moving subjects or by the camera's translation is not in
    a gyro log.

    Parameters
    ----------
    log, camera
        The recording.
    exposures : sequence of Exposure
        The exposures, in any order.
    keep : float, default 1.5
        Longest path in px of a picture that is sharp enough as it is.
    drop : float, default 100
        Longest path in px of a picture that is worth deblurring; at least `keep`.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    Triage
        Blur and decision for each exposure.

    Raises
    ------
    InputError
        If a threshold is negative or not finite, or `drop` is less than `keep`.

    Examples
    --------
    >>> import rsdeblur
    >>> log = rsdeblur.hand_shake(0.6, strength=0.4, seed=1)
    >>> camera = rsdeblur.Camera(1920, 1080, 1500.0, readout_time=0.02)
    >>> exposures = [rsdeblur.Exposure(0.3, duration) for duration in (1 / 4000, 1 / 100, 1 / 10)]
    >>> rsdeblur.triage(log, camera, exposures).decisions
    ('keep', 'deblur', 'drop')
    """
    validate.instance("log", log, GyroLog)
    validate.instance("camera", camera, Camera)
    keep, drop = check_thresholds(keep, drop)
    validate.callback("progress", progress)
    exposures = exposure_list(exposures)
    blurs = []
    for i, exposure in enumerate(exposures):
        blurs.append(blur_of(log, camera, exposure))
        if progress is not None:
            progress("measure all exposures", (i + 1) / len(exposures))
    lengths = np.array([length for length, _ in blurs], dtype=np.float64)
    lengths.setflags(write=False)
    return Triage(lengths, tuple(reason for _, reason in blurs), keep, drop)


def check_thresholds(keep: float, drop: float) -> tuple[float, float]:
    """Return the thresholds; raise `InputError` unless they are finite and 0 <= keep <= drop."""
    keep = validate.finite("keep", keep, minimum=0.0)
    return keep, validate.finite("drop", drop, minimum=keep)


def blur_of(log: GyroLog, camera: Camera, exposure: Exposure) -> tuple[float, str | None]:
    """Return the length in px of the longest path; NaN and the reason where the log does not describe the exposure."""
    try:
        upright = camera.turned() if camera.horizontal_readout else camera
        return float(Capture.from_log(log, upright, exposure).probe.lengths.max()), None
    except (CoverageError, InputError) as error:
        return float("nan"), str(error)
