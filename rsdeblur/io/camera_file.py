"""What a camera file's reader finds."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from rsdeblur._util import validate
from rsdeblur._util.atomic import atomic_write
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.motion.camera import Camera

# Sizes of the same shape differ by no more than what whole pixels, or 4096 for 3840, cannot express.
SAME_SHAPE = 0.01


@dataclass(frozen=True, slots=True)
class Request:
    """What the caller wants of a camera file.

    Parameters
    ----------
    size : (int, int), optional
        Width and height of the picture, if not that of the file.
    name : str, optional
        Which camera of a file that holds several.
    fps : float, optional
        Frame rate, where a file has several settings of one size.
    """

    size: tuple[int, int] | None = None
    name: str | None = None
    fps: float | None = None


class Assumption(NamedTuple):
    """Something that was assumed because a file does not say it."""

    about: str
    """Key of the camera that would settle it; empty if none would."""
    text: str


@dataclass(frozen=True, slots=True)
class CameraFile:
    """A camera with what its file says about it.

    Parameters
    ----------
    camera : Camera
        The camera.
    format : str
        Name of the file's format.
    facts : mapping
        What else the file says, for reports.
    doubts : tuple of Assumption
        What was assumed because the file does not say it.
    """

    camera: Camera
    format: str
    facts: Mapping[str, Any] = field(default_factory=dict)
    assumptions: tuple[Assumption, ...] = ()

    def with_overrides(self, **given: Any) -> CameraFile:
        """Return the file with keys of its camera replaced, None keeping one, and what was doubted of them settled."""
        given = {key: value for key, value in given.items() if value is not None}
        assumptions = tuple(assumption for assumption in self.assumptions if assumption.about not in given)
        return replace(self, camera=replace(self.camera, **given), assumptions=assumptions)

    def warn(self, path: object, *, stacklevel: int = 2) -> Camera:
        """Return the camera, with a warning for each doubt."""
        for assumption in self.assumptions:
            warnings.warn(f"{path}: {assumption.text}", RsdeblurWarning, stacklevel=stacklevel + 1)
        return self.camera

    def fitted(self, size: tuple[int, int] | None) -> CameraFile:
        """Return the camera of a picture of another size.

        One of the same shape is taken as resized, any other as cut out of the middle of the sensor at the same scale,
        its readout shorter by the rows cut off.
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
            f"{width}x{height} has another shape than the file's {camera.width}x{camera.height}: taken as cut out of "
            "its middle, with the same focal length in px; if the camera scales its picture, give the scale",
        )
        return replace(self, camera=cut, assumptions=(*self.assumptions, assumption))


def write_time_offset(path: str | os.PathLike[str], time_offset: float) -> None:
    """Put `time_offset`, s, into a camera file, whose other lines stay as they are; it is replaced atomically.

    Raises
    ------
    FileFormatError
        If the file is not a camera file.
    OutputError
        If it cannot be written.
    """
    time_offset = validate.finite("time_offset", time_offset)
    Camera.load(path)
    text = Path(path).read_text(encoding="utf-8")
    line = f"time_offset = {time_offset!r}"
    changed, found = re.subn(r"^[ \t]*time_offset[ \t]*=[^#\n]*", line, text, count=1, flags=re.MULTILINE)
    if not found:
        changed = f"{text.rstrip()}\n{line}\n"
    with atomic_write(path) as file:
        file.write(changed.encode())
