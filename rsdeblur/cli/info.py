"""`rsdeblur info`: show what files contain."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._describe import describe, print_entry
from rsdeblur.cli._output import print_json
from rsdeblur.cli._types import PATH, SecondsType
from rsdeblur.errors import CoverageError, FileFormatError

EXAMPLES = """\b
Examples:
  rsdeblur info gyro.csv phone.toml frames.csv photo.jpg
  rsdeblur info --gyro gyro.csv --camera phone.toml --capture frames.csv
"""


@dataclass(frozen=True, slots=True)
class Together:
    """Log, camera and exposures that are checked against each other, and values that replace those of the files."""

    gyro: Path | None
    camera: Path | None
    capture: Path | None
    duration: float | None
    time_offset: float | None


@click.command("info", cls=Command, epilog=EXAMPLES)
@click.argument("files", type=PATH, nargs=-1)
@_options.gathered(
    "together",
    Together,
    (
        click.option("--gyro", type=PATH, metavar="LOG", help="Gyro log, to check the exposures of --capture."),
        click.option("--camera", type=PATH, metavar="FILE", help="Camera file, for the same check."),
        click.option("--capture", type=PATH, metavar="FILE", help="Metadata file that contains the exposures."),
        click.option(
            "--duration", type=SecondsType(above=0.0), help="Exposure time, where --capture contains timestamps only."
        ),
        click.option("--time-offset", type=SecondsType(), help="Camera time minus gyro time; replaces the camera's."),
    ),
)
@_options.log_options
@_options.json_option
def command(
    files: tuple[Path, ...],
    together: Together,
    as_json: bool,
    gyro_format: str | None,
    **reading: Any,
) -> None:
    """Show what FILES contain.

    FILES are gyro logs, camera files, capture files or pictures. With --gyro, --camera and --capture, also show whether
    the log covers each exposure, and if the log has an accelerometer, the angle by which gravity is turned from the
    bottom of the picture, as stored, towards its right.
    """
    named = [together.gyro, together.camera, together.capture]
    if any(named) and not all(named):
        raise click.UsageError("--gyro, --camera and --capture are needed together", ctx=click.get_current_context())
    if not files and not any(named):
        raise click.UsageError("name a file, or --gyro, --camera and --capture", ctx=click.get_current_context())
    entries = []
    for entry in _entries(files, together, {"format": gyro_format} | reading):
        entries.append(entry)
        # A reason is reported as the error, at the end.
        if not as_json and "reason" not in entry:
            print_entry(entry)
    if as_json:
        print_json(entries)
    reasons = [entry["reason"] for entry in entries if "reason" in entry]
    if reasons:
        raise FileFormatError("; ".join(reasons))


def _entries(files: tuple[Path, ...], together: Together, reading: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for path in files:
        try:
            if not path.is_file():
                what = "not a regular file" if path.exists() else "there is no such file"
                what = "a folder; give the files in it" if path.is_dir() else what
                raise FileFormatError(f"{path}: {what}")
            yield {"file": str(path)} | describe(path, reading)
        except FileFormatError as error:
            # The command describes the other files first.
            yield {"file": str(path), "kind": "not understood", "reason": str(error)}
    if together.gyro and together.camera and together.capture:
        coverage = _coverage(together.gyro, together.camera, together.capture, together, reading)
        yield {"file": str(together.gyro), "kind": f"coverage of {together.capture}", "exposures": coverage}


def _coverage(
    gyro: Path, camera_file: Path, capture: Path, together: Together, reading: dict[str, Any]
) -> list[dict[str, Any]]:
    from rsdeblur.cli._gravity import accelerometer
    from rsdeblur.io import read_camera, read_captures, read_gyro

    log, camera = read_gyro(gyro, **reading), read_camera(camera_file)
    if together.time_offset is not None:
        camera = replace(camera, time_offset=together.time_offset)
    report = []
    for exposure in read_captures(capture, duration=together.duration):
        opens, closes = exposure.span(camera)
        try:
            log.covering(opens - camera.time_offset, closes - camera.time_offset, exposure.epoch_ns)
            state = "complete"
        except CoverageError as error:
            state = str(error)
        start_ns = exposure.epoch_ns + round(exposure.start * 1e9)
        acceleration = accelerometer(gyro)
        angle = None if acceleration is None else acceleration.gravity_angle(camera, exposure)
        gravity = {} if angle is None else {"gravity_deg": round(math.degrees(angle), 1)}
        report.append({"start_ns": start_ns, "duration_s": exposure.duration} | gravity | {"coverage": state})
    return report
