"""Camera files: our own, those of calibration tools, what recordings contain, and as a last resort EXIF.

To add a format, write its `sniff` and `read` and append a `Format` to `FORMATS`.
"""

import math
import os
import re
import warnings
from typing import Any

import numpy as np
import tomlkit

from rsdeblur._util.files import atomic_write, ffmpeg_input, read_file
from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io import gyroflow, kalibr
from rsdeblur.io.camera_file import Assumption, CameraFile, Request, finished
from rsdeblur.io.columns import Cell
from rsdeblur.io.formats import Format, choose
from rsdeblur.io.gyro_binary import is_video
from rsdeblur.io.gyro_logs import open_gyro
from rsdeblur.io.gyroflow import is_gcsv
from rsdeblur.io.metadata import MAKE, MODEL, ZOOM, Exif
from rsdeblur.io.pictures import is_picture, read_header
from rsdeblur.io.source import Source, cells_of, is_number
from rsdeblur.motion.camera import Camera

WHAT = "camera file"


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

    Parameters
    ----------
    path : path-like
        The file. Its content decides the format; a name that ends in ``.toml`` is enough for a camera file.
    format : {"toml", "gyroflow", "kalibr", "dso", "mars", "recording", "exif"}, optional
        Name of the format instead of detection; the page on files describes each, and what it lacks.
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
        If the file is damaged, not in `format` or a known format, lacks a value that is needed, has no camera `name`,
        describes a lens that is not modelled, or needs an optional package.
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


def open_camera(path: str | os.PathLike[str], format: str | None = None, **request: Any) -> CameraFile:
    """Read a camera, as :func:`read_camera` does, and return assumptions and other content of its file.

    Parameters
    ----------
    path, format, **request
        See :func:`read_camera`.
    """
    wanted = Request(**request)
    source = Source(path, WHAT)
    file = choose(FORMATS, source, format).read(source, wanted)
    focal_length = wanted.focal_length
    return file if focal_length is None else file.with_overrides(focal_length=(focal_length, focal_length))


def detect_camera_format(path: str | os.PathLike[str]) -> str:
    """Return the name of the format as which `read_camera` would read the file."""
    return choose(FORMATS, Source(path, WHAT)).name


def check_editable(path: str | os.PathLike[str]) -> None:
    """Check that `write_time_offset` can edit a file, before the work that finds the offset."""
    format = detect_camera_format(path)
    if format != "toml":
        raise FileFormatError(
            f"{path}: a file of the format {format} has no place for the time offset; make a camera file of it: "
            f"rsdeblur camera import {path} -o camera.toml"
        )
    Camera.load(path)


def write_time_offset(path: str | os.PathLike[str], time_offset: float) -> None:
    """Write `time_offset` into a camera file, whose other lines stay as they are."""
    document = tomlkit.parse(read_file(path, WHAT).decode("utf-8-sig"))
    document["time_offset"] = time_offset
    with atomic_write(path) as file:
        file.write(tomlkit.dumps(document).encode())


def _sniff_toml(source: Source) -> bool:
    if source.path.suffix.lower() == ".toml":
        return True
    keys = re.compile(r"^[ \t]*(width|height|focal_length)[ \t]*=", re.MULTILINE)
    return source.looks_like_text and keys.search(source.start) is not None


def _read_toml(source: Source, request: Request) -> CameraFile:
    return CameraFile(Camera.load(source.path), "toml").fitted(request.size)


def _read_exif(source: Source, request: Request) -> CameraFile:
    width, height, block = read_header(source.path)
    exif = Exif(block)
    axes = "phone-landscape" if width >= height else "phone-portrait"
    try:
        focal_length, origin = exif.focal_px(width, height)
    except InputError as error:
        raise source.error(
            f"it is a picture, and its {error}; give a camera file, calibrate the camera, or give its focal length: "
            "rsdeblur camera new"
        ) from error
    text = f"the focal length of {focal_length:.0f} px is estimated from EXIF ({origin}), to a few percent at best"
    assumed = [
        Assumption("focal_length", text),
        Assumption("imu_to_camera", f"EXIF does not contain the axes of the gyro: {axes} is assumed"),
    ]
    zoom = exif.number(ZOOM)
    if zoom and zoom > 1:
        text = f"the picture was zoomed {zoom:.3g} times digitally; the 35 mm equivalent may or may not include that"
        assumed.append(Assumption("focal_length", text))
    facts: dict[str, Any] = {"make": exif.text(MAKE), "model": exif.text(MODEL), "orientation": exif.orientation}
    facts = {key: value for key, value in (facts | {"exposure_s": exif.exposure}).items() if value}
    fields: dict[str, Any] = {"size": (width, height), "focal_length": focal_length, "imu_to_camera": axes}
    return finished(source, request, "exif", assumed, facts, readout_time=None, **fields)


# Columns of MARS logger by their reduced names: the name of the fact, and how many of its units one of ours has.
MARS = {
    "fx": ("focal_length_px", 1.0),
    "framereadouttime": ("readout_time_s", 1e9),  # Android only
    "exposuretime": ("exposure_s", 1e9),
    "exposureduration": ("exposure_s", 1e9),
    "cx": ("cx_px", 1.0),  # iOS only
    "cy": ("cy_px", 1.0),
}


def _sniff_mars(source: Source) -> bool:
    names = (Cell.of(cell).name for cell in cells_of(source.first_line) if "px" in cell)
    return source.looks_like_text and {"fx", "fy"}.issubset(names)


def _read_mars(source: Source, request: Request) -> CameraFile:
    facts = mars_facts(source)
    # The principal point is near the middle.
    middle = facts.pop("cx_px", None), facts.pop("cy_px", None)
    size = request.size or (None if None in middle else tuple(round(2 * side) for side in middle))
    if size is None:
        raise source.error(
            "MARS logger does not write the size of the pictures: make a camera file with rsdeblur camera import, "
            "--size 1920x1080, or 1080x1920 for upright frames, and the width of the whole sensor, to which its focal "
            "length often refers: --sensor-width 4000"
        )
    focal_length, readout_time = facts.pop("focal_length_px"), facts.pop("readout_time_s", None)
    assumed = []
    if request.focal_length is None and request.sensor_width is not None:
        focal_length *= max(size) / request.sensor_width
    elif request.focal_length is None:
        view = math.degrees(2 * math.atan(max(size) / focal_length / 2))
        text = f"the focal length of {focal_length:g} px, a field of view of {view:.0f} degrees, is taken as it is"
        text += "; if it refers to the whole sensor, give --sensor-width, like 4000"
        assumed.append(Assumption("focal_length", text))
    # The sensor of a rear camera is mounted landscape and read from the top.
    axes, direction, shape = "phone-landscape", "top-down", "landscape"
    if size[1] > size[0]:
        axes, direction, shape = "phone-portrait", "right-left", "upright"
    assumed += [
        Assumption("readout_direction", f"the readout direction {direction} is assumed, as of {shape} frames"),
        Assumption("imu_to_camera", f"the axes {axes} are assumed, as of {shape} frames of a rear camera"),
    ]
    fields: dict[str, Any] = {"readout_direction": direction, "imu_to_camera": axes}
    fields |= {"size": size, "focal_length": focal_length, "readout_time": readout_time}
    return finished(source, request, "mars", assumed, facts, **fields)


def mars_facts(source: Source) -> dict[str, Any]:
    """Return what MARS logger's capture metadata contain about the camera; medians of columns, without `null` cells."""
    rows = [cells_of(source.lines[row]) for row in source.rows[1:]]
    facts: dict[str, Any] = {"frames": len(rows)}
    for k, cell in enumerate(cells_of(source.first_line)):
        name, per_unit = MARS.get(Cell.of(cell).name, ("", 1.0))
        numbers = [float(cells[k]) for cells in rows if k < len(cells) and is_number(cells[k])]
        value = float(np.median(numbers)) if name and numbers else 0.0
        if math.isfinite(value) and value > 0:
            facts[name] = value / per_unit
    if "focal_length_px" not in facts:
        raise source.error("no focal length: all cells of its column are null; give --focal-length")
    return facts


def _sniff_log(source: Source) -> bool:
    return is_video(source) or (source.looks_like_text and is_gcsv(source))


def _read_log(source: Source, request: Request) -> CameraFile:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        facts = dict(open_gyro(source.path).facts)
    size = request.size or (_video_size(source) if is_video(source) else None)
    if size is None:
        raise source.error("the file does not contain the picture's size: use rsdeblur camera import --size 1920x1080")
    fields: dict[str, Any] = {"size": size, "focal_length": request.focal_length, "imu_to_camera": "gyroflow"}
    fields |= {"readout_time": facts.pop("readout_time_s", None), "timestamp_marks": "middle"}
    fields["readout_direction"] = facts.pop("readout_direction", "top-down")
    assumed = []
    if request.focal_length is None:
        view = facts.get("field_of_view_deg")
        if view is None:
            raise source.error("the file contains no focal length; give --focal-length or --focal35, or a lens profile")
        # Without digital correction, action cameras have an equidistant lens, to a few percent.
        focal_length = math.hypot(*size) / 2 / math.radians(view / 2)
        fields |= {"focal_length": focal_length, "distortion_model": "fisheye", "distortion": (0.0,) * 4}
        text = (
            f"the focal length of {focal_length:.0f} px follows from the field of view of {view:.1f} degrees and an "
            "equidistant lens, to a few percent at best; a lens profile of Gyroflow is better"
        )
        assumed.append(Assumption("focal_length", text))
    if "stabilised" in facts:
        text = f"the camera stabilised the video ({facts['stabilised']}), so its blur is not that of the gyro"
        assumed.append(Assumption("", text))
    return finished(source, request, "video" if is_video(source) else "gcsv", assumed, facts, **fields)


def _video_size(source: Source) -> tuple[int, int] | None:
    """Return width and height of a video as stored; None if PyAV is missing or cannot read it."""
    try:
        import av
    except ModuleNotFoundError:
        return None
    try:
        with av.open(**ffmpeg_input(source.path)) as container:
            stream = container.streams.video[0]
            return stream.width, stream.height
    except (OSError, ValueError, IndexError, av.FFmpegError):
        return None


FORMATS: tuple[Format[CameraFile], ...] = (
    Format("dso", "DSO camera.txt", kalibr.sniff_dso, kalibr.read_dso),
    Format("exif", "picture with an EXIF block", is_picture, _read_exif),
    Format("gyroflow", "Gyroflow lens profile or project", gyroflow.is_lens, gyroflow.read_lens),
    Format("kalibr", "Kalibr, EuRoC, maplab or VINS YAML", kalibr.sniff, kalibr.read),
    Format("mars", "MARS logger movie_metadata.csv", _sniff_mars, _read_mars),
    Format("recording", ".gcsv log or video with telemetry", _sniff_log, _read_log),
    Format("toml", "TOML, see docs/camera-file.md", _sniff_toml, _read_toml),
)
