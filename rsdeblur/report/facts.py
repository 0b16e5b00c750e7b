"""Facts about captures and results, as data for JSON and pages, and in words; findings about what limits a result."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur.choices import DROP
from rsdeblur.estimate.refine import Refinement
from rsdeblur.image.highlights import at_full_scale
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.types import FloatArray, FloatImage

if TYPE_CHECKING:
    # Not loaded for every command; that of videos needs PyAV.
    from rsdeblur.calibration import Calibration
    from rsdeblur.estimate.time_offset import OffsetSearch
    from rsdeblur.video.plan import ClipPlan

Level = Literal["warning", "note", "good"]
LEVELS: tuple[Level, ...] = ("warning", "note", "good")
# How much verdicts limit a result; others are warnings.
VERDICT_LEVELS: dict[str, Level] = {"good": "good", "cannot tell": "note", "not checked": "note"}


def result_facts(result: DeblurResult, output: Path, prior: str, seconds: float) -> dict[str, Any]:
    """Return the facts about a result that was written to `output` after some `seconds`."""
    return {
        "output": str(output),
        "mode": result.mode,
        "tile_error_px": result.tile_error,
        "psf_px": list(result.psfs.size[::-1]),
        "prior": prior,
        **{name: getattr(result, name) for name in ("bands", "strips", "nsr", "weight", "noise", "chroma", "timings")},
        "seconds": seconds,
        "check": None if result.check is None else asdict(result.check),
        "refinement": refinement_facts(result.refinement),
    }


def refinement_facts(refinement: Refinement | None) -> dict[str, Any] | None:
    """Return the facts about a correction of the recording."""
    if refinement is None:
        return None
    return {
        **{name: getattr(refinement, name) for name in ("accepted", "reason", "confidence", "gain", "fall")},
        "values": asdict(refinement.values),
        "sd": asdict(refinement.sd),
        "regions": None if refinement.regions is None else refinement.regions.tolist(),
    }


def offset_facts(search: OffsetSearch) -> dict[str, Any]:
    """Return the facts about a search for the time offset; JSON has no infinity."""
    return {
        "time_offset_s": search.time_offset,
        "best_s": search.best,
        "sd_s": search.sd,
        "lead": search.lead if math.isfinite(search.lead) else None,
        "reason": search.reason,
        "offsets_s": search.offsets.tolist(),
        "scores": [score if math.isfinite(score) else None for score in search.scores.tolist()],
    }


def calibration_facts(result: Calibration) -> dict[str, Any]:
    """Return the facts about a calibration."""
    names = ("photos",) if result.photos else ("explained", "pairs", "matches")
    return {
        "readout_direction": result.camera.readout_direction,
        **{name: getattr(result, name) for name in ("accepted", "reason", "mounting", "confidence", *names)},
        "values": {
            name: {"value": each.value, "sd": each.sd, "unit": each.unit, "determined": each.determined}
            for name, each in result.values.items()
        },
    }


def clip_facts(plan: ClipPlan) -> dict[str, Any]:
    """Return the facts about a planned video."""
    clip, (tall, wide) = plan.clip, plan.psf_size
    return {
        "frames": len(clip),
        "treated": plan.treated,
        "kept": len(clip) - plan.treated,
        "largest_blur_px": plan.largest,
        "check": None if plan.check is None else asdict(plan.check),
        "refinement": refinement_facts(plan.refinement),
        "span_s": clip.times[-1],
        "size_px": [clip.width, clip.height],
        "mode": plan.options.mode_in_effect,
        "bands": plan.tiles[0],
        "strips": plan.tiles[1],
        "psf_px": [wide, tall],
        "prior": plan.options.prior_name,
        "nsr": plan.strengths.nsr,
        "weight": plan.strengths.weight,
        "chroma": plan.chroma,
    }


def summary(facts: Mapping[str, Any]) -> str:
    """Return `result_facts` in one line: how the result was made, and the verdict of the check."""
    wide, tall = facts["psf_px"]
    tiles = "rows" if facts["mode"] == "rowwise" else "bands"
    strength = f"NSR {facts['nsr']:.2g}" if facts["weight"] is None else f"weight {facts['weight']:.2g}"
    check = facts["check"]
    verdict = "" if check is None else f"; {check['verdict']}"
    blended = ", blended towards the photo" if check and check["blended"] else ""
    error = facts.get("tile_error_px")
    because = f" (tiles would err by {error:.2f} px)" if facts["mode"] == "rowwise" and error is not None else ""
    return (
        f"{facts['mode']}{because}, "
        f"{facts['bands']} x {facts['strips']} PSFs ({tiles} x strips) of {wide} x {tall} px, "
        f"{facts['prior']}, {strength}, {facts['seconds']:.2f} s{verdict}{blended}"
    )


def remarks(facts: Mapping[str, Any], *, asked: bool = True) -> list[str]:
    """Return lines about a result: reasons of the check, its moment, and the correction if there is one or `asked`."""
    check, refinement = facts.get("check"), facts.get("refinement")
    lines = [f"  {' '.join(check['reasons'])}"] if check and check["reasons"] else []
    if (offset := facts.get("time_offset_s")) is not None:
        lines.append(
            f"  The exposure began {abs(offset):.3f} s {'before' if offset > 0 else 'after'} the time in EXIF."
        )
    if refinement and (asked or refinement["accepted"]):
        lines.append(f"  {correction_text(refinement)}")
    return lines


def correction_text(facts: Mapping[str, Any]) -> str:
    """Return a sentence about a correction of the recording, of which `refinement_facts` are given."""
    if not facts["accepted"]:
        reason = facts["reason"]
        return f"Recording not corrected: {reason}{'' if reason.endswith('?') else '.'}"
    values = facts["values"]
    drift, acceleration = ((values[f"{name}_x"], values[f"{name}_y"]) for name in ("drift", "acceleration"))
    regions = facts["regions"]
    near = f" (x {min(map(min, regions)):g} to {max(map(max, regions)):g} by region)" if regions else ""
    texts = {
        f"focal length x {math.exp(values['scale']):.3f}": values["scale"],
        "drift {:+.1f} and {:+.1f} px".format(*drift) + near: any(drift),
        "acceleration {:+.0f} and {:+.0f} px/s²".format(*acceleration): any(acceleration),
        f"time offset {1e3 * values['offset']:+.1f} ms": values["offset"],
        f"readout time x {math.exp(values['readout']):.2f}": values["readout"],
        f"roll bias {values['roll']:+.3f} rad/s": values["roll"],
    }
    return f"Recording corrected: {', '.join(text for text, changed in texts.items() if changed)}."


def similarity(image: FloatImage, truth: FloatImage) -> dict[str, float | None]:
    """Return PSNR in dB and SSIM of display values in [0, 1], without borders and alpha.

    PSNR is None for equal pictures, because JSON has no infinity. SSIM uses the Gaussian window of its authors (Wang
    et al. 2004).
    """
    # Slow to load, and few commands need it.
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    # Light from beyond the frame blurred the edges. Small pictures lose no more than a quarter of a side at each.
    y, x = (min(24, side // 4) for side in image.shape[:2])
    a, b = (values[y : values.shape[0] - y, x : values.shape[1] - x] for values in (image, truth))
    axis = None if a.ndim == 2 else 2
    if axis and a.shape[2] in (2, 4):
        a, b = a[..., :-1], b[..., :-1]
    ssim = structural_similarity(
        a, b, data_range=1.0, channel_axis=axis, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    psnr = None if (a == b).all() else float(peak_signal_noise_ratio(b, a, data_range=1.0))
    return {"psnr_db": psnr, "ssim": float(ssim)}


def plain(value: Any, digits: int = 6) -> str:
    """Return a value as text for readers, which is empty for None; of a path, its name."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {plain(item, digits)}" for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return "  ".join(plain(item, digits) for item in value)
    if isinstance(value, Path):
        return value.name
    return "" if value is None else f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def readout_data(camera: Camera, exposure: Exposure) -> dict[str, Any]:
    """Return the axis of the readout, its number of lines, and when they are exposed, in ms after the first one opens.

    ``opens`` contains the times of the first and the last line along that axis, ``duration`` is that of every line.
    """
    opens, _ = exposure.window(np.array([0.0, camera.lines - 1.0]), camera)
    return {
        "axis": "x" if camera.horizontal_readout else "y",
        "opens": np.round(1e3 * (opens - exposure.span(camera)[0]), 4).tolist(),
        "lines": camera.lines,
        "duration": round(1e3 * exposure.duration, 4),
    }


def rates_in_camera(log: GyroLog, camera: Camera, epoch_ns: int) -> tuple[FloatArray, FloatArray]:
    """Return the times of a log's samples in camera time, s after the epoch, and its rates about the camera's axes."""
    # Timestamps are subtracted as integers; only the difference becomes a float.
    return log.t + (log.epoch_ns - epoch_ns) * 1e-9 + camera.time_offset, log.omega @ camera.imu_to_camera.T


def around(first: float, last: float) -> tuple[float, float]:
    """Return the span that a plot of an exposure from `first` to `last` shows, s."""
    margin = max(0.5 * (last - first), 0.02)
    return first - margin, last + margin


def motion_data(log: GyroLog, camera: Camera, exposure: Exposure) -> dict[str, Any]:
    """Return `readout_data`, and of the log around the exposure at most 4000 sample times in ms and rates in rad/s."""
    start, end = exposure.span(camera)
    t, rates = rates_in_camera(log, camera, exposure.epoch_ns)
    first, last = around(start, end)
    near = np.flatnonzero((t >= first) & (t <= last))
    near = near[:: math.ceil(max(len(near), 1) / 4000)]
    return readout_data(camera, exposure) | {
        "t": np.round(1e3 * (t[near] - start), 4).tolist(),
        "rates": np.round(rates[near].T, 6).tolist(),
    }


class Finding(NamedTuple):
    """Outcome of one check: how much it limits the result, its subject in a word or two, and sentences."""

    level: Level
    subject: str
    text: str


def findings(
    pixels: NDArray[Any],  # of the blurred picture as stored
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    psf: tuple[int, int],  # height and width of the largest PSF, px
    checks: Mapping[str, Mapping[str, Any]] | None = None,  # fields of the `QualityCheck` of each mode
    unseen: float = 0.0,  # share of the result that was never exposed
    can_split: bool = False,  # whether --saturation always would change the result
) -> list[Finding]:
    """Return what the log, the photo and the blur say about the result, and the verdicts of the check."""
    opens, closes = (time - camera.time_offset for time in exposure.span(camera))
    # In s relative to the exposure's origin; timestamps are subtracted as integers, where they are exact.
    t = log.t + (log.epoch_ns - exposure.epoch_ns) * 1e-9
    outcomes = [_coverage(t, opens, closes), _gaps(log, t, opens, closes), _sampling(log, exposure)]
    outcomes += [_gyro_range(log, t, opens, closes), _saturation(pixels, can_split), _size(psf, pixels.shape)]
    for mode, check in (checks or {}).items():
        verdict = check["verdict"]
        text = f"The check finds it {verdict}."
        if verdict == "cannot tell":
            text = "The check cannot tell whether it is right."
        level = VERDICT_LEVELS.get(verdict, "warning")
        outcomes.append(Finding(level, f"Result, {mode}", " ".join((text, *check["reasons"]))))
    if unseen > 0:
        text = f"{unseen:.1%} of the straightened picture was never exposed and is filled in from its neighbours."
        outcomes.append(Finding("note", "Unexposed parts", text))
    return outcomes


def _outcome(subject: str, text: str, level: Level, more: str, *, applies: bool) -> Finding:
    """Return a finding of a level with `more` text if that applies, or a good one."""
    return Finding(level, subject, text + more) if applies else Finding("good", subject, text)


def _coverage(t: FloatArray, opens: float, closes: float) -> Finding:
    before, after = opens - t[0], t[-1] - closes
    text = f"The log starts {_time(before)} before the first row opens and ends {_time(after)} after the last closes."
    more = " That leaves little room for a different time offset."
    return _outcome("Coverage", text, "note", more, applies=min(before, after) < 0.02)  # s


def _gaps(log: GyroLog, t: FloatArray, opens: float, closes: float) -> Finding:
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
    more = " The motion between samples is interpolated, and may be wrong."
    # A hand's tremor reaches 12 Hz; with fewer samples, the motion between them is guesswork.
    return _outcome("Sampling", text, "warning", more, applies=per_row < 4 and log.rate < 50.0)


def _gyro_range(log: GyroLog, t: FloatArray, opens: float, closes: float) -> Finding:
    inside = np.abs(log.omega[(t >= opens) & (t <= closes)])
    # The largest magnitude in the whole log: a sensor at its limit repeats it. One of coarse resolution repeats small
    # rates, so the limit must exceed 4 rad/s.
    limit = np.abs(log.omega).max(axis=0)
    for axis in range(3):
        at = np.concatenate([[0], inside[:, axis] == limit[axis], [0]]).astype(int)
        runs = np.flatnonzero(np.diff(at) < 0) - np.flatnonzero(np.diff(at) > 0)
        if limit[axis] > 4.0 and runs.max(initial=0) >= 3:
            text = f"The rate about {'xyz'[axis]} stays at {limit[axis]:.3g} rad/s, probably the gyroscope's limit."
            return Finding("warning", "Gyro saturation", text)
    peak = float(np.linalg.norm(inside, axis=1).max(initial=0.0))
    return Finding("good", "Gyro saturation", f"The fastest rate during the exposure is {peak:.3g} rad/s.")


def _saturation(pixels: NDArray[Any], can_split: bool) -> Finding:
    colours = pixels if pixels.ndim == 2 else pixels[..., : 3 if pixels.shape[2] >= 3 else 1]
    clipped = at_full_scale(colours)
    share = float(np.mean(clipped if clipped.ndim == 2 else clipped.any(axis=2)))
    text = f"{share:.2%} of the pixels are clipped at white."
    remedy = ", fewer with --saturation always" if can_split else ""
    more = f" Their brightness is unknown: expect waves around highlights{remedy}."
    # Below a thousandth, the result does not visibly suffer.
    return _outcome("Saturation", text, "warning", more, applies=share > 1e-3)


def _size(psf: tuple[int, int], shape: tuple[int, ...]) -> Finding:
    tall, wide = psf
    text = f"The largest PSF is {wide} x {tall} px in a picture of {shape[1]} x {shape[0]} px."
    if max(psf) > DROP:
        more = " The blur is too large for a faithful result: many frequencies are lost, and borders affect much of it."
        return Finding("warning", "Motion", text + more)
    # A kernel of 3 px is one pixel and its margin.
    return _outcome("Motion", text, "note", " There is hardly any blur to remove.", applies=max(psf) <= 3)


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if abs(seconds) < 1 else f"{seconds:.3g} s"
