"""Cameras of Gyroflow: lens profiles, and the profile inside a project."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rsdeblur.choices import Distortion
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.io.camera_file import Assumption, CameraFile, Request
from rsdeblur.io.gyroflow import is_project, offset_ms, readout_of
from rsdeblur.io.source import Source
from rsdeblur.motion import lens
from rsdeblur.motion.camera import Camera

# Readout times of real sensors, s. Those in the public database range from 0.01 to 100 ms.
PLAUSIBLE_READOUT = (0.002, 0.050)
# Smallest crop, a divisor of the focal length; the largest is its inverse.
SMALLEST_CROP = 1e-3


def sniff(source: Source) -> bool:
    """Whether the file is a lens profile or a project of Gyroflow."""
    if not source.looks_like_json or not isinstance(source.json, dict):
        return False
    return is_profile(source.json) or is_project(source.json)


def is_profile(content: Mapping[str, Any]) -> bool:
    """Whether `content`, read from JSON, is a lens profile."""
    return "calib_dimension" in content or "fisheye_params" in content


def read(source: Source, request: Request) -> CameraFile:
    """Read a lens profile, or the one inside a project."""
    content = source.json
    if not isinstance(content, dict) or not (is_profile(content) or is_project(content)):
        raise source.error("neither a lens profile nor a project of Gyroflow")
    try:
        if is_profile(content):
            return _profile(source, content, request)
        return _project(source, content, request)
    except FileFormatError:
        raise
    except InputError as error:
        raise source.error(str(error)) from error
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError) as error:
        raise source.error(f"the lens profile is damaged: {error!r}") from error


def _profile(source: Source, profile: dict[str, Any], request: Request) -> CameraFile:
    old = profile.get("use_opencv_standard") and not profile.get("use_opencv_fisheye")
    params = profile.get("calib_params" if old else "fisheye_params") or {}
    matrix = np.array(params.get("camera_matrix") or [], dtype=np.float64)
    size = profile.get("calib_dimension") or {}
    width, height = int(size.get("w") or 0), int(size.get("h") or 0)
    if matrix.shape != (3, 3) or not width or not height:
        raise source.error("the profile contains no calibration; describe the camera with: rsdeblur camera new")
    setting = _setting(source, profile, request)
    _refuse_unmodelled(source, profile | setting)
    crop = float((profile | setting).get("crop") or 1.0)
    if not SMALLEST_CROP <= crop <= 1 / SMALLEST_CROP:
        raise source.error(
            f"the profile's crop is {crop:g}, but must be from {SMALLEST_CROP:g} to {1 / SMALLEST_CROP:g}"
        )
    asymmetrical = profile.get("asymmetrical", False)
    timing = readout_of(profile | setting)
    global_shutter = bool(profile.get("global_shutter"))
    # Gyroflow treats four zeros as no distortion, although the formula gives an equidistant lens.
    k = tuple(float(value) for value in params.get("distortion_coeffs") or ())
    standard = old or profile.get("distortion_model") == "opencv_standard"
    model: Distortion = "none" if not any(k) else "radtan" if standard else "fisheye"
    camera = Camera(
        width,
        height,
        (matrix[0, 0] / crop, matrix[1, 1] / crop),
        # For a symmetrical lens Gyroflow ignores the calibrated principal point.
        (matrix[0, 2], matrix[1, 2]) if asymmetrical else None,
        readout_time=0.0 if global_shutter else timing.get("readout_time_s", 0.0),
        readout_direction=timing.get("readout_direction", "top-down"),
        imu_to_camera="gyroflow",
        distortion_model=model,
        distortion=() if model == "none" else k,
        timestamp_marks="middle",
    )
    named = ("camera_brand", "camera_model", "lens_model", "camera_setting", "calibrated_by", "fps")
    facts = {key: profile[key] for key in named if profile.get(key)} | {"calibration_error_px": params.get("RMS_error")}
    assumptions = _readout_assumptions(camera.readout_time, global_shutter)
    corner = float(np.hypot(width / 2 / camera.focal_length[0], height / 2 / camera.focal_length[1]))
    if model == "fisheye" and corner > lens.reach(k):
        text = "the calibration does not reach the picture's corners, where the lens model is extrapolated"
        assumptions += (Assumption("distortion", text),)
    return CameraFile(camera, "gyroflow-lens", facts, assumptions).fitted(request.size)


def _readout_assumptions(readout_time: float, global_shutter: bool) -> tuple[Assumption, ...]:
    if global_shutter:
        return ()
    low, high = PLAUSIBLE_READOUT
    text = f"the readout time of {1e3 * readout_time:.3g} ms was submitted by a user; treat it as a first guess"
    if readout_time == 0:
        text = "the profile does not contain the readout time: 0 is assumed; give it if the shutter rolls"
    elif not low <= readout_time <= high:
        text = f"the readout time of {1e3 * readout_time:.3g} ms is implausible; users submit these, so measure it"
    return (Assumption("readout_time", text),)


def _refuse_unmodelled(source: Source, profile: Mapping[str, Any]) -> None:
    model = profile.get("distortion_model") or "opencv_fisheye"
    if model not in ("opencv_fisheye", "opencv_standard") or profile.get("distortion_model_id") not in (None, 0):
        raise source.error(f"the lens model {model} (id {profile.get('distortion_model_id')}) is not supported")
    if profile.get("digital_lens") or profile.get("is_superview"):
        raise source.error(
            f"the camera bends the picture digitally ({profile.get('digital_lens') or 'SuperView'}), "
            "which no lens model describes; record with a linear or wide setting"
        )
    for key in ("input_horizontal_stretch", "input_vertical_stretch"):
        if float(profile.get(key) or 1.0) != 1.0:
            raise source.error(f"the profile stretches the picture ({key} {profile[key]}), which is not supported")


def _setting(source: Source, profile: Mapping[str, Any], request: Request) -> dict[str, Any]:
    """Return the profile's settings for the requested size and frame rate; empty if it has none."""
    if request.size is None:
        return {}
    entries = [
        entry
        for entry in profile.get("compatible_settings") or []
        if (entry.get("width"), entry.get("height")) == request.size
    ]
    keys = ("crop", "frame_readout_time", "digital_lens")

    def settings(fps: float | None) -> list[dict[str, Any]]:
        fits = [entry for entry in entries if fps is None or abs(float(entry.get("fps") or fps) - fps) < 0.5]
        return [{key: entry[key] for key in keys if entry.get(key) is not None} for entry in fits]

    matches = settings(request.fps)
    if any(setting != matches[0] for setting in matches):
        # The frame rate of the profile itself is the likely one.
        matches = settings(profile.get("fps"))
    if not matches or any(setting != matches[0] for setting in matches):
        if not entries:
            return {}
        rates = ", ".join(sorted({f"{entry.get('fps')}" for entry in entries}))
        raise source.error(f"the settings of {request.size[0]}x{request.size[1]} differ; give the frame rate: {rates}")
    return matches[0]


def _project(source: Source, project: dict[str, Any], request: Request) -> CameraFile:
    profile = dict(project.get("calibration_data") or {})
    timing = project.get("stabilization") or {}
    for key in ("frame_readout_time", "frame_readout_direction"):
        if timing.get(key) is not None:
            profile[key] = timing[key]
    video = project.get("video_info") or {}
    if request.size is None and video.get("width") and video.get("height"):
        request = Request((int(video["width"]), int(video["height"])), fps=request.fps or video.get("fps"))
    file = _profile(source, profile, request)
    offsets = [offset_ms(value) / 1e3 for value in (project.get("offsets") or {}).values()]
    assumptions = file.assumptions
    if offsets and max(offsets) - min(offsets) > 1e-3:
        text = f"the clocks drift by {1e3 * (max(offsets) - min(offsets)):.1f} ms; their mean offset is used"
        assumptions += (Assumption("time_offset", text),)
    if video.get("rotation"):
        assumptions += (
            Assumption("", f"the project turns the video by {video['rotation']:g} degrees; that is not applied"),
        )
    camera = file.camera.delayed(float(np.mean(offsets)) if offsets else 0.0)
    return CameraFile(camera, "gyroflow-project", file.facts, assumptions)
