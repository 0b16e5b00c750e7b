"""Cameras of recordings: what capture metadata, gyro logs and videos contain about the camera."""

from __future__ import annotations

import math
import re
import warnings
from typing import Any

import numpy as np

from rsdeblur._util import ffmpeg
from rsdeblur.choices import Distortion, ReadoutDirection
from rsdeblur.errors import InputError, RsdeblurWarning
from rsdeblur.io.camera_file import Assumption, CameraFile, Request
from rsdeblur.io.gyro_binary import is_video
from rsdeblur.io.gyro_logs import open_gyro
from rsdeblur.io.gyroflow import is_gcsv
from rsdeblur.io.source import Source
from rsdeblur.io.text import TextFile, cells_of, find_columns, is_number
from rsdeblur.motion.camera import Camera

# Columns of MARS logger's movie_metadata.csv; only iOS has the principal point, only Android the readout time.
MARS_FOCAL = (re.compile(r"fx\s*\[px\]"), re.compile(r"fy\s*\[px\]"))
MARS_COLUMNS = {
    "cx": re.compile(r"cx\s*\[px\]"),
    "cy": re.compile(r"cy\s*\[px\]"),
    "readout_ns": re.compile(r"frame readout time\s*\[nanosec\]"),
    "exposure_ns": re.compile(r"exposure (time|duration)\s*\[nanosec\]"),
    "iso": re.compile("iso"),
    "focal_mm": re.compile("focal length"),
}
# Degrees along the longer side. The main cameras of phones see more, so a smaller one suggests another scale.
LEAST_PHONE_VIEW = 50.0


def sniff_mars(source: Source) -> bool:
    """Whether the file is MARS logger's capture metadata."""
    return source.looks_like_text and find_columns(source.text.head, MARS_FOCAL) is not None


def read_mars(source: Source, request: Request) -> CameraFile:
    """Read the camera in MARS logger's ``movie_metadata.csv``."""
    facts = mars_facts(source.text)
    if not facts:
        raise source.error("not MARS logger's metadata: no line names the columns fx[px] and fy[px]")
    size = request.size or facts.pop("size", None)
    if size is None:
        raise source.error(
            "MARS logger does not write the size of the pictures: make a camera file with rsdeblur camera import, "
            "--size 1920x1080, or 1080x1920 for upright frames, and the width of the whole sensor, to which its focal "
            "length often refers: --sensor-width 4000"
        )
    width, height = size
    stored, readout = facts.pop("focal_length_px"), facts.pop("readout_time_s", None)
    focal_length = request.focal_length or stored
    assumptions = []
    if request.focal_length is None and request.sensor_width is not None:
        focal_length = focal_length * max(size) / request.sensor_width
    elif request.focal_length is None:
        view = math.degrees(2 * math.atan(max(size) / focal_length / 2))
        text = f"the focal length of {focal_length:g} px, a field of view of {view:.0f} degrees, is taken as it is"
        if view < LEAST_PHONE_VIEW:
            text += "; that is little for a phone: if it refers to the whole sensor, give --sensor-width, like 4000"
        assumptions.append(Assumption("focal_length", text))
    upright = height > width
    axes, direction = _phone(upright)
    if readout is None:
        text = "the file contains no readout time: 0 is assumed; give it, because the shutter rolls"
        assumptions.append(Assumption("readout_time", text))
    shape = "upright" if upright else "landscape"
    assumptions += [
        Assumption("readout_direction", f"the readout direction {direction} is assumed, as of {shape} frames"),
        Assumption("imu_to_camera", f"the axes {axes} are assumed, as of {shape} frames of a rear camera"),
    ]
    try:
        camera = Camera(
            width, height, focal_length, readout_time=readout or 0.0, readout_direction=direction, imu_to_camera=axes
        )
    except InputError as error:
        raise source.error(str(error)) from error
    return CameraFile(camera, "mars", facts, tuple(assumptions))


def mars_facts(text: TextFile) -> dict[str, Any]:
    """Return what MARS logger's capture metadata contain about the camera; medians of columns, without `null` cells.

    `size` is that of the picture on iOS, whose principal point is near the middle.
    """
    places = find_columns(text.head, MARS_FOCAL)
    if places is None:
        return {}
    head = [cell.lower() for cell in cells_of(text.head)]
    rows = [cells_of(text.lines[row]) for row in text.rows[1:]]

    def median(place: int) -> float | None:
        cells = [float(cells[place]) for cells in rows if place < len(cells) and is_number(cells[place])]
        value = float(np.median(cells)) if cells else 0.0
        return value if math.isfinite(value) and value > 0 else None

    values = {
        name: median(place)
        for name, pattern in MARS_COLUMNS.items()
        for place in [next((k for k, cell in enumerate(head) if pattern.match(cell)), len(head))]
    }
    facts: dict[str, Any] = {"frames": len(rows)}
    if (focal_length := median(places[0])) is None:
        raise text.error("no focal length: all cells of its column are null; give --focal-length")
    facts["focal_length_px"] = focal_length
    if values["readout_ns"] is not None:
        facts["readout_time_s"] = values["readout_ns"] / 1e9
    if values["exposure_ns"] is not None:
        facts["exposure_s"] = values["exposure_ns"] / 1e9
    facts |= {name: values[name] for name in ("iso", "focal_mm") if values[name] is not None}
    if values["cx"] is not None and values["cy"] is not None:
        facts["size"] = (round(2 * values["cx"]), round(2 * values["cy"]))
    return facts


def _phone(upright: bool) -> tuple[str, ReadoutDirection]:
    """Return axes and readout direction of a rear camera: its sensor is mounted landscape and read from the top."""
    return ("phone-portrait", "right-left") if upright else ("phone-landscape", "top-down")


def sniff_log(source: Source) -> bool:
    """Whether the file is a `.gcsv` log or a video that may contain telemetry."""
    return is_video(source) or (source.looks_like_text and is_gcsv(source.text))


def read_log(source: Source, request: Request) -> CameraFile:
    """Read the camera of a `.gcsv` log or of a video with telemetry: readout, and what `request` adds."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        facts = dict(open_gyro(source.path).facts)
    size = request.size or (_video_size(source) if is_video(source) else None)
    if size is None:
        raise source.error(
            "the file does not contain the size of the picture: make a camera file with rsdeblur camera import and "
            "--size 1920x1080"
        )
    view, readout = facts.get("field_of_view_deg"), facts.pop("readout_time_s", None)
    direction = facts.pop("readout_direction", "top-down")
    focal_length = request.focal_length
    model: Distortion = "none"
    assumptions = []
    if focal_length is None:
        if view is None:
            raise source.error(
                "the file does not contain the focal length; give --focal-length or --focal35, or import a lens "
                "profile of Gyroflow instead"
            )
        # Without digital correction, action cameras have an equidistant lens, to a few percent.
        focal_length = math.hypot(*size) / 2 / math.radians(view / 2)
        model = "fisheye"
        text = (
            f"the focal length of {focal_length:.0f} px follows from the field of view of {view:.1f} degrees and an "
            "equidistant lens, to a few percent at best; a lens profile of Gyroflow is better"
        )
        assumptions.append(Assumption("focal_length", text))
    if readout is None:
        assumptions.append(Assumption("readout_time", "the file contains no readout time: 0 is assumed; give it"))
    if "stabilised" in facts:
        text = f"the camera stabilised the video ({facts['stabilised']}), so its blur is not that of the gyro"
        assumptions.append(Assumption("", text))
    try:
        camera = Camera(
            *size,
            focal_length,
            readout_time=readout or 0.0,
            readout_direction=direction,
            imu_to_camera="gyroflow",
            timestamp_marks="middle",
            distortion_model=model,
            distortion=(0.0,) * 4 if model == "fisheye" else (),
        )
    except InputError as error:
        raise source.error(str(error)) from error
    return CameraFile(camera, "video" if is_video(source) else "gcsv", facts, tuple(assumptions))


def _video_size(source: Source) -> tuple[int, int] | None:
    """Return width and height of a video as stored; None if PyAV is missing or cannot read it."""
    try:
        import av
    except ModuleNotFoundError:
        return None
    try:
        with av.open(**ffmpeg.existing(source.path)) as container:
            stream = container.streams.video[0]
            return stream.width, stream.height
    except (OSError, ValueError, IndexError, av.FFmpegError):
        return None
