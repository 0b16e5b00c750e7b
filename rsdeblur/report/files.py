"""What files contain, as data."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rsdeblur.errors import FileFormatError, RsdeblurError, RsdeblurWarning
from rsdeblur.io import open_camera, open_gyro, read_acceleration, read_picture
from rsdeblur.io.camera_file import CameraFile
from rsdeblur.io.cameras import detect_camera_format
from rsdeblur.io.captures import FORMATS, WHAT, clock_facts, open_captures
from rsdeblur.io.columns import choice_for, choices_of
from rsdeblur.io.gyro_binary import trailer_of
from rsdeblur.io.gyro_logs import detect_gyro_format
from rsdeblur.io.gyroflow import is_profile
from rsdeblur.io.metadata import MAKE, MODEL, Exif, shown_time
from rsdeblur.io.picture_output import KINDS
from rsdeblur.io.pictures import is_picture
from rsdeblur.io.source import Source, is_archive
from rsdeblur.motion.axes import PRESETS, imu_to_camera
from rsdeblur.motion.gyro import AccelerationLog

AXES = {
    "phone": "phone: x right, y up, z out of the screen",
    "gyroflow": "Gyroflow: x up, y left, z back",
    "sensor": "the sensor's own",
}


def describe(path: Path, reading: Mapping[str, Any]) -> dict[str, Any]:
    """Return the kind and the contents of a file; `reading` are the arguments of `read_gyro` for a gyro log."""
    source, columns = Source(path, WHAT), reading["columns"]
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


def camera_facts(file: CameraFile) -> dict[str, Any]:
    """Return the properties of a camera and of its file."""
    camera = file.camera
    axes = [name for name in PRESETS if np.allclose(camera.imu_to_camera, imu_to_camera(name), atol=1e-9)]
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
        "imu_axes": " or ".join(axes) or None,
        "time_offset_s": camera.time_offset,
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
    """Return the properties of a picture, and of the gyro data in its file."""
    picture = read_picture(path)
    exif = Exif(picture.exif)
    height, width = picture.pixels.shape[:2]
    facts = {
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
    if trailer_of(Source(path, "picture")) is None:
        return facts
    gyro = gyro_facts(path, {"format": "gyrodata"})
    return facts | {"gyro": {key: gyro[key] for key in ("samples", "rate_hz", "epoch_ns", "capture_ns")}}
