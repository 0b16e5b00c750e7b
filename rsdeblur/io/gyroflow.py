"""Files of Gyroflow: logs in `.gcsv` text and `.gyroflow` projects, and cameras in lens profiles and projects.

Logs contain rates in the sensor's raw axes and an orientation string. The string is applied, so the rates of the log
are in Gyroflow's frame (x up, y left, z back).
"""

import math
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Any

import numpy as np

from rsdeblur._util.binary import base91_decode
from rsdeblur._util.validate import missing
from rsdeblur.choices import Distortion
from rsdeblur.errors import InputError
from rsdeblur.io.camera_file import Assumption, CameraFile, Request, finished
from rsdeblur.io.columns import named_columns
from rsdeblur.io.formats import Format, unpacked_limit
from rsdeblur.io.samples import GYRO, AnySensor, Samples, vectors
from rsdeblur.io.source import NUMBER, Source, read_table
from rsdeblur.motion.axes import orientation
from rsdeblur.types import FloatArray

TITLES = ("GYROFLOW IMU LOG", "CAMERA IMU LOG")
# Gyroflow's default for a log without an orientation.
DEFAULT_ORIENTATION = "xzY"
UNORIENTED = (
    f"the log contains no orientation of its sensor: Gyroflow's default, {DEFAULT_ORIENTATION}, is assumed, which is "
    "right for few loggers"
)

# Gyroflow's numbers and names of readout directions, in lower case.
DIRECTIONS = {
    "top-down": ("0", "toptobottom"),
    "bottom-up": ("1", "180", "bottomtotop"),
    "left-right": ("2", "270", "lefttoright"),
    "right-left": ("3", "90", "righttoleft"),
}

# Degrees: hardly any profile is of a longer lens. mm: widths of sensors, from cropped ones of phones to medium format.
NARROWEST, SENSORS = 12.0, (3.0, 60.0)


def readout_of(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return `readout_time_s` and `readout_direction` from Gyroflow's keys; a negative time is bottom to top."""
    try:
        readout_time = float(table["frame_readout_time"]) / 1e3
    except (KeyError, TypeError, ValueError):
        return {}
    if not np.isfinite(readout_time) or readout_time == 0:
        return {}
    word = str(table.get("frame_readout_direction", "")).lower()
    direction = next((name for name, words in DIRECTIONS.items() if word in words), "top-down")
    if readout_time < 0 and direction == "top-down":
        direction = "bottom-up"
    return {"readout_time_s": abs(readout_time), "readout_direction": direction}


def is_gcsv(source: Source) -> bool:
    """Whether the file is a `.gcsv` log."""
    return source.first_line.strip().strip('",;').upper() in TITLES


def _read_gcsv(source: Source, sensor: AnySensor) -> Samples:
    """Read the gyro, in rad/s, or the accelerometer, in g, of a `.gcsv` file, both times their scale."""
    letter, unit = ("g", "rad/s") if sensor is GYRO else ("a", "g")
    columns = named_columns(source, sensor.quantity)
    if columns is None:
        raise source.error(f"the Gyroflow log has no line `t,{letter}x,{letter}y,{letter}z` above its samples")
    # Values and their lines by key; a value may contain the mark that separates it from its key.
    keys: dict[str, tuple[str, int]] = {}
    for row in source.rows[: columns.start - 1].tolist():
        line = source.lines[row].strip().rstrip(",;")
        key, *value = (part.strip(' "') for part in re.split("[,:;]", line, maxsplit=1))
        keys[key.lower()] = (value[0] if value else "", row)

    def scale(key: str, default: str) -> Decimal:
        value, row = keys.get(key, (default, 0))
        if not NUMBER.fullmatch(value) or not 1e-12 <= float(value) <= 1e12:
            raise source.error(f"{key} must be a number from 1e-12 to 1e12, got {value!r}", row)
        return Decimal(value)

    tscale, value_scale = scale("tscale", "0.001"), float(scale(f"{letter}scale", "1"))
    letters, row = keys.get("orientation", (DEFAULT_ORIENTATION, 0))
    try:
        turn = orientation(letters)
    except InputError as error:
        raise source.error(str(error), row) from error
    values = {key: value for key, (value, _) in keys.items()}
    table = read_table(source, source.rows[columns.start :], columns.places)
    return Samples(
        source.path,
        table.nanoseconds(tscale * 10**9),
        table.values * value_scale,
        table.rows,
        axes="gyroflow",
        time_unit=f"{tscale.normalize()} s",
        unit=unit,
        turn=turn,
        facts={"orientation": letters} | readout_of(values),
        cautions=[] if "orientation" in keys else [UNORIENTED],
    )


def is_project(content: Any) -> bool:
    """Whether `content`, read from JSON, is a Gyroflow project."""
    return isinstance(content, dict) and (
        content.get("title") == "Gyroflow data file" or "gyro_source" in content or "raw_imu" in content
    )


def _read_project(source: Source, _: AnySensor) -> Samples:
    project = source.json
    with source.parsing("the gyro data of the project"):
        gyro = project.get("gyro_source") or {}
        metadata = gyro.get("file_metadata") or {}
        if isinstance(metadata, str):
            metadata = _cbor(source, _payload(source, metadata))
        raw = metadata.get("raw_imu") or gyro.get("raw_imu") or project.get("raw_imu")
        if not raw:
            origin = gyro.get("filepath") or project.get("videofile") or "the video"
            raise source.error(f"the project was saved without gyro data; give the file they come from: {origin}")
        t_ms, rates, unit = _decoded(source, raw)
        if rates.shape[1:] != (3,):
            raise ValueError("a sample is not three rates")
        # Gyroflow's export of metadata has it beside the samples.
        places = (gyro, metadata, project)
        letters = next((word for place in places if (word := place.get("imu_orientation"))), None)
        cautions = [] if letters else [UNORIENTED]
        # Applied in Gyroflow's order: bias (deg/s, raw axes, added), orientation, rotation (pitch, roll, yaw in deg).
        bias = np.array(gyro.get("gyro_bias") or (0, 0, 0), dtype=np.float64)
        from scipy.spatial.transform import Rotation  # takes 0.25 s to import; only projects need it

        pitch, roll, yaw = gyro.get("rotation") or (0, 0, 0)
        turn = Rotation.from_euler("xyz", (yaw, pitch, roll), degrees=True).as_matrix()
        turn = turn @ orientation(letters or DEFAULT_ORIENTATION)

        return Samples.of_ms(
            source.path,
            t_ms,
            rates + bias * (1.0 if unit == "deg/s" else np.pi / 180),
            unit=unit,
            turn=turn,
            facts={"orientation": letters or DEFAULT_ORIENTATION}
            | readout_of(metadata)
            | readout_of(project.get("stabilization") or {}),
            cautions=cautions,
        )


def _decoded(source: Source, raw: Any) -> tuple[FloatArray, FloatArray, str]:
    """Return the times in ms, the rates, and the unit of the rates."""
    if isinstance(raw, str):
        data = _payload(source, raw)
        count = int.from_bytes(data[:8], "little")
        if 11 * count <= len(data) - 8 <= 83 * count:  # bytes of the samples
            return *_bincode(data, count), "deg/s"
        raw = _cbor(source, data)
    if isinstance(raw[0], Mapping):
        return *vectors(raw, "gyro"), "deg/s"
    # The first versions of Gyroflow, written in Python, saved rows of s and rad/s.
    table = np.array(raw, dtype=np.float64)
    return 1e3 * table[:, 0], table[:, 1:4], "rad/s"


def _payload(source: Source, text: str) -> bytes:
    unpack = zlib.decompressobj()
    limit = unpacked_limit(len(text))
    data = unpack.decompress(base91_decode(text.encode("ascii")), limit)
    if not unpack.eof:
        raise source.error(f"the gyro data of the project are cut off or unpack to more than {limit} bytes")
    return data


def _bincode(data: bytes, count: int) -> tuple[FloatArray, FloatArray]:
    """Decode samples of a time (f64, ms) and three optional vectors (one tag byte each): gyro, accelerometer, ..."""
    place, times, rates = 8, [], []
    for _ in range(count):
        (time,) = struct.unpack_from("<d", data, place)
        place += 8
        for sensor in range(3):
            present = data[place]
            place += 1
            if present > 1:
                raise ValueError(f"byte {place} is not a tag")
            if present:
                if sensor == 0:
                    times.append(time)
                    rates.append(struct.unpack_from("<3d", data, place))
                place += 24
    return np.array(times), np.array(rates).reshape(-1, 3)


def _cbor(source: Source, data: bytes) -> Any:
    try:
        import cbor2
    except ModuleNotFoundError:
        raise source.error(missing("projects of this version of Gyroflow need cbor2", "gyroflow")) from None
    try:
        return cbor2.loads(data)
    except (cbor2.CBORDecodeError, ValueError) as error:
        raise source.error(f"the gyro data of the project are damaged: {error}") from error


def is_lens(source: Source) -> bool:
    """Whether the file is a lens profile or a project of Gyroflow."""
    return source.looks_like_json and (is_profile(source.json) or is_project(source.json))


def is_profile(content: Mapping[str, Any]) -> bool:
    """Whether `content`, read_lens from JSON, is a lens profile."""
    return "calib_dimension" in content or "fisheye_params" in content


def read_lens(source: Source, request: Request) -> CameraFile:
    """Read a lens profile, or the one inside a project."""
    content = source.json
    with source.parsing("the lens profile"):
        return (_profile if is_profile(content) else _project)(source, content, request)


def _profile(source: Source, profile: dict[str, Any], request: Request) -> CameraFile:
    old = profile.get("use_opencv_standard") and not profile.get("use_opencv_fisheye")
    params = profile.get("calib_params" if old else "fisheye_params") or {}
    matrix = np.array(params.get("camera_matrix") or [], dtype=np.float64)
    size = profile.get("calib_dimension") or {}
    width, height = int(size.get("w") or 0), int(size.get("h") or 0)
    if matrix.shape != (3, 3) or not width or not height:
        raise source.error("the profile contains no calibration; describe the camera with: rsdeblur camera new")
    profile = profile | _setting(source, profile, request)
    _refuse_unmodelled(source, profile)
    crop = float(profile.get("crop") or 1.0)
    if not 1e-3 <= crop <= 1e3:
        raise source.error(f"the profile's crop is {crop:g}, but must be from 0.001 to 1000")
    # Gyroflow treats four zeros as no distortion, although the formula gives an equidistant lens.
    k = tuple(float(value) for value in params.get("distortion_coeffs") or ())
    standard = old or profile.get("distortion_model") == "opencv_standard"
    model: Distortion = "none" if not any(k) else "radtan" if standard else "fisheye"
    named = ("camera_brand", "camera_model", "lens_model", "camera_setting", "calibrated_by", "fps")
    facts = {key: profile[key] for key in named if profile.get(key)} | {"calibration_error_px": params.get("RMS_error")}
    timing = {"readout_time_s": 0.0} if profile.get("global_shutter") else readout_of(profile)
    readout_time, assumed = timing.get("readout_time_s"), []
    if readout_time:
        # In the public database they range from 0.01 to 100 ms.
        text = f"the readout time of {1e3 * readout_time:.3g} ms was submitted by a user; treat it as a first guess"
        assumed.append(Assumption("readout_time", text))
    focal_length = matrix[0, 0] / crop, matrix[1, 1] / crop
    doubts = _doubts(profile, width, *focal_length)
    assumed += [Assumption("focal_length", f"{text}; measure it: rsdeblur calibrate") for text in doubts]
    return finished(
        source,
        request,
        "gyroflow-lens",
        assumed,
        facts,
        size=(width, height),
        focal_length=focal_length,
        # For a symmetrical lens Gyroflow ignores the calibrated principal point.
        principal_point=(matrix[0, 2], matrix[1, 2]) if profile.get("asymmetrical") else None,
        readout_time=readout_time,
        readout_direction=timing.get("readout_direction", "top-down"),
        imu_to_camera="gyroflow",
        distortion_model=model,
        distortion=() if model == "none" else k,
        timestamp_marks="middle",
    )


def _doubts(profile: Mapping[str, Any], width: int, fx: float, fy: float) -> Iterator[str]:
    """Yield reasons why the focal lengths of a profile, in px of a picture of this width, are not those of its lens."""
    stretch = max(fx, fy) / min(fx, fy) if fx > 0 < fy else 1.0
    # Pixels of 4:3, and anamorphic lenses.
    if stretch > 1.05 and min(abs(stretch - known) for known in (4 / 3, 1.5, 1.8, 2.0)) > 0.03:
        yield f"the focal lengths along x and y, {fx:.0f} and {fy:.0f} px, differ by more than 5%"
    # The name of a zoom lens contains its range.
    named = re.findall(r"(?<![\d.-])(\d+(?:\.\d+)?) ?mm", f"{profile.get('lens_model')}".lower())
    millimetres = float(profile.get("focal_length") or (named[0] if len(named) == 1 else 0))
    sensor, view = millimetres * width / fx, math.degrees(2 * math.atan(width / 2 / fx))
    if SENSORS[0] < sensor < SENSORS[1]:
        return
    if view < NARROWEST:
        yield f"the focal length of {fx:.0f} px means a field of view of {view:.3g} degrees"
    if millimetres:
        yield f"a focal length of {fx:.0f} px and a lens of {millimetres:g} mm mean a sensor of {sensor:.3g} mm"


def _refuse_unmodelled(source: Source, profile: Mapping[str, Any]) -> None:
    model = profile.get("distortion_model") or "opencv_fisheye"
    if model not in ("opencv_fisheye", "opencv_standard") or profile.get("distortion_model_id") not in (None, 0):
        raise source.error(f"the lens model {model} (id {profile.get('distortion_model_id')}) is not supported")
    bent = profile.get("digital_lens") or ("SuperView" if profile.get("is_superview") else "")
    stretches = [float(profile.get(f"input_{side}_stretch") or 1.0) for side in ("horizontal", "vertical")]
    if bent or stretches != [1.0, 1.0]:
        raise source.error(
            f"the camera bends or stretches the picture ({bent or stretches}), which no lens model describes; record "
            "with a linear or wide setting"
        )


def _setting(source: Source, profile: Mapping[str, Any], request: Request) -> dict[str, Any]:
    """Return the profile's settings for the requested size and frame rate, by default its own; empty if it has none."""
    fps = request.fps or profile.get("fps")
    entries = [
        entry
        for entry in profile.get("compatible_settings") or []
        if (entry.get("width"), entry.get("height")) == request.size
    ]
    near = [entry for entry in entries if fps is None or abs(float(entry.get("fps") or fps) - float(fps)) < 0.5]
    keys = ("crop", "frame_readout_time", "digital_lens")
    found = [{key: entry[key] for key in keys if entry.get(key) is not None} for entry in near or entries]
    if any(setting != found[0] for setting in found):
        rates = ", ".join(sorted({f"{entry.get('fps')}" for entry in entries}))
        raise source.error(f"the settings of this size differ; give the frame rate: {rates}")
    return found[0] if found else {}


def _project(source: Source, project: dict[str, Any], request: Request) -> CameraFile:
    profile = dict(project.get("calibration_data") or {})
    timing = project.get("stabilization") or {}
    for key in ("frame_readout_time", "frame_readout_direction"):
        if timing.get(key) is not None:
            profile[key] = timing[key]
    video = project.get("video_info") or {}
    if request.size is None and video.get("width") and video.get("height"):
        size = int(video["width"]), int(video["height"])
        request = replace(request, size=size, fps=request.fps or video.get("fps"))
    file = _profile(source, profile, request)
    # Video time minus gyro time in ms, of which some versions write a list.
    values = (project.get("offsets") or {}).values()
    offsets = [float(value[0] if isinstance(value, list) else value) / 1e3 for value in values]
    assumptions = list(file.assumptions)
    if offsets and max(offsets) - min(offsets) > 1e-3:
        text = f"the clocks drift by {1e3 * (max(offsets) - min(offsets)):.1f} ms; their mean offset is used"
        assumptions.append(Assumption("time_offset", text))
    if video.get("rotation"):
        text = f"the project turns the video by {video['rotation']:g} degrees; that is not applied"
        assumptions.append(Assumption("", text))
    camera = replace(file.camera, time_offset=float(np.mean(offsets)) if offsets else 0.0)
    return CameraFile(camera, "gyroflow-project", file.facts, tuple(assumptions))


GCSV = Format("gcsv", "Gyroflow .gcsv", is_gcsv, _read_gcsv)
PROJECT = Format(
    "gyroflow", "Gyroflow project", lambda source: source.looks_like_json and is_project(source.json), _read_project
)
