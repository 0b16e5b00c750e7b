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
    """

    size: tuple[int, int] | None = None
    name: str | None = None
    fps: float | None = None


class Assumption(NamedTuple):
    """Something assumed because a file does not contain it."""

    about: str
    """Key of the camera file that replaces the assumption; empty if there is none."""
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

        A picture of the same aspect ratio is assumed to be resized. Any other is assumed to be cut out of the middle
        of the sensor at the same scale, with a readout that is shorter by the lines cut off.
        """
        camera = self.camera
        if size is None or size == (camera.width, camera.height):
            return self
        width, height = size
        if abs(width * camera.height / (height * camera.width) - 1) < SAME_SHAPE:
            return replace(self, camera=camera.resized(width, height))
        cx, cy = camera.principal_point
        along = width / camera.width if camera.horizontal_readout else height / camera.height
        cut = replace(
            camera,
            width=width,
            height=height,
            principal_point=(cx + (width - camera.width) / 2, cy + (height - camera.height) / 2),
            readout_time=camera.readout_time * along,
        )
        assumption = Assumption(
            "focal_length",
            f"{width}x{height} has another aspect ratio than the file's {camera.width}x{camera.height}: the picture is "
            "assumed to be cut out of the middle, with the same focal length in px; if the camera scales its picture, "
            "give the scale",
        )
        return replace(self, camera=cut, assumptions=(*self.assumptions, assumption))


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
    Camera.load(path)
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
