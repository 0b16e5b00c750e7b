"""`rsdeblur camera`: create and import camera files."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from rsdeblur.choices import CAMERA, READOUT_DIRECTIONS, TIMESTAMP_MARKS
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._options import Command, Target, option
from rsdeblur.cli._output import check_output
from rsdeblur.cli._types import COUNT, PATH, POSITIVE, READOUT, SECONDS, SIZE, TextType, box, numbers
from rsdeblur.cli.info import lines_of

EXAMPLES = """\b
Examples:
  rsdeblur camera new --size 4000x3000 --focal35 26 --readout-time 18ms --imu phone-landscape -o phone.toml
  rsdeblur camera import profile.json --size 1920x1080 -o gopro.toml
  rsdeblur camera import camchain-imucam.yaml --name cam1 -o cam1.toml
  rsdeblur camera import movie_metadata.csv --size 1080x1920 --sensor-width 4000 -o phone.toml
  rsdeblur camera import photo.jpg --readout-time 18ms -o phone.toml
"""


BOX = TextType("WxH+X+Y", partial(box, pattern=r"(\d+)x(\d+)\+(\d+)\+(\d+)", example="1920x1080+960+540"))
NUMBERS = TextType("A,B,...", partial(numbers, example="1.5,2,-3"))
# Values that calibration files do not contain.
settings = _options.together(
    option("--readout-time", type=READOUT, help="Readout time of the picture."),
    option(
        "--readout-direction",
        type=click.Choice(READOUT_DIRECTIONS),
        help="Direction of the readout in the picture as stored.",
    ),
    option(
        *("--imu", "imu_to_camera"),
        metavar="NAME",
        help="Axes of the gyro: phone-portrait, phone-landscape, gyroflow, or an orientation string like YxZ.",
    ),
    option("--time-offset", type=SECONDS, help="Camera time minus gyro time."),
    option(
        "--timestamp-marks",
        type=click.Choice(TIMESTAMP_MARKS),
        help="Moment of the timestamps: the start of the first row's exposure, the middle of the middle row's, or the "
        "end of the last row's.",
    ),
)


@click.group("camera", epilog=EXAMPLES)
def command() -> None:
    """Create and import camera files, which `rsdeblur info` shows. Measure the readout time."""


@command.command("new", cls=Command)
@option("--size", type=SIZE, required=True, help="Size of the picture as stored, in px.")
@option("--focal-length", type=NUMBERS, help="Focal length in px, one number or fx,fy.")
@option("--focal35", type=POSITIVE, help="Focal length as 35 mm equivalent.")
@option("--principal-point", type=NUMBERS, help="Principal point cx,cy in px.  [default: the middle]")
@option(
    "--distortion-model",
    type=click.Choice(["none", "radtan", "fisheye"]),
    help="Model of the lens distortion.",
)
@option("--distortion", type=NUMBERS, help="Its coefficients: k1,k2,p1,p2[,k3[,k4,k5,k6]] or k1,k2,k3,k4.")
@settings
@_options.target_options("TOML", f"Camera file to write; by default {CAMERA}.", default=lambda **_: Path(CAMERA))
def new(
    size: tuple[int, int], focal_length: tuple[float, ...] | None, focal35: float | None, target: Target, **values: Any
) -> None:
    """Create a camera file from numbers."""
    if (focal_length is None) == (focal35 is None):
        raise click.UsageError("give one of --focal-length and --focal35")
    width, height = size
    length: Any = focal_length[0] if focal_length and len(focal_length) == 1 else focal_length
    if focal35 is not None:
        length = rs.focal35_px(focal35, *size)
    unknown = rs.UNKNOWN_READOUT if values["readout_time"] is None else {}
    given = {key: value for key, value in values.items() if value is not None}
    text = "the axes of the camera are assumed for the gyro, but those of phones differ: give --imu"
    assumptions = () if "imu_to_camera" in given else (rs.Assumption("imu_to_camera", text),)
    camera = rs.Camera(width, height, length, **(unknown | given))
    _write(rs.CameraFile(camera, "toml", assumptions=assumptions), target)


@command.command("import", cls=Command)
@click.argument("source", type=PATH)
@option("--format", metavar="NAME", help="Format of the file.  [default: recognised by its content]")
@option("--name", metavar="CAMERA", help="Name of the camera, if the file has several: cam1.")
@option("--size", type=SIZE, help="Size of your pictures, if it is not that of the file.")
@option("--fps", type=POSITIVE, help="Frame rate, if a lens profile has several settings of one size.")
@option("--focal-length", type=POSITIVE, help="Focal length in px of your pictures; replaces the file's.")
@option("--focal35", type=POSITIVE, help="Focal length as 35 mm equivalent; needs --size.")
@option(
    "--sensor-width",
    type=COUNT,
    help="Width of the whole sensor in px, if the focal length of MARS logger refers to it.",
)
@option("--crop", type=BOX, help="Part of the picture that is kept.")
@option("--turn", type=click.IntRange(0, 3), default=0, help="Quarter turns clockwise from that picture to yours.")
@settings
@_options.target_options(
    "TOML",
    f"Camera file to write; by default {CAMERA} beside SOURCE.",
    default=lambda source, **_: source.with_name(CAMERA),
)
def import_(source: Path, format: str | None, focal35: float | None, target: Target, **values: Any) -> None:
    """Import a camera from SOURCE and write a camera file.

    SOURCE is a camera file of rsdeblur, a lens profile of Gyroflow, a YAML file of Kalibr, MARS logger's
    movie_metadata.csv, a .gcsv log, a video with telemetry, or a picture with an EXIF block. The picture is
    resized to --size, then cropped and turned; the other options replace values.
    """
    crop, turn = values.pop("crop"), values.pop("turn")
    reading = {name: values.pop(name) for name in ("size", "name", "fps", "focal_length", "sensor_width")}
    if focal35 is not None:
        if reading["size"] is None or reading["focal_length"] is not None:
            raise click.UsageError("--focal35 needs --size, and excludes --focal-length")
        reading["focal_length"] = rs.focal35_px(focal35, *reading["size"])
    file = rs.open_camera(source, format, **reading)
    camera = file.camera
    if crop is not None:
        width, height, left, top = crop
        camera = camera.cropped(left, top, width, height)
    for _ in range(turn):
        camera = camera.turned()
    _write(replace(file, camera=camera).with_overrides(**values), target)


def _write(file: rs.CameraFile, target: Target) -> None:
    check_output(target.output, force=target.force, suffixes=(".toml",), kind="a camera file is TOML")
    file.camera.save(target.output)
    entry = {"file": str(target.output)} | rs.camera_facts(file)
    target.show(entry, *lines_of(entry))
