"""Cameras of calibration tools: Kalibr's chains, EuRoC's sensor files and maplab's camera systems, all YAML."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from rsdeblur.choices import Distortion
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.io.camera_file import Assumption, CameraFile, Request
from rsdeblur.io.source import Source
from rsdeblur.motion.camera import Camera
from rsdeblur.types import FloatArray

# Hardly any lens has its principal point that far off the middle, as a share of the picture's side.
OFF_CENTRE = 0.1
MODELS: dict[str, Distortion] = {
    "radtan": "radtan",
    "radial-tangential": "radtan",
    "plumb_bob": "radtan",
    "equidistant": "fisheye",
    "equi": "fisheye",
    "kannala_brandt4": "fisheye",
    "none": "none",
}
# Calibrations have a few thousand characters and a few hundred values.
LONGEST, MOST_VALUES = 100_000, 10_000
CAMERA_NAME = re.compile(r"cam\d+")


def sniff(source: Source) -> bool:
    """Whether this is such a file."""
    if not source.looks_like_text or source.looks_like_json:
        return False
    keys = r"^[ \t]*(-[ \t]*)?(cam\d+|cameras|camera_model|T_cam_imu)\s*:"
    return re.search(keys, source.text.start, re.MULTILINE) is not None


def read(source: Source, request: Request) -> CameraFile:
    """Read one camera of the file, the first one unless `request` names another.

    Raises
    ------
    FileFormatError
        If the file is no such YAML, has no such camera, or one of a model that is not supported.
    """
    content = _load(source)
    name = request.name or "the file"
    try:
        cameras = _cameras(source, content)
        name = request.name or next(iter(cameras))
        if name not in cameras:
            raise source.error(f"there is no camera {name!r} in the file, only {', '.join(cameras)}")
        assumptions: list[Assumption] = []
        if request.name is None and len(cameras) > 1:
            assumptions.append(
                Assumption("", f"the file has {len(cameras)} cameras ({', '.join(cameras)}); {name} is taken")
            )
        camera = _camera(source, cameras[name], assumptions)
        return CameraFile(camera, "kalibr", {"camera": name}, tuple(assumptions)).fitted(request.size)
    except FileFormatError:
        raise
    except InputError as error:
        raise source.error(f"{name}: {error}") from error
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise source.error(f"{name} is damaged or incomplete: {error!r}") from error


def _load(source: Source) -> Any:
    try:
        import yaml
    except ModuleNotFoundError:
        raise source.error("YAML files need PyYAML; install it with: pip install 'rsdeblur[kalibr]'") from None
    # OpenCV's header is no YAML directive, and its matrices have a tag of their own.
    lines = [line for line in source.text.lines if not line.startswith("%")]
    text = re.sub(r"!!opencv-matrix", "", "\n".join(lines))
    if len(text) > LONGEST:
        raise source.error(f"a camera's YAML has no {len(text)} characters; give the file of the calibration's results")

    class Loader(yaml.SafeLoader):
        """Counts what aliases stand for: a few lines of them may mean more than fits into memory."""

        def __init__(self, text: str) -> None:
            super().__init__(text)
            self.values, self.sizes = 0, dict[yaml.Node | None, int]()

        def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
            known, before = self.check_event(yaml.AliasEvent), self.values
            node = super().compose_node(parent, index)
            # One that is not counted yet is within itself.
            self.values += self.sizes.get(node, MOST_VALUES) if known else 1
            if self.values > MOST_VALUES:
                raise yaml.YAMLError(f"it stands for more than {MOST_VALUES} values, counting those of aliases")
            if not known:
                self.sizes[node] = self.values - before
            return node

    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        raise source.error(f"not YAML: {' '.join(str(error).split())}") from error


def _cameras(source: Source, content: Any) -> dict[str, dict[str, Any]]:
    """Return the cameras by name, as Kalibr writes them."""
    found: dict[str, dict[str, Any]] = {}
    if isinstance(content, dict) and "camera_model" in content:
        found = {"cam0": content}
    elif isinstance(content, dict) and isinstance(content.get("cameras"), list):
        for i, entry in enumerate(content["cameras"]):
            if isinstance(entry, dict):
                # maplab puts what is the camera's own one level deeper, with hyphens and other names.
                found[f"cam{i}"] = _of_maplab(entry | (entry.get("camera") or {}))
    elif isinstance(content, dict):
        found = {key: value for key, value in content.items() if CAMERA_NAME.fullmatch(str(key))}
    if not found or not all(isinstance(camera, dict) for camera in found.values()):
        raise source.error("the file describes no camera: cam0 with intrinsics and resolution expected")
    return found


def _of_maplab(entry: dict[str, Any]) -> dict[str, Any]:
    distortion = entry.get("distortion") or {"type": "none"}
    renamed = {
        "camera_model": entry.get("type", "pinhole"),
        "intrinsics": entry.get("intrinsics"),
        "resolution": [entry.get("image_width"), entry.get("image_height")],
        "distortion_model": distortion.get("type", "none"),
        "distortion_coeffs": distortion.get("parameters", []),
        "line_delay": float(entry.get("line-delay-nanoseconds") or 0) * 1e-9,
    }
    return renamed | ({"T_BS": entry["T_B_C"]} if "T_B_C" in entry else {})


def _camera(source: Source, entry: dict[str, Any], assumptions: list[Assumption]) -> Camera:
    model = str(entry.get("camera_model", "pinhole"))
    if not model.startswith("pinhole"):
        raise source.error(f"the camera model {model!r} is not supported, only pinhole; calibrate with pinhole-equi")
    kind = str(entry.get("distortion_model") or "none").lower()
    if kind not in MODELS:
        raise source.error(f"the distortion model {kind!r} is not supported, only {', '.join(MODELS)}")
    fx, fy, cx, cy = _numbers(entry["intrinsics"])
    width, height = (int(size) for size in _numbers(entry["resolution"]))
    given, swapped = _decentred(cx / width, cy / height), _decentred(cx / height, cy / width)
    if given >= 0.5 > swapped or (given > OFF_CENTRE and swapped < given / 2):
        width, height = height, width
        assumptions.append(
            Assumption("", f"the resolution was swapped to {width}x{height}, where the principal point fits")
        )
    delay = float(entry.get("line_delay") or 0.0)
    if delay == 0:
        text = "the file has no line_delay, so a global shutter is taken; give the readout if the shutter rolls"
        assumptions.append(Assumption("readout_time", text))
    coefficients = entry.get("distortion_coeffs", entry.get("distortion_coefficients", []))
    return Camera(
        width,
        height,
        (fx, fy),
        (cx, cy),
        readout_time=delay * height,
        imu_to_camera=_imu_to_camera(entry, assumptions),
        # t_imu = t_cam + shift
        time_offset=0.0 - float(entry.get("timeshift_cam_imu") or 0.0),
        distortion_model=MODELS[kind],
        distortion=() if MODELS[kind] == "none" else _numbers(coefficients),
    )


def _decentred(x: float, y: float) -> float:
    """How far from the middle a point is, given as shares of the sides."""
    return max(abs(x - 0.5), abs(y - 0.5))


def _imu_to_camera(entry: dict[str, Any], assumptions: list[Assumption]) -> FloatArray:
    """Rotation part of the transformation, which files give either way round."""
    if "T_cam_imu" in entry:
        return _rotation(entry["T_cam_imu"])
    for inverse in ("T_imu_cam", "T_ic", "T_BS"):
        if inverse in entry:
            return _rotation(entry[inverse]).T
    text = "the file does not say how the IMU sits (no T_cam_imu): its axes are taken as the camera's"
    assumptions.append(Assumption("imu_to_camera", text))
    return np.eye(3)


def _rotation(value: Any) -> FloatArray:
    numbers = _numbers(value)
    side = {9: 3, 12: 4, 16: 4}[len(numbers)]
    return np.array(numbers).reshape(-1, side)[:3, :3]


def _numbers(value: Any) -> list[float]:
    """Return the numbers of a list, a list of lists, or OpenCV's matrix; YAML leaves `1e-5` as text."""
    if isinstance(value, dict):
        value = value["data"]
    if isinstance(value, list):
        return [number for item in value for number in (_numbers(item) if isinstance(item, list) else [float(item)])]
    raise ValueError(f"{value!r} is no list of numbers")
