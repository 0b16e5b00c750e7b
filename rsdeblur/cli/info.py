"""`rsdeblur info`: show what files contain."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import read_captures, read_device
from rsdeblur.cli._log import accelerometer
from rsdeblur.cli._options import READING, Command, Recording, Target
from rsdeblur.cli._output import capture_warnings, linked, say
from rsdeblur.cli._types import PATH
from rsdeblur.errors import CoverageError, FileFormatError

EXAMPLES = """\b
Examples:
  rsdeblur info gyro.csv phone.toml frames.csv photo.jpg
  rsdeblur info --gyro gyro.csv --camera phone.toml --capture frames.csv
"""
# Options that check exposures.
TOGETHER = ("gyro", "camera", "capture")
# Number of entries of a long list, such as exposures or gaps, that the text shows; JSON has all.
SHOWN = 12

AXES = {
    "phone": "phone: x right, y up, z out of the screen",
    "gyroflow": "Gyroflow: x up, y left, z back",
    "sensor": "the sensor's own",
}


@click.command("info", cls=Command, epilog=EXAMPLES)
@click.argument("files", type=PATH, nargs=-1)
@_options.recording_options(*TOGETHER, *READING, "duration", "time_offset", required=())
@_options.target_options()
def command(files: tuple[Path, ...], recording: Recording, target: Target) -> None:
    """Show what FILES contain.

    FILES are gyro logs, camera files, capture files or pictures. With --gyro, --camera and --capture, also show whether
    the log covers each exposure, and if the log has an accelerometer, the angle by which gravity is turned from the
    bottom of the picture, as stored, towards its right.
    """
    named = [getattr(recording, name) for name in TOGETHER]
    if any(named) and not all(named):
        raise click.UsageError("--gyro, --camera and --capture are needed together", ctx=click.get_current_context())
    if not files and not any(named):
        raise click.UsageError("name a file, or --gyro, --camera and --capture", ctx=click.get_current_context())
    entries = []
    for entry in _entries(files, recording):
        entries.append(entry)
        # A reason is reported as the error, at the end.
        if not target.as_json and "reason" not in entry:
            say(*lines_of(entry))
    target.show("info", {"files": entries})
    reasons = [entry["reason"] for entry in entries if "reason" in entry]
    if reasons:
        raise FileFormatError("; ".join(reasons))


def _entries(files: tuple[Path, ...], recording: Recording) -> Iterator[dict[str, Any]]:
    reading = {name.removeprefix("gyro_"): getattr(recording, name) for name in READING}
    for path in files:
        try:
            if not path.is_file():
                what = "not a regular file" if path.exists() else "there is no such file"
                what = "a folder; give the files in it" if path.is_dir() else what
                raise FileFormatError(f"{path}: {what}")
            yield {"file": str(path)} | describe(path, reading)
        except FileFormatError as error:
            # The command describes the other files first.
            yield {"file": str(path), "kind": "not understood", "reason": str(error)}
    if recording.capture is not None:
        coverage = _coverage(recording)
        yield {"file": str(recording.gyro), "kind": f"coverage of {recording.capture}", "exposures": coverage}


def _coverage(recording: Recording) -> list[dict[str, Any]]:
    log, camera = read_device(recording)
    acceleration = accelerometer(recording.gyro, recording.columns)
    report = []
    for exposure in read_captures(recording, recording.duration):
        opens, closes = exposure.span(camera)
        try:
            log.covering(opens - camera.time_offset, closes - camera.time_offset, exposure.epoch_ns)
            state = "complete"
        except CoverageError as error:
            state = str(error)
        start_ns = exposure.epoch_ns + round(exposure.start * 1e9)
        angle = None if acceleration is None else acceleration.gravity_angle(camera, exposure)
        gravity = {} if angle is None else {"gravity_deg": round(math.degrees(angle), 1)}
        report.append({"start_ns": start_ns, "duration_s": exposure.duration} | gravity | {"coverage": state})
    return report


def describe(path: Path, reading: dict[str, Any]) -> dict[str, Any]:
    """Return the kind and the contents of a file; `reading` are the options for reading a gyro log."""
    source = rs.Source(path, rs.WHAT)
    # By its extension too, so that the error of a damaged picture is about a picture.
    if rs.is_picture(source) or path.suffix.lower() in rs.KINDS:
        return describe_picture(path)
    if reading["format"]:
        return describe_gyro(path, reading)
    if columns := reading["columns"]:
        kind = next(iter(rs.choices_of(columns)))
        return (describe_captures if kind == "capture file" else describe_gyro)(path, reading)
    if rs.is_clocks(source):
        return describe_clocks(path)
    for detect, describe_kind in ((rs.detect_camera_format, describe_camera), (rs.detect_gyro_format, describe_gyro)):
        try:
            format = detect(path)
        except FileFormatError:
            continue
        # Recordings contain a camera too, but are described as captures or gyro logs.
        if format in ("mars", "recording") and describe_kind is describe_camera:
            continue
        is_profile = format == "gyroflow" and rs.is_profile(rs.Source(path, "lens profile").json)
        if format != "gyroflow" or describe_kind is describe_gyro or is_profile:
            return describe_kind(path, reading)
    if any(each.fits(source) for each in rs.FORMATS):
        return describe_captures(path, reading)
    try:
        # Logs are the commonest tables, and archives contain nothing else, so this error is the most likely to help.
        return describe_gyro(path, reading)
    except FileFormatError as error:
        if rs.is_archive(source):
            raise
        raise FileFormatError(f"{error}; it is not a camera file, a capture file or a picture either") from error


def describe_gyro(path: Path, reading: dict[str, Any]) -> dict[str, Any]:
    """Return the properties of a gyro log."""
    import numpy as np

    with capture_warnings(show=False) as remarks:
        file = rs.open_gyro(path, **reading)
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
        "remarks": remarks,
    }


def describe_clocks(path: Path) -> dict[str, Any]:
    """Return the differences between the clocks of a session."""
    clocks = rs.read_clocks(path)
    return {
        "kind": "clocks of a session",
        "camera_clock": clocks.source,
        "differences_ns": list(clocks.differences),
        "time_offset_s": clocks.time_offset,
    }


def describe_camera(path: Path, reading: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the contents of a camera file."""
    return camera_facts(rs.open_camera(path))


def camera_facts(file: rs.CameraFile) -> dict[str, Any]:
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
        "imu_axes": _preset_of(camera),
        "time_offset_s": camera.time_offset,
        "timestamp_marks": camera.timestamp_marks,
        **file.facts,
        "remarks": file.remarks,
    }


def _preset_of(camera: rs.Camera) -> str | None:
    import numpy as np

    fits = [name for name in rs.PRESETS if np.allclose(camera.imu_to_camera, rs.imu_to_camera(name), atol=1e-9)]
    return " or ".join(fits) or None


def describe_captures(path: Path, reading: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the exposures in a capture file."""
    file = rs.open_captures(path, (reading or {}).get("columns"))
    exposures = [
        {"start_ns": timestamp} | ({} if duration is None else {"duration_s": duration})
        for timestamp, duration in zip(file.timestamps, file.durations, strict=True)
    ]
    return {"kind": "captures", "format": file.format, "count": len(exposures), "exposures": exposures}


def describe_picture(path: Path) -> dict[str, Any]:
    """Return the properties of a picture, and of the gyro data in its file."""
    picture = rs.read_picture(path)
    exif = rs.Exif(picture.exif)
    height, width = picture.pixels.shape[:2]
    facts = {
        "kind": "picture",
        "size_px": [width, height],
        "channels": 1 if picture.pixels.ndim == 2 else picture.pixels.shape[2],
        "values": f"{picture.pixels.dtype}, {picture.transfer}",
        "exif_camera": " ".join(filter(None, (exif.text(rs.MAKE), exif.text(rs.MODEL)))) or None,
        "exif_exposure_s": exif.exposure,
        "exif_time": rs.shown_time(exif),
        "exif_orientation": exif.orientation,
        "icc_profile": picture.icc_profile is not None,
    }
    if rs.trailer_of(rs.Source(path, "picture")) is None:
        return facts
    gyro = describe_gyro(path, {"format": "gyrodata"})
    return facts | {"gyro": {key: gyro[key] for key in ("samples", "rate_hz", "epoch_ns", "capture_ns")}}


def lines_of(entry: dict[str, Any]) -> Iterator[str]:
    """Yield the lines that show a result of `describe`."""
    yield f"{entry['file']}: {entry['kind']}"
    for key, value in entry.items():
        if key in ("file", "kind") or value in ([], None):
            continue
        if isinstance(value, list) and isinstance(value[0], (dict, list, str)):
            yield f"  {key}:"
            yield from (f"    {i}: {linked(rs.plain(item))}" for i, item in enumerate(value[:SHOWN]))
            if len(value) > SHOWN:
                yield f"    ... {len(value) - SHOWN} more, see --json"
        else:
            yield f"  {key}: {rs.plain(value)}"
