"""Facts about results, captures and files, as data for JSON and pages, and in words."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsdeblur.errors import FileFormatError, RsdeblurError, RsdeblurWarning
from rsdeblur.estimate.refine import Refinement
from rsdeblur.io import open_camera, open_gyro, read_acceleration, read_picture
from rsdeblur.io.camera_file import CameraFile
from rsdeblur.io.cameras import detect_camera_format
from rsdeblur.io.captures import FORMATS, clock_facts, open_captures
from rsdeblur.io.columns import choice_for, choices_of
from rsdeblur.io.formats import is_archive
from rsdeblur.io.gyro_logs import detect_gyro_format
from rsdeblur.io.gyroflow import is_profile
from rsdeblur.io.metadata import MAKE, MODEL, Exif, shown_time
from rsdeblur.io.picture_output import KINDS
from rsdeblur.io.pictures import is_picture
from rsdeblur.io.source import Source
from rsdeblur.motion.axes import PRESETS, imu_to_camera
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import AccelerationLog, GyroLog
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.types import FloatArray, FloatImage

if TYPE_CHECKING:
    # Not loaded for every command; that of videos needs PyAV.
    from rsdeblur.calibration import Calibration
    from rsdeblur.estimate.time_offset import OffsetSearch
    from rsdeblur.video.plan import ClipPlan

AXES = {
    "phone": "phone: x right, y up, z out of the screen",
    "gyroflow": "Gyroflow: x up, y left, z back",
    "sensor": "the sensor's own",
}


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
    """Return the facts about a search for the time offset."""
    return {
        "time_offset_s": search.time_offset,
        "best_s": search.best,
        "sd_s": search.sd,
        "reason": search.reason,
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
    replaced = ", replaced by the photo" if check and check["replaced"] else ""
    error = facts.get("tile_error_px")
    because = f" (tiles would err by {error:.2f} px)" if facts["mode"] == "rowwise" and error is not None else ""
    return (
        f"{facts['mode']}{because}, "
        f"{facts['bands']} x {facts['strips']} PSFs ({tiles} x strips) of {wide} x {tall} px, "
        f"{facts['prior']}, {strength}, {facts['seconds']:.2f} s{verdict}{replaced}"
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
    """Return PSNR in dB (None for equal pictures) and SSIM (of Wang et al. 2004) of display values, without borders."""
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
    """Return axis and lines of the readout, when its first and last line open, and how long each is exposed, in ms."""
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


def describe(path: Path, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Return the kind and the contents of a file; `reading` are the arguments of `read_gyro` for a gyro log."""
    source, columns = Source(path, "file"), reading["columns"]
    # By its extension too, so that the error of a damaged picture is about a picture.
    if is_picture(source) or path.suffix.lower() in KINDS:
        return picture_facts(path)
    if columns and not reading["format"] and next(iter(choices_of(columns))) == "capture file":
        return capture_facts(path, columns)
    if columns or reading["format"]:
        return gyro_facts(path, reading)
    if (facts := clock_facts(source)) is not None:
        return facts
    if _is_camera(path):
        return camera_facts(open_camera(path))
    try:
        detect_gyro_format(path)
    except FileFormatError as error:
        if any(each.fits(source) for each in FORMATS):
            return capture_facts(path)
        # Logs are the commonest tables, and archives contain nothing else, so this error is the most likely to help.
        if is_archive(source):
            raise
        raise FileFormatError(f"{error}; it is not a camera file, a capture file or a picture either") from error
    return gyro_facts(path, reading)


def _is_camera(path: Path) -> bool:
    """Return whether a file is that of a camera; recordings, which contain one too, are described as such."""
    try:
        format = detect_camera_format(path)
    except FileFormatError:
        return False
    return format not in ("mars", "recording") and (
        format != "gyroflow" or is_profile(Source(path, "lens profile").json)
    )


def gyro_facts(path: Path, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties of a gyro log."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RsdeblurWarning)
        file = open_gyro(path, **reading)
    remarks = [str(each.message) for each in caught if issubclass(each.category, RsdeblurWarning)]
    log, acceleration = file.log, accelerometer(path, reading.get("columns"))
    gravity = {}
    if acceleration is not None:
        strength = float(np.median(np.linalg.norm(acceleration.force, axis=1)))
        gravity = {"accelerometer_hz": acceleration.rate, "gravity_m_s2": strength}
    return {
        "kind": "gyro log",
        "format": file.format,
        "samples": len(log),
        "rate_hz": log.rate,
        "epoch_ns": log.epoch_ns,
        "span_s": list(log.span),
        "units_in_file": f"{file.time_unit}, {file.rate_unit}",
        "axes": AXES[file.axes],
        **file.facts,
        "gaps_s": log.gaps().tolist(),
        "rms_rad_s": np.sqrt(np.mean(log.omega**2, axis=0)).tolist(),
        "peak_rad_s": np.abs(log.omega).max(axis=0).tolist(),
        **gravity,
        "remarks": list(dict.fromkeys(remarks)),
    }


def accelerometer(path: Path, columns: str | None) -> AccelerationLog | None:
    """Return the accelerometer's samples in a gyro log; None if there are none that can be read."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        try:
            return read_acceleration(path, columns=choice_for("gyro log", columns))
        except RsdeblurError:
            return None


def axes_of(camera: Camera) -> str | None:
    """Return the names of the axes of the log in a camera; None if they have none."""
    axes = [name for name in PRESETS if np.allclose(camera.imu_to_camera, imu_to_camera(name), atol=1e-9)]
    return " or ".join(axes) or None


def camera_facts(file: CameraFile) -> dict[str, Any]:
    """Return the properties of a camera and of its file."""
    camera = file.camera
    return {
        "kind": "camera",
        "format": file.format,
        "size_px": [camera.width, camera.height],
        "focal_length_px": list(camera.focal_length),
        "principal_point_px": list(camera.principal_point),
        "distortion_model": camera.distortion_model,
        "distortion": list(camera.distortion),
        "readout_time_s": camera.readout_time,
        "readout_sd_s": camera.readout_sd,
        "readout_direction": camera.readout_direction,
        "imu_to_camera": camera.imu_to_camera.tolist(),
        "imu_axes": axes_of(camera),
        "time_offset_s": camera.time_offset,
        "time_offset_sd_s": camera.time_offset_sd,
        "timestamp_marks": camera.timestamp_marks,
        **file.facts,
        "remarks": file.remarks,
    }


def capture_facts(path: Path, columns: str | None = None) -> dict[str, Any]:
    """Return the exposures in a capture file."""
    file = open_captures(path, columns)
    exposures = [
        {"start_ns": timestamp} | ({} if duration is None else {"duration_s": duration})
        for timestamp, duration in zip(file.timestamps, file.durations, strict=True)
    ]
    return {"kind": "captures", "format": file.format, "count": len(exposures), "exposures": exposures}


def picture_facts(path: Path) -> dict[str, Any]:
    """Return the properties of a picture."""
    picture = read_picture(path)
    exif = Exif(picture.exif)
    height, width = picture.pixels.shape[:2]
    return {
        "kind": "picture",
        "size_px": [width, height],
        "channels": 1 if picture.pixels.ndim == 2 else picture.pixels.shape[2],
        "values": f"{picture.pixels.dtype}, {picture.transfer}",
        "exif_camera": " ".join(filter(None, (exif.text(MAKE), exif.text(MODEL)))) or None,
        "exif_exposure_s": exif.exposure,
        "exif_time": shown_time(exif),
        "exif_orientation": exif.orientation,
        "icc_profile": picture.icc_profile is not None,
    }
