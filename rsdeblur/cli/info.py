"""`rsdeblur info`: show what files contain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._describe import describe, print_entry
from rsdeblur.cli._output import print_json
from rsdeblur.errors import CoverageError, FileFormatError

EXAMPLES = """\b
Examples:
  rsdeblur info gyro.csv phone.toml frames.csv photo.jpg
  rsdeblur info --gyro gyro.csv --camera phone.toml --capture frames.csv
"""


@click.command("info", epilog=EXAMPLES)
@click.argument("files", type=_options.PATH, nargs=-1)
@click.option("--gyro", type=_options.PATH, metavar="LOG", help="Gyro log, to check the exposures of --capture.")
@_options.log_options
@click.option("--camera", type=_options.PATH, metavar="FILE", help="Camera file, for the same check.")
@click.option("--capture", type=_options.PATH, metavar="FILE", help="Metadata file that contains the exposures.")
@click.option("--time-offset", type=_options.SecondsType(), help="Camera time minus gyro time; replaces the camera's.")
@_options.json_option
def command(
    files: tuple[Path, ...],
    gyro: Path | None,
    camera: Path | None,
    capture: Path | None,
    time_offset: float | None,
    as_json: bool,
    gyro_format: str | None,
    **reading: Any,
) -> None:
    """Show what FILES contain.

    FILES are gyro logs, camera files, capture files or pictures. With --gyro, --camera and --capture, also show whether
    the log covers each exposure.
    """
    together = [gyro, camera, capture]
    if any(together) and not all(together):
        raise click.UsageError("--gyro, --camera and --capture are needed together", ctx=click.get_current_context())
    if not files and not any(together):
        raise click.UsageError("name a file, or --gyro, --camera and --capture", ctx=click.get_current_context())
    entries = []
    for entry in _entries(files, gyro, camera, capture, time_offset, {"format": gyro_format} | reading):
        entries.append(entry)
        if not as_json:
            print_entry(entry)
    if as_json:
        print_json(entries)
    reasons = [entry["reason"] for entry in entries if "reason" in entry]
    if reasons:
        raise FileFormatError("; ".join(reasons))


def _entries(
    files: tuple[Path, ...],
    gyro: Path | None,
    camera: Path | None,
    capture: Path | None,
    time_offset: float | None,
    reading: dict[str, Any],
) -> Iterator[dict[str, Any]]:
    for path in files:
        try:
            if not path.is_file():
                raise FileFormatError(f"{path}: there is no such file")
            yield {"file": str(path)} | describe(path, reading)
        except FileFormatError as error:
            # The command describes the other files first and reports the error at its end.
            yield {"file": str(path), "kind": "not understood", "reason": str(error)}
    if gyro and camera and capture:
        coverage = _coverage(gyro, camera, capture, time_offset, reading)
        yield {"file": str(gyro), "kind": f"coverage of {capture}", "exposures": coverage}


def _coverage(
    gyro: Path, camera_file: Path, capture: Path, time_offset: float | None, reading: dict[str, Any]
) -> list[dict[str, Any]]:
    from rsdeblur.io import read_camera, read_captures, read_gyro

    log, camera = read_gyro(gyro, **reading), read_camera(camera_file)
    if time_offset is not None:
        camera = replace(camera, time_offset=time_offset)
    report = []
    for exposure in read_captures(capture):
        opens, closes = exposure.span(camera)
        try:
            log.covering(opens - camera.time_offset, closes - camera.time_offset, exposure.epoch_ns)
            state = "covered"
        except CoverageError as error:
            state = str(error)
        start_ns = exposure.epoch_ns + round(exposure.start * 1e9)
        report.append({"start_ns": start_ns, "duration_s": exposure.duration, "coverage": state})
    return report
