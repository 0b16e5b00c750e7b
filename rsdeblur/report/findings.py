"""Checks of a capture and its results: coverage and gaps of the log, sampling, saturation, size of the blur."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rsdeblur.choices import DROP
from rsdeblur.image.highlights import at_full_scale
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog

# s: a log that ends this soon after the exposure leaves no room for a wrong time offset.
NARROW_MARGIN = 0.02
# Samples per exposure, and rate, below which the motion between samples is guesswork. A hand's tremor reaches 12 Hz.
FEW_SAMPLES = 4
SLOW_RATE = 50.0  # Hz
# Share of clipped pixels above which the result visibly suffers.
MUCH_CLIPPED = 1e-3
# A gyro is at its limit where its largest magnitude occurs this often in a row and exceeds this rate (rad/s); a sensor
# of coarse resolution repeats small rates.
STUCK, FAST = 3, 4.0
# px below which deblurring gains nothing.
SMALL_BLUR = 3


@dataclass(frozen=True, slots=True)
class Finding:
    """Outcome of one check.

    Parameters
    ----------
    level : {"good", "note", "warning"}
        How much it limits the result.
    subject : str
        Subject of the check, a word or two.
    text : str
        Outcome, in sentences.
    """

    level: Literal["good", "note", "warning"]
    subject: str
    text: str


def findings(
    pixels: NDArray[Any],
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    psf: tuple[int, int],
    checks: Mapping[str, Mapping[str, Any]] | None = None,
    unseen: float = 0.0,
    can_split: bool = False,
    correction: tuple[bool, str] | None = None,
    remarks: Sequence[str] = (),
) -> tuple[Finding, ...]:
    """Check a capture that was deblurred.

    Parameters
    ----------
    pixels : ndarray, shape (H, W) or (H, W, C)
        The blurred picture as stored.
    log, camera, exposure
        The gyro log, the camera and the time of the exposure.
    psf : (int, int)
        Height and width of the largest PSF, px.
    checks : mapping of str to mapping, optional
        For each mode, the fields of its :class:`rsdeblur.estimate.QualityCheck`.
    unseen : float, default 0.0
        Share of the result that was never exposed.
    can_split : bool, default False
        Whether ``--saturation always`` would solve the capture in another way.
    correction : (bool, str), optional
        Whether the picture corrected the recording, and a sentence about it, if a correction was requested.
    remarks : sequence of str, default ()
        Warnings raised while the capture was read and deblurred.

    Returns
    -------
    tuple of Finding
        Warnings first, then notes, then what is good.
    """
    opens, closes = (time - camera.time_offset for time in exposure.span(camera))
    # In s relative to the exposure's origin; timestamps are subtracted as integers, where they are exact.
    t = log.t + (log.epoch_ns - exposure.epoch_ns) * 1e-9
    outcomes = [Finding("warning", "Remark", remark) for remark in remarks]
    outcomes += [_coverage(t, opens, closes), _gaps(log, t, opens, closes), _sampling(log, exposure)]
    outcomes += [_gyro_range(log, t, opens, closes), _saturation(pixels, can_split), _size(psf, pixels.shape)]
    outcomes += [_verdict(mode, check) for mode, check in (checks or {}).items()]
    if correction is not None:
        outcomes.append(Finding("good" if correction[0] else "note", "Motion", correction[1]))
    if unseen > 0:
        text = f"{unseen:.1%} of the straightened picture was never exposed and is filled in from its neighbours."
        outcomes.append(Finding("note", "Unexposed parts", text))
    order = ("warning", "note", "good")
    return tuple(sorted(outcomes, key=lambda finding: order.index(finding.level)))


def _coverage(t: NDArray[np.float64], opens: float, closes: float) -> Finding:
    before, after = opens - t[0], t[-1] - closes
    text = f"The log starts {_time(before)} before the first row opens and ends {_time(after)} after the last closes."
    if min(before, after) < NARROW_MARGIN:
        return Finding("note", "Coverage", text + " That leaves little room for a different time offset.")
    return Finding("good", "Coverage", text)


def _gaps(log: GyroLog, t: NDArray[np.float64], opens: float, closes: float) -> Finding:
    holes = log.gaps()
    if not len(holes):
        return Finding("good", "Gaps", "The log has no gaps.")
    # A gap inside the exposure is refused, so all are outside.
    away = holes + (t[0] - log.t[0])
    nearest = float(np.maximum(away[:, 0] - closes, opens - away[:, 1]).min())
    longest = float(np.diff(holes, axis=1).max())
    gaps = "1 gap" if len(holes) == 1 else f"{len(holes)} gaps"
    text = f"The log has {gaps}, none during the exposure; the nearest is {_time(nearest)} away."
    return Finding("note", "Gaps", f"{text} The longest lasts {_time(longest)}.")


def _sampling(log: GyroLog, exposure: Exposure) -> Finding:
    per_row = exposure.duration * log.rate
    text = f"{log.rate:.4g} samples per second, {per_row:.3g} per row's exposure of {_time(exposure.duration)}."
    if per_row < FEW_SAMPLES and log.rate < SLOW_RATE:
        return Finding("warning", "Sampling", text + " The motion between samples is interpolated, and may be wrong.")
    return Finding("good", "Sampling", text)


def _gyro_range(log: GyroLog, t: NDArray[np.float64], opens: float, closes: float) -> Finding:
    inside = np.abs(log.omega[(t >= opens) & (t <= closes)])
    # The largest magnitude in the whole log: a sensor at its limit repeats it.
    limit = np.abs(log.omega).max(axis=0)
    for axis in range(3):
        at = np.concatenate([[0], inside[:, axis] == limit[axis], [0]]).astype(int)
        runs = np.flatnonzero(np.diff(at) < 0) - np.flatnonzero(np.diff(at) > 0)
        if limit[axis] > FAST and runs.max(initial=0) >= STUCK:
            text = f"The rate about {'xyz'[axis]} stays at {limit[axis]:.3g} rad/s, probably the gyroscope's limit."
            return Finding("warning", "Gyro saturation", text)
    peak = float(np.linalg.norm(inside, axis=1).max(initial=0.0))
    return Finding("good", "Gyro saturation", f"The fastest rate during the exposure is {peak:.3g} rad/s.")


def _saturation(pixels: NDArray[Any], can_split: bool) -> Finding:
    colours = pixels if pixels.ndim == 2 else pixels[..., : 3 if pixels.shape[2] >= 3 else 1]
    clipped = at_full_scale(colours)
    share = float(np.mean(clipped if clipped.ndim == 2 else clipped.any(axis=2)))
    text = f"{share:.2%} of the pixels are clipped at white."
    if share > MUCH_CLIPPED:
        remedy = ", fewer with --saturation always" if can_split else ""
        text += f" Their brightness is unknown: expect waves around highlights{remedy}."
        return Finding("warning", "Saturation", text)
    return Finding("good", "Saturation", text)


def _size(psf: tuple[int, int], shape: tuple[int, ...]) -> Finding:
    tall, wide = psf
    text = f"The largest PSF is {wide} x {tall} px in a picture of {shape[1]} x {shape[0]} px."
    if max(psf) > DROP:
        more = " The blur is too large for a faithful result: many frequencies are lost, and borders affect much of it."
        return Finding("warning", "Motion", text + more)
    if max(psf) <= SMALL_BLUR:
        return Finding("note", "Motion", text + " There is hardly any blur to remove.")
    return Finding("good", "Motion", text)


def _verdict(mode: str, check: Mapping[str, Any]) -> Finding:
    verdict = check["verdict"]
    level: Literal["good", "note", "warning"] = "good" if verdict == "good" else "warning"
    text = f"The check finds it {verdict}."
    if verdict == "cannot tell":
        level, text = "note", "The check cannot tell whether it is right."
    return Finding(level, f"Result, {mode}", " ".join((text, *check["reasons"])))


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if abs(seconds) < 1 else f"{seconds:.3g} s"
