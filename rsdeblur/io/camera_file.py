"""Cameras as read from files, with the assumptions that their files leave open."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from rsdeblur._util import validate
from rsdeblur.errors import InputError, RsdeblurWarning
from rsdeblur.io.source import Source
from rsdeblur.motion.camera import UNKNOWN_READOUT, Camera
from rsdeblur.motion.camera_values import doubts

# Keys that say how uncertain others are.
DEVIATIONS = {"readout_time": "readout_sd", "time_offset": "time_offset_sd"}


@dataclass(frozen=True, slots=True)
class Request:
    """Choices for reading a camera file, as :func:`rsdeblur.read_camera` describes them."""

    size: tuple[int, int] | None = None
    name: str | None = None
    fps: float | None = None
    focal_length: float | None = None
    sensor_width: int | None = None

    def __post_init__(self) -> None:
        if self.size is not None:
            if not (isinstance(self.size, (tuple, list)) and len(self.size) == 2):
                raise InputError(f"size must be (width, height) in px, got {validate.shown(self.size)}")
            width, height = self.size
            # A size of zero has no aspect ratio.
            object.__setattr__(self, "size", (validate.count("size", width), validate.count("size", height)))
        if self.focal_length is not None:
            validate.finite("focal_length", self.focal_length, above=0.0)
        if self.sensor_width is not None:
            validate.count("sensor_width", self.sensor_width)


class Assumption(NamedTuple):
    """Something assumed because a file does not contain it."""

    about: str  # key of the camera file that replaces the assumption; or an empty text
    text: str  # message for the user


@dataclass(frozen=True, slots=True)
class CameraFile:
    """A camera with the other content of its file."""

    camera: Camera
    format: str  # name of the file's format
    facts: Mapping[str, Any] = field(default_factory=dict)  # other content of the file, for reports
    assumptions: tuple[Assumption, ...] = ()  # assumptions made because the file does not contain a value

    def with_overrides(self, **overrides: Any) -> CameraFile:
        """Return the file with keys of its camera replaced, unless None, and without the assumptions about them."""
        overrides = {key: value for key, value in overrides.items() if value is not None}
        overrides |= {sd: 0.0 for name, sd in DEVIATIONS.items() if name in overrides}
        assumptions = tuple(assumption for assumption in self.assumptions if assumption.about not in overrides)
        return replace(self, camera=replace(self.camera, **overrides), assumptions=assumptions)

    @property
    def remarks(self) -> list[str]:
        """Texts of the assumptions, and sentences about guesses and probable mistakes."""
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
        # Sizes are rounded to whole pixels.
        if abs(width * camera.height / (height * camera.width) - 1) < 0.01:
            return replace(self, camera=camera.resized(width, height))
        scale = width / camera.width
        (fx, fy), (cx, cy) = camera.focal_length, camera.principal_point
        whole = camera.height * scale
        cut_off = 1.0 if camera.horizontal_readout else height / whole
        cut = replace(
            camera,
            width=width,
            height=height,
            focal_length=(fx * scale, fy * scale),
            principal_point=((cx + 0.5) * scale - 0.5, (cy + 0.5) * scale - 0.5 + (height - whole) / 2),
            readout_time=camera.readout_time * cut_off,
            readout_sd=camera.readout_sd * cut_off,
        )
        text = (
            f"{width}x{height} has another aspect ratio than the file's {camera.width}x{camera.height}: the picture is "
            "assumed to be resized by its width and cut at top and bottom; for a cut-out, give --crop instead of --size"
        )
        return replace(self, camera=cut, assumptions=(*self.assumptions, Assumption("focal_length", text)))


def finished(
    source: Source,
    request: Request,
    format: str,
    assumed: list[Assumption],
    facts: Mapping[str, Any],
    *,
    size: tuple[int, int],
    focal_length: float | tuple[float, float],
    readout_time: float | None,
    **fields: Any,
) -> CameraFile:
    """Return what a reader found as the camera of a picture of the requested size; `readout_time` may be None."""
    fields |= UNKNOWN_READOUT if readout_time is None else {"readout_time": readout_time}
    with source.parsing(facts.get("camera", "the camera")):
        camera = Camera(*size, focal_length, **fields)
        return CameraFile(camera, format, facts, tuple(assumed)).fitted(request.size)
