"""Cameras of calibration tools: YAML of Kalibr, EuRoC, maplab and VINS-Fusion, and DSO's `camera.txt`."""

import math
import re
from typing import Any

import numpy as np

from rsdeblur._util.validate import missing
from rsdeblur.choices import Distortion
from rsdeblur.io.camera_file import Assumption, CameraFile, Request, finished
from rsdeblur.io.source import Source
from rsdeblur.motion import lens
from rsdeblur.types import FloatArray

MODELS: dict[str, Distortion] = {
    **dict.fromkeys(("radtan", "radial-tangential", "plumb_bob"), "radtan"),
    **dict.fromkeys(("equidistant", "equi", "kannala_brandt4"), "fisheye"),
    "none": "none",
}
# Names of the transformation from IMU to camera axes, and of its inverse: Kalibr, ADVIO; OpenVINS, EuRoC, maplab, VINS.
FORWARD, INVERSE = ("T_cam_imu", "T_C_B"), ("T_imu_cam", "T_ic", "T_BS", "T_B_C", "body_T_cam0", "extrinsicRotation")
# The first three lines of DSO's files: a lens, the size of its pictures, and how they are rectified.
DSO = re.compile(
    r"(?i)\s*([a-z]*)\s*((?:[-+.\de]+[ \t]+){4,7}[-+.\de]+)\s*\n\s*(\d+)[ \t]+(\d+)\s*\n\s*(crop|full|none|[.\d]+ )"
)
MOST_ALIASES = 20  # calibrations have a few


def sniff(source: Source) -> bool:
    """Whether the file is YAML of one of these tools."""
    if not source.looks_like_text or source.looks_like_json:
        return False
    keys = r"^[ \t]*(-[ \t]*)?(cam\d+|cam0_calib|cameras|camera_model|model_type|T_cam_imu)\s*:"
    return re.search(keys, source.start, re.MULTILINE) is not None


def read(source: Source, request: Request) -> CameraFile:
    """Read one camera of the file, the first one unless `request` names another."""
    cameras = _cameras(source, _load(source))
    name = request.name or next(iter(cameras))
    if name not in cameras:
        raise source.error(f"there is no camera {name!r} in the file, only {', '.join(cameras)}")
    assumptions: list[Assumption] = []
    if request.name is None and len(cameras) > 1:
        text = f"the file has {len(cameras)} cameras ({', '.join(cameras)}); {name} is used"
        assumptions.append(Assumption("", text))
    with source.parsing(name):
        fields = _camera(source, cameras[name], assumptions)
        return finished(source, request, "kalibr", assumptions, {"camera": name}, **fields)


def _load(source: Source) -> Any:
    try:
        import yaml
    except ModuleNotFoundError:
        raise source.error(missing("YAML files need PyYAML", "kalibr")) from None
    # OpenCV writes a header that is not a YAML directive, and marks its matrices with a tag.
    lines = [line for line in source.lines if not line.startswith("%")]
    text = re.sub(r"!!opencv-matrix", "", "\n".join(lines))
    try:
        # A few lines of nested aliases may expand beyond the memory.
        if sum(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader)) > MOST_ALIASES:
            raise ValueError(f"it contains more than {MOST_ALIASES} aliases")
        return yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise source.error(f"not YAML: {' '.join(str(error).split())}") from error


def _cameras(source: Source, content: Any) -> dict[str, dict[str, Any]]:
    """Return the cameras by name, each in Kalibr's form."""
    content = content if isinstance(content, dict) else {}
    if "cam0_calib" in content:
        raise source.error(f"the camera is in another file: give {content['cam0_calib']}")
    with source.parsing("the cameras"):
        if "camera_model" in content:
            cameras = {"cam0": content}
        elif "model_type" in content:
            cameras = {"cam0": _of_vins(content)}
        elif isinstance(content.get("cameras"), list):
            # maplab has the keys of the camera one level deeper, under other names and with hyphens.
            entries = (entry | (entry.get("camera") or {}) for entry in content["cameras"])
            cameras = {f"cam{i}": _of_maplab(entry) for i, entry in enumerate(entries)}
        else:
            cameras = {key: value for key, value in content.items() if re.fullmatch(r"cam\d+", str(key))}
    if not cameras or not all(isinstance(camera, dict) for camera in cameras.values()):
        raise source.error("the file describes no camera; expected cam0 with intrinsics and resolution")
    return cameras


def _of_maplab(entry: dict[str, Any]) -> dict[str, Any]:
    distortion = entry.get("distortion") or {"type": "none"}
    return entry | {
        "camera_model": entry.get("type", "pinhole"),
        "intrinsics": entry.get("intrinsics"),
        "resolution": [entry.get("image_width"), entry.get("image_height")],
        "distortion_model": distortion.get("type", "none"),
        "distortion_coeffs": distortion.get("parameters", []),
        "line_delay": float(entry.get("line-delay-nanoseconds") or 0) * 1e-9,
    }


def _of_vins(entry: dict[str, Any]) -> dict[str, Any]:
    model, projection = str(entry["model_type"]), entry["projection_parameters"]
    keys, kind = "fx fy cx cy k1 k2 p1 p2", "radtan"
    if model == "KANNALA_BRANDT":  # Its k2 is the factor of the angle's third power.
        model, keys, kind = "PINHOLE", "mu mv u0 v0 k2 k3 k4 k5", "equidistant"
    values = projection | (entry.get("distortion_parameters") or {})
    readout_time = entry.get("rolling_shutter") and entry.get("rolling_shutter_tr")
    return entry | {
        "camera_model": model.lower(),
        "intrinsics": [values.get(key) for key in keys.split()[:4]],
        "resolution": [entry["image_width"], entry["image_height"]],
        "distortion_model": kind,
        "distortion_coeffs": [values.get(key, 0.0) for key in keys.split()[4:]],
        "line_delay": float(readout_time or 0.0) / float(entry["image_height"]),
        "timeshift_cam_imu": entry.get("td"),
    }


def _camera(source: Source, entry: dict[str, Any], assumptions: list[Assumption]) -> dict[str, Any]:
    model = str(entry.get("camera_model", "pinhole"))
    if not model.startswith("pinhole"):
        raise source.error(f"the camera model {model!r} is not supported, only pinhole; calibrate with pinhole-equi")
    kind = str(entry.get("distortion_model") or "none").lower()
    if kind not in MODELS:
        raise source.error(f"the distortion model {kind!r} is not supported, only {', '.join(MODELS)}")
    fx, fy, cx, cy = _numbers(entry["intrinsics"])
    width, height = (int(size) for size in _numbers(entry["resolution"]))
    # Distance of the principal point from the middle, in shares of the sides.
    upright, swapped = (max(abs(cx / w - 0.5), abs(cy / h - 0.5)) for w, h in ((width, height), (height, width)))
    # Hardly any principal point is further from the middle than a tenth of the picture's side.
    if upright >= 0.5 > swapped or (upright > 0.1 and swapped < upright / 2):
        width, height = height, width
        assumptions.append(
            Assumption("", f"the resolution was swapped to {width}x{height}, which fits the principal point")
        )
    coefficients = entry.get("distortion_coeffs", entry.get("distortion_coefficients", []))
    delay = float(entry.get("line_delay") or 0.0)
    if delay == 0 and "rolling_shutter" not in entry:
        text = "the file has no line delay: a global shutter is assumed; give the readout time if the shutter rolls"
        assumptions.append(Assumption("readout_time", text))
    return {
        "size": (width, height),
        "focal_length": (fx, fy),
        "principal_point": (cx, cy),
        "readout_time": delay * height,
        "imu_to_camera": _imu_to_camera(entry, assumptions),
        # t_imu = t_cam + shift
        "time_offset": 0.0 - float(entry.get("timeshift_cam_imu") or 0.0),
        "distortion_model": MODELS[kind],
        "distortion": () if MODELS[kind] == "none" else _numbers(coefficients),
    }


def _imu_to_camera(entry: dict[str, Any], assumptions: list[Assumption]) -> FloatArray:
    """Return the rotation from IMU to camera axes; files contain the transformation or its inverse."""
    for key in (*FORWARD, *INVERSE):
        if key in entry:
            numbers = _numbers(entry[key])
            side = {9: 3, 12: 4, 16: 4}[len(numbers)]
            rotation = np.array(numbers).reshape(-1, side)[:3, :3]
            return rotation if key in FORWARD else rotation.T
    text = f"the file has no axes of the IMU ({', '.join((*FORWARD, *INVERSE))}): those of the camera are assumed"
    assumptions.append(Assumption("imu_to_camera", text))
    return np.eye(3)


def _numbers(value: Any) -> list[float]:
    """Return the numbers of a list, a list of lists, or OpenCV's matrix; YAML leaves `1e-5` as text."""
    if isinstance(value, dict):
        value = value["data"]
    if isinstance(value, list):
        return [number for item in value for number in (_numbers(item) if isinstance(item, list) else [float(item)])]
    raise ValueError(f"{value!r} is not a list of numbers")


def sniff_dso(source: Source) -> bool:
    """Whether the file is DSO's."""
    return source.looks_like_text and DSO.match(source.start) is not None


def read_dso(source: Source, request: Request) -> CameraFile:
    """Read the camera of the pictures before DSO rectifies them."""
    name, lens_text, *size, _ = DSO.findall(source.start)[0]
    with source.parsing("the camera"):
        width, height, fx, fy, cx, cy, *k = map(float, (*size, *lens_text.split()))
        if max(cx, cy) < 1:
            fx, fy, cx, cy = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
        model: Distortion = "fisheye" if name.lower() in ("equidistant", "kannalabrandt") else "radtan"
        if len(k) == 1 and k[0]:
            model, (scale, *k) = "fisheye", lens.fisheye_of_fov(k[0], math.hypot(width / fx, height / fy) / 2)
            fx, fy = scale * fx, scale * fy
    fields: dict[str, Any] = {"size": (int(width), int(height)), "focal_length": (fx, fy), "principal_point": (cx, cy)}
    fields |= {"distortion_model": model, "distortion": k} if any(k) else {}
    assumptions: list[Assumption] = []
    axes = _imu_to_camera({}, assumptions)
    return finished(source, request, "dso", assumptions, {}, readout_time=None, imu_to_camera=axes, **fields)
