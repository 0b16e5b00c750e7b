"""Cameras as read from files, with the assumptions that their files leave open."""

from __future__ import annotations

import codecs
import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import tomlkit
from tomlkit.exceptions import TOMLKitError

from rsdeblur._util import validate
from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.files import read_file
from rsdeblur.errors import FileFormatError, RsdeblurWarning
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.plausible import doubts

# Largest relative difference of equal aspect ratios: sizes are rounded to whole pixels.
SAME_SHAPE = 0.01


@dataclass(frozen=True, slots=True)
class Request:
    """Choices for reading a camera file.

    Parameters
    ----------
    size : (int, int), optional
        Width and height of the picture in px, if they differ from the file's.
    name : str, optional
        Name of the camera, where a file contains several.
    fps : float, optional
        Frame rate in Hz, where a file contains several settings of one size.
    focal_length : float, optional
        Focal length in px of the picture; replaces the file's.
    sensor_width : int, optional
        Width in px of the whole sensor, if the focal length of a file refers to it.
    """

    size: tuple[int, int] | None = None
    name: str | None = None
    fps: float | None = None
    focal_length: float | None = None
    sensor_width: int | None = None


class Assumption(NamedTuple):
    """Something assumed because a file does not contain it."""

    about: str
    """Key of the camera file that replaces the assumption; or an empty text."""
    text: str
    """Message for the user."""


@dataclass(frozen=True, slots=True)
class CameraFile:
    """A camera with the other content of its file.

    Parameters
    ----------
    camera : Camera
        The camera.
    format : str
        Name of the file's format.
    facts : mapping
        Other content of the file, for reports.
    assumptions : tuple of Assumption
        Assumptions made because the file does not contain a value.
    """

    camera: Camera
    format: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    assumptions: tuple[Assumption, ...] = ()

    def with_overrides(self, **overrides: Any) -> CameraFile:
        """Return the file with these keys of its camera replaced, and without the assumptions about them.

        None keeps a key.
        """
        overrides = {key: value for key, value in overrides.items() if value is not None}
        assumptions = tuple(assumption for assumption in self.assumptions if assumption.about not in overrides)
        return replace(self, camera=replace(self.camera, **overrides), assumptions=assumptions)

    @property
    def remarks(self) -> list[str]:
        """Texts of the assumptions, and sentences about values that are probably mistakes."""
        return [assumption.text for assumption in self.assumptions] + doubts(self.camera)

    def warn(self, path: object, *, stacklevel: int = 2) -> Camera:
        """Return the camera, and warn of each remark."""
        for remark in self.remarks:
            warnings.warn(f"{path}: {remark}", RsdeblurWarning, stacklevel=stacklevel + 1)
        return self.camera

    def fitted(self, size: tuple[int, int] | None) -> CameraFile:
        """Return the camera of a picture of another size.

        The picture is assumed to be resized by its width and, with another aspect ratio, to be cut at top and bottom,
        or to show more there; the readout then follows the number of lines. Cameras scale the whole width of the
        sensor to the width of a video, so a cut-out at the same scale would have too narrow a field of view.
        """
        camera = self.camera
        if size is None or size == (camera.width, camera.height):
            return self
        width, height = size
        if abs(width * camera.height / (height * camera.width) - 1) < SAME_SHAPE:
            return replace(self, camera=camera.resized(width, height))
        scale = width / camera.width
        (fx, fy), (cx, cy) = camera.focal_length, camera.principal_point
        whole = camera.height * scale
        cut = replace(
            camera,
            width=width,
            height=height,
            focal_length=(fx * scale, fy * scale),
            principal_point=((cx + 0.5) * scale - 0.5, (cy + 0.5) * scale - 0.5 + (height - whole) / 2),
            readout_time=camera.readout_time * (1.0 if camera.horizontal_readout else height / whole),
        )
        text = (
            f"{width}x{height} has another aspect ratio than the file's {camera.width}x{camera.height}: the picture is "
            "assumed to be resized by its width and cut at top and bottom; for a cut-out, give --crop instead of --size"
        )
        if (width > height) != (camera.width > camera.height):
            text += "; for a picture that was turned, give --size of the picture before it, and --turn"
        return replace(self, camera=cut, assumptions=(*self.assumptions, Assumption("focal_length", text)))


def check_editable(path: str | os.PathLike[str]) -> None:
    """Check that `write_time_offset` can edit a file, before the work that finds the offset.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is not a camera file of rsdeblur.
    """
    try:
        Camera.load(path)
    except FileFormatError as error:
        # Imported here because it imports this module.
        from rsdeblur.io.cameras import open_camera

        format = open_camera(path).format
        if format == "toml":
            raise
        raise FileFormatError(
            f"{path}: a file of the format {format} has no place for the time offset; make a camera file of it: "
            f"rsdeblur camera import {path} -o camera.toml"
        ) from error


def write_time_offset(path: str | os.PathLike[str], time_offset: float) -> None:
    """Write `time_offset` into a camera file, whose other lines stay as they are, down to their line ends.

    Parameters
    ----------
    path : path-like
        The camera file (TOML). It is replaced atomically.
    time_offset : float
        Camera time minus gyro time in s.

    Raises
    ------
    InputError
        If `time_offset` is not finite.
    FileFormatError
        If the file cannot be read or is not a camera file.
    OutputError
        If it cannot be written.
    """
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
