"""Camera files: our own, those of calibration tools, and as a last resort a picture's EXIF block.

To add a format, write its `sniff` and `read` and add them to the table in `formats`.
"""

from __future__ import annotations

import codecs
import os
import re
from functools import partial
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from rsdeblur._util import validate
from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.files import read_file
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.io import kalibr, lens_profiles, recorded_cameras
from rsdeblur.io.camera_file import Assumption, CameraFile, Request
from rsdeblur.io.exif import MAKE, MODEL, ZOOM, Exif
from rsdeblur.io.formats import Format, choose
from rsdeblur.io.pictures import is_picture, read_header
from rsdeblur.io.source import Source
from rsdeblur.motion.camera import Camera

WHAT = "camera file"
DEFAULT = Request()


def read_camera(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    size: tuple[int, int] | None = None,
    name: str | None = None,
    fps: float | None = None,
    focal_length: float | None = None,
    sensor_width: int | None = None,
) -> Camera:
    """Read a camera.

    ==================== ===================================================================================
    ``toml``             rsdeblur's own, described in ``docs/camera-file.md``
    ``gyroflow``         Gyroflow lens profile, or a project that contains one
    ``kalibr``           Kalibr ``camchain-imucam.yaml``, EuRoC ``sensor.yaml``, maplab (extra ``[kalibr]``)
    ``mars``             MARS logger ``movie_metadata.csv``: focal length and readout time; needs `size`
    ``recording``        ``.gcsv`` log or video with telemetry: readout; may need `size` and `focal_length`
    ``exif``             a picture: focal length from EXIF, everything else assumed
    ==================== ===================================================================================

    Parameters
    ----------
    path : path-like
        The file. Its content decides the format; a name that ends in ``.toml`` is enough for a camera file.
    format : str, optional
        Name of the format, from the table above, instead of detection.
    size : (int, int), optional
        Width and height of the picture in px, if they differ from the file's. The picture is assumed to be resized by
        its width and, with another aspect ratio, to be cut at top and bottom.
    name : str, optional
        Name of the camera, where a file contains several (Kalibr: ``"cam1"``).
    fps : float, optional
        Frame rate in Hz, where a lens profile contains several settings of one size.
    focal_length : float, optional
        Focal length in px of the picture; replaces the file's.
    sensor_width : int, optional
        Width of the whole sensor in px, if the focal length of MARS logger refers to it.

    Returns
    -------
    Camera
        The camera of a picture of that size.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is damaged or of no known format, lacks a value that is needed, has no camera
        `name`, or describes a lens that is not modelled; if `format` is not the name of a format; or if an optional
        package is needed and not installed.
    InputError
        If `size` is not the size of a picture, or `focal_length` or `sensor_width` is not positive.

    Warns
    -----
    RsdeblurWarning
        For each value that is assumed because the file does not contain it.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.Camera(640, 480, 500.0, readout_time=0.03).save("phone.toml")
    >>> rsdeblur.read_camera("phone.toml").readout_time
    0.03
    """
    file = open_camera(
        path, format, size=size, name=name, fps=fps, focal_length=focal_length, sensor_width=sensor_width
    )
    return file.warn(path)


def open_camera(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    size: tuple[int, int] | None = None,
    name: str | None = None,
    fps: float | None = None,
    focal_length: float | None = None,
    sensor_width: int | None = None,
) -> CameraFile:
    """Read a camera with the other content of its file; assumptions are returned instead of warned about.

    Parameters
    ----------
    path, format, size, name, fps, focal_length, sensor_width
        See `read_camera`.

    Returns
    -------
    CameraFile
        The camera, its file's format, facts for reports, and the assumptions.

    Raises
    ------
    FileFormatError, InputError
        See `read_camera`.
    """
    if size is not None:
        if not (isinstance(size, (tuple, list)) and len(size) == 2):
            raise InputError(f"size must be (width, height) in px, got {validate.shown(size)}")
        width, height = size
        # A size of zero has no aspect ratio.
        size = validate.count("size", width), validate.count("size", height)
    if focal_length is not None:
        focal_length = validate.finite("focal_length", focal_length, above=0.0)
    if sensor_width is not None:
        sensor_width = validate.count("sensor_width", sensor_width)
    source = Source(path, WHAT)
    request = Request(size, name, fps, focal_length, sensor_width)
    file = choose(formats(request), source, format).read(source)
    return file if focal_length is None else file.with_overrides(focal_length=(focal_length, focal_length))


def detect_camera_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format as which `read_camera` would read the file."""
    return choose(formats(), Source(path, WHAT)).name


def check_editable(path: str | os.PathLike[str]) -> None:
    """Check that `write_time_offset` can edit a file, before the work that finds the offset."""
    try:
        Camera.load(path)
    except FileFormatError as error:
        format = open_camera(path).format
        if format == "toml":
            raise
        raise FileFormatError(
            f"{path}: a file of the format {format} has no place for the time offset; make a camera file of it: "
            f"rsdeblur camera import {path} -o camera.toml"
        ) from error


def write_time_offset(path: str | os.PathLike[str], time_offset: float) -> None:
    """Write `time_offset` into a camera file, whose other lines stay as they are, down to their line ends."""
    time_offset = validate.finite("time_offset", time_offset)
    check_editable(path)
    data = read_file(path, "camera file")
    text = data.removeprefix(codecs.BOM_UTF8).decode()
    try:
        document = tomlkit.parse(text)
    except (TOMLKitError, RecursionError) as error:
        raise FileFormatError(f"{path}: cannot edit the file ({error}); set time_offset = {time_offset!r}") from error
    document["time_offset"] = time_offset
    changed = tomlkit.dumps(document)
    if text.count("\n") == text.count("\r\n") > 0:
        # A new line ends with a line feed alone.
        changed = re.sub("(?<!\r)\n", "\r\n", changed)
    with atomic_write(path) as file:
        file.write(codecs.BOM_UTF8 * data.startswith(codecs.BOM_UTF8) + changed.encode())


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
        raise source.error(
            f"it is a picture, and its {error}; give a camera file, calibrate the camera, or give its focal length: "
            "rsdeblur camera new"
        ) from error
    assumptions = [
        Assumption(
            "focal_length",
            f"the focal length of {focal_length:.0f} px is estimated from EXIF ({origin}), to a few percent at best",
        ),
        Assumption(
            "readout_time", "EXIF does not contain the readout time: 0 is assumed; give it if the shutter rolls"
        ),
        Assumption("imu_to_camera", f"EXIF does not contain the axes of the gyro: {axes} is assumed"),
    ]
    zoom = exif.number(ZOOM)
    if zoom and zoom > 1:
        text = f"the picture was zoomed {zoom:.3g} times digitally; the 35 mm equivalent may or may not include that"
        assumptions.append(Assumption("focal_length", text))
    facts: dict[str, Any] = {"make": exif.text(MAKE), "model": exif.text(MODEL), "orientation": exif.orientation}
    facts["exposure_s"] = exif.exposure
    file = CameraFile(camera, "exif", {key: value for key, value in facts.items() if value}, tuple(assumptions))
    return file.fitted(request.size)


def formats(request: Request = DEFAULT) -> tuple[Format[CameraFile], ...]:
    """Return the formats, whose readers follow `request`."""
    return tuple(
        Format(name, title, sniff, partial(read, request=request))
        for name, title, sniff, read in (
            ("exif", "picture with an EXIF block", is_picture, _read_exif),
            ("gyroflow", "Gyroflow lens profile or project", lens_profiles.sniff, lens_profiles.read),
            ("kalibr", "Kalibr, EuRoC or maplab YAML", kalibr.sniff, kalibr.read),
            ("mars", "MARS logger movie_metadata.csv", recorded_cameras.sniff_mars, recorded_cameras.read_mars),
            ("recording", ".gcsv log or video with telemetry", recorded_cameras.sniff_log, recorded_cameras.read_log),
            ("toml", "TOML, see docs/camera-file.md", _sniff_toml, _read_toml),
        )
    )
