"""Camera files: our own, those of calibration tools, and as a last resort a picture's EXIF block.

To add a format, write its `sniff` and `read` and append a `CameraFormat` to `FORMATS`.
"""

from __future__ import annotations

import os
import re
from functools import partial
from typing import Any

from rsdeblur.errors import InputError
from rsdeblur.io import kalibr, lens_profiles
from rsdeblur.io.camera_file import Assumption, CameraFile, Request
from rsdeblur.io.exif import MAKE, MODEL, ZOOM, Exif
from rsdeblur.io.formats import Format, choose
from rsdeblur.io.pictures import is_picture, read_header
from rsdeblur.io.source import Source
from rsdeblur.motion.camera import Camera

WHAT = "camera file"


def read_camera(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    size: tuple[int, int] | None = None,
    name: str | None = None,
    fps: float | None = None,
) -> Camera:
    """Read a camera.

    ==================== ===================================================================================
    ``toml``             our own, described in ``docs/camera-file.md``
    ``gyroflow``         Gyroflow lens profile, or a project that contains one
    ``kalibr``           Kalibr ``camchain-imucam.yaml``, EuRoC ``sensor.yaml``, maplab (extra ``[kalibr]``)
    ``exif``             a picture: its focal length by EXIF, everything else assumed
    ==================== ===================================================================================

    Parameters
    ----------
    path : path-like
        The file. The format is told from the content.
    format : str, optional
        Name of the format instead of detection.
    size : (int, int), optional
        Width and height of the picture, if it is not the file's: of the same shape it is taken as resized, otherwise
        as cut out of the middle.
    name : str, optional
        Which camera of a file with several (Kalibr: ``"cam1"``).
    fps : float, optional
        Frame rate, where a lens profile has several settings of one size.

    Returns
    -------
    Camera

    Raises
    ------
    FileFormatError
        If the file cannot be read or is of no known format, lacks what is needed, or describes a lens that is not
        modelled.

    Warns
    -----
    RsdeblurWarning
        For each thing that was assumed because the file does not say it.
    """
    return open_camera(path, format, size=size, name=name, fps=fps).warn(path)


def open_camera(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    size: tuple[int, int] | None = None,
    name: str | None = None,
    fps: float | None = None,
) -> CameraFile:
    """Read a camera with what its file says about it, without warnings; see `read_camera`."""
    source = Source(path, WHAT)
    request = Request(size, name, fps)
    chosen = choose(_formats(request), source, format)
    return chosen.read(source)


def detect_camera_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format `read_camera` would read the file as.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is of no known format.
    """
    return choose(_formats(Request()), Source(path, WHAT)).name


def _sniff_toml(source: Source) -> bool:
    if source.path.suffix.lower() == ".toml":
        return True
    keys = re.compile(r"^[ \t]*(width|height|focal_length)[ \t]*=", re.MULTILINE)
    return source.looks_like_text and keys.search(source.text.start) is not None


def _read_toml(source: Source, request: Request) -> CameraFile:
    return CameraFile(Camera.load(source.path), "toml").fitted(request.size)


def _read_exif(source: Source, request: Request) -> CameraFile:
    width, height, block = read_header(source.path)
    exif = Exif(block)
    axes = "phone-landscape" if width >= height else "phone-portrait"
    try:
        focal_length, origin = exif.focal_px(width, height)
        camera = Camera(width, height, focal_length, imu_to_camera=axes)
    except InputError as error:
        raise source.error(f"{error}; calibrate the camera, or give its focal length: rsdeblur camera new") from error
    assumptions = [
        Assumption(
            "focal_length",
            f"the focal length of {focal_length:.0f} px is estimated from EXIF ({origin}), within some percent at best",
        ),
        Assumption("readout_time", "EXIF does not tell the readout time, and 0 is taken; give it if the shutter rolls"),
        Assumption("imu_to_camera", f"EXIF does not tell how the gyro sits, and {axes} is taken"),
    ]
    zoom = exif.number(ZOOM)
    if zoom and zoom > 1:
        text = f"the picture was zoomed {zoom:.3g} times; the 35 mm equivalent may or may not include it"
        assumptions.append(Assumption("focal_length", text))
    facts: dict[str, Any] = {"make": exif.text(MAKE), "model": exif.text(MODEL), "orientation": exif.orientation}
    facts["exposure_s"] = exif.exposure
    file = CameraFile(camera, "exif", {key: value for key, value in facts.items() if value}, tuple(assumptions))
    return file.fitted(request.size)


def _formats(request: Request) -> tuple[Format[CameraFile], ...]:
    """Return the formats, to be read as `request` says."""
    return tuple(
        Format(name, title, sniff, partial(read, request=request))
        for name, title, sniff, read in (
            ("exif", "picture with an EXIF block", is_picture, _read_exif),
            ("gyroflow", "Gyroflow lens profile or project", lens_profiles.sniff, lens_profiles.read),
            ("kalibr", "Kalibr, EuRoC or maplab YAML", kalibr.sniff, kalibr.read),
            ("toml", "TOML, see docs/camera-file.md", _sniff_toml, _read_toml),
        )
    )
