"""`rsdeblur camera`: create, import and show camera files; measure the readout."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._options import Target
from rsdeblur.cli._output import check_camera_file, print_json, say
from rsdeblur.cli._types import PATH, POSITIVE, NumberType, SecondsType, SizeType

if TYPE_CHECKING:
    from rsdeblur.choices import Auto, Transfer
    from rsdeblur.io.camera_file import CameraFile
    from rsdeblur.motion.camera import Camera

EXAMPLES = """\b
Examples:
  rsdeblur camera new --size 4000x3000 --focal35 26 --readout-time 18ms --imu phone-landscape -o phone.toml
  rsdeblur camera import profile.json --size 1920x1080 -o gopro.toml
  rsdeblur camera import camchain-imucam.yaml --name cam1 -o cam1.toml
  rsdeblur camera import movie_metadata.csv --size 1080x1920 --sensor-width 4000 -o phone.toml
  rsdeblur camera import photo.jpg --readout-time 18ms -o phone.toml
  rsdeblur camera measure-readout wall1.jpg wall2.jpg wall3.jpg --mains 50
  rsdeblur camera show phone.toml
"""


class BoxType(click.ParamType[tuple[int, int, int, int]]):
    """A part of a picture, `WIDTHxHEIGHT+LEFT+TOP`."""

    name = "WxH+X+Y"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int, int, int]:
        """Return (left, top, width, height)."""
        match = re.fullmatch(r"(\d+)x(\d+)\+(\d+)\+(\d+)", str(value))
        if match is None:
            self.fail(f"{value!r} is not a part of a picture; write 1920x1080+960+540", param, ctx)
        width, height, left, top = map(int, match.groups())
        return left, top, width, height


class NumbersType(click.ParamType[tuple[float, ...]]):
    """Numbers separated by commas."""

    name = "A,B,..."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers."""
        try:
            return tuple(map(float, str(value).split(",")))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers; write 1.5,2,-3", param, ctx)


SETTINGS: tuple[Callable[[Any], Any], ...] = (
    click.option("--readout-time", type=SecondsType(minimum=0.0), help="Readout time of the picture."),
    click.option(
        "--readout-direction",
        type=click.Choice(["top-down", "bottom-up", "left-right", "right-left"]),
        help="Direction of the readout in the picture as stored.",
    ),
    click.option(
        "--imu",
        "imu_to_camera",
        metavar="NAME",
        help="Axes of the gyro: phone-portrait, phone-landscape, gyroflow, or an orientation string like YxZ.",
    ),
    click.option("--time-offset", type=SecondsType(), help="Camera time minus gyro time."),
    click.option(
        "--timestamp-marks",
        type=click.Choice(["start", "middle", "end"]),
        help="Moment of the timestamps: the start of the first row's exposure, the middle of the middle row's, or the "
        "end of the last row's.",
    ),
)


def settings(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options for values that calibration files do not contain."""
    for option in reversed(SETTINGS):
        function = option(function)
    return function


# Assumptions of `camera new`, by the key whose option replaces them.
UNSTATED = {
    "readout_time": "a global shutter is assumed, but the shutter of nearly every phone rolls: give --readout-time",
    "imu_to_camera": "the axes of the camera are assumed for the gyro, but those of phones differ: give --imu",
}


@dataclass(frozen=True, slots=True)
class Edits:
    """Changes to the picture of a camera file: it is resized, then cropped, then turned."""

    scale: float | None
    crop: tuple[int, int, int, int] | None
    turn: int | None

    def apply(self, camera: Camera) -> Camera:
        """Return the camera of the edited picture."""
        if self.scale is not None:
            camera = camera.scaled(self.scale)
        if self.crop is not None:
            camera = camera.cropped(*self.crop)
        for _ in range(self.turn or 0):
            camera = camera.turned()
        return camera


@dataclass(frozen=True, slots=True)
class Lens:
    """Focal length, in px or as 35 mm equivalent, and the width of the sensor in px."""

    focal_length: float | None
    focal35: float | None
    sensor_width: int | None

    def pixels(self, size: tuple[int, int] | None) -> float | None:
        """Return the focal length in px of a picture of that size; None if it is not given."""
        if self.focal35 is None:
            return self.focal_length
        if size is None or self.focal_length is not None:
            raise click.UsageError("--focal35 needs --size, and excludes --focal-length", click.get_current_context())
        return pixels_of_focal35(self.focal35, size)


def pixels_of_focal35(focal35: float, size: tuple[int, int]) -> float:
    """Return the focal length in px that a 35 mm equivalent means."""
    from rsdeblur.io.exif import FILM_DIAGONAL

    return focal35 / FILM_DIAGONAL * math.hypot(*size)


@click.group("camera", epilog=EXAMPLES)
def command() -> None:
    """Create, import and show camera files. Measure the readout time."""


@command.command("show", cls=Command)
@click.argument("file", type=PATH)
@click.option("--name", metavar="CAMERA", help="Name of the camera, if the file has several.")
@_options.json_option
def show(file: Path, name: str | None, as_json: bool) -> None:
    """Show the camera in FILE. It may also be a picture with EXIF."""
    from rsdeblur.io import open_camera

    _print_camera(file, open_camera(file, name=name), as_json)


@command.command("new", cls=Command)
@click.option("--size", type=SizeType(), required=True, help="Size of the picture as stored, in px.")
@click.option("--focal-length", type=NumbersType(), help="Focal length in px, one number or fx,fy.")
@click.option("--focal35", type=POSITIVE, help="Focal length as 35 mm equivalent.")
@click.option("--principal-point", type=NumbersType(), help="Principal point cx,cy in px.  [default: the middle]")
@click.option(
    "--distortion-model", type=click.Choice(["none", "radtan", "fisheye"]), help="Model of the lens distortion."
)
@click.option("--distortion", type=NumbersType(), help="Its coefficients: k1,k2,p1,p2[,k3[,k4,k5,k6]] or k1,k2,k3,k4.")
@settings
@_options.target_options("TOML", "Camera file to write.")
def new(
    size: tuple[int, int],
    focal_length: tuple[float, ...] | None,
    focal35: float | None,
    target: Target,
    **values: Any,
) -> None:
    """Create a camera file from numbers."""
    from rsdeblur.io.camera_file import Assumption, CameraFile
    from rsdeblur.motion.camera import Camera

    if (focal_length is None) == (focal35 is None):
        raise click.UsageError("give one of --focal-length and --focal35", ctx=click.get_current_context())
    width, height = size
    length: Any = focal_length[0] if focal_length and len(focal_length) == 1 else focal_length
    if focal35 is not None:
        length = pixels_of_focal35(focal35, size)
    camera = Camera(width, height, length, **{key: value for key, value in values.items() if value is not None})
    _write(camera, target)
    assumptions = tuple(Assumption(key, text) for key, text in UNSTATED.items() if values[key] is None)
    _print_camera(target.output, CameraFile(camera, "toml", assumptions=assumptions), target.as_json)


@command.command("import", cls=Command)
@click.argument("source", type=PATH)
@click.option("--format", metavar="NAME", help="Format of the file.  [default: recognised by its content]")
@click.option("--name", metavar="CAMERA", help="Name of the camera, if the file has several: cam1.")
@click.option("--size", type=SizeType(), help="Size of your pictures, if it is not that of the file.")
@click.option("--fps", type=POSITIVE, help="Frame rate, if a lens profile has several settings of one size.")
@_options.gathered(
    "lens",
    Lens,
    (
        click.option("--focal-length", type=POSITIVE, help="Focal length in px of your pictures; replaces the file's."),
        click.option("--focal35", type=POSITIVE, help="Focal length as 35 mm equivalent; needs --size."),
        click.option(
            "--sensor-width",
            type=click.IntRange(min=1),
            help="Width of the whole sensor in px, if the focal length of MARS logger refers to it.",
        ),
    ),
)
@_options.gathered(
    "edits",
    Edits,
    (
        click.option("--scale", type=POSITIVE, help="Factor by which the picture is resized."),
        click.option("--crop", type=BoxType(), help="Part of the picture that is kept."),
        click.option(
            "--turn", type=click.IntRange(1, 3), help="Number of quarter turns clockwise from that picture to yours."
        ),
    ),
)
@settings
@_options.target_options("TOML", "Camera file to write.")
def import_(
    source: Path,
    format: str | None,
    name: str | None,
    size: tuple[int, int] | None,
    fps: float | None,
    lens: Lens,
    edits: Edits,
    target: Target,
    **values: Any,
) -> None:
    """Import a camera from SOURCE and write a camera file.

    SOURCE is a camera file of rsdeblur, a lens profile of Gyroflow, a YAML file of Kalibr, MARS logger's
    movie_metadata.csv, a .gcsv log, a video with telemetry, or a picture with an EXIF block. --scale, --crop and --turn
    are applied in this order; the other options then replace values.
    """
    from rsdeblur.io import open_camera

    file = open_camera(
        source,
        format,
        size=size,
        name=name,
        fps=fps,
        focal_length=lens.pixels(size),
        sensor_width=lens.sensor_width,
    )
    file = replace(file, camera=edits.apply(file.camera)).with_overrides(**values)
    _write(file.camera, target)
    _print_camera(target.output, file, target.as_json)


@command.command("measure-readout", cls=Command)
@click.argument("photos", type=PATH, metavar="PHOTO...", nargs=-1, required=True)
@click.option("--mains", type=NumberType(40, 70), default=50.0, show_default=True, help="Mains frequency in Hz.")
@click.option("--horizontal", is_flag=True, help="The readout runs along x, as in upright phone photos stored upright.")
@_options.transfer_option
@_options.json_option
def measure_readout(
    photos: tuple[Path, ...], mains: float, horizontal: bool, transfer: Transfer | Auto, as_json: bool
) -> None:
    """Measure the readout time by the bands that a lamp leaves.

    Take one photo of an evenly lit wall, or better several of one scene from a fixed place, at 1/200 s or shorter: a
    lamp on the mains flickers at twice the mains frequency. Exit code 1 means that there are no clear bands.
    """
    from rsdeblur.calibration.flicker import measure_flicker
    from rsdeblur.cli._inputs import naming, transfer_of
    from rsdeblur.errors import InputError
    from rsdeblur.io.pictures import read_picture

    pictures = [read_picture(photo) for photo in photos]
    with naming(photos[0]):
        found = measure_flicker(
            [picture.pixels for picture in pictures],
            mains=mains,
            horizontal=horizontal,
            transfer=transfer_of(pictures[0], transfer),
        )
    if as_json:
        print_json({"readout_time_s": found.readout_time, "bands": found.bands, "coherence": found.coherence})
    if found.readout_time is None:
        raise InputError(f"{photos[0]}: {found.reason}")
    if not as_json:
        say(f"readout time {1e3 * found.readout_time:.1f} ms: {found.bands:.2f} bands of {500 / mains:.2f} ms")


def _write(camera: Camera, target: Target) -> None:
    check_camera_file(target.output, force=target.force)
    camera.save(target.output)


def _print_camera(path: Path, file: CameraFile, as_json: bool) -> None:
    from rsdeblur.cli._describe import camera_facts, print_entry

    entry = {"file": str(path)} | camera_facts(file)
    if as_json:
        print_json(entry)
    else:
        print_entry(entry)
