"""`rsdeblur info`: show what files contain."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import accelerometer, read_captures, read_device
from rsdeblur.cli._options import FILES, READING, Command, Recording, Target
from rsdeblur.cli._output import linked, say
from rsdeblur.cli._types import PATH
from rsdeblur.errors import CoverageError, FileFormatError

EXAMPLES = """\b
Examples:
  rsdeblur info gyro.csv phone.toml frames.csv photo.jpg
  rsdeblur info --gyro gyro.csv --camera phone.toml --capture frames.csv
"""
# Number of entries of a long list, such as exposures or gaps, that the text shows; JSON has all.
SHOWN = 12


@click.command("info", cls=Command, epilog=EXAMPLES)
@click.argument("files", type=PATH, nargs=-1)
@_options.recording_options(*FILES, *READING, "duration", "time_offset", required=())
@_options.target_options()
def command(files: tuple[Path, ...], recording: Recording, target: Target) -> None:
    """Show what FILES contain.

    FILES are gyro logs, camera files, capture files or pictures. With --gyro, --camera and --capture, also show whether
    the log covers each exposure, and if the log has an accelerometer, the angle by which gravity is turned from the
    bottom of the picture, as stored, towards its right.
    """
    named = [getattr(recording, name) for name in FILES]
    if not all(named) and (any(named) or not files):
        raise click.UsageError("name a file, or --gyro, --camera and --capture, which are needed together")
    entries = []
    for entry in _entries(files, recording):
        entries.append(entry)
        # A reason is reported as the error, at the end.
        if not target.as_json and "reason" not in entry:
            say(*lines_of(entry))
    target.show({"files": entries})
    reasons = [entry["reason"] for entry in entries if "reason" in entry]
    if reasons:
        raise FileFormatError("; ".join(reasons))


def _entries(files: tuple[Path, ...], recording: Recording) -> Iterator[dict[str, Any]]:
    reading = {name.removeprefix("gyro_"): getattr(recording, name) for name in READING}
    for path in files:
        try:
            yield {"file": str(path)} | rs.describe(path, reading)
        except FileFormatError as error:
            # The command describes the other files first.
            yield {"file": str(path), "kind": "not understood", "reason": str(error)}
    if recording.capture is not None:
        coverage = _coverage(recording)
        yield {"file": str(recording.gyro), "kind": f"coverage of {recording.capture}", "exposures": coverage}


def _coverage(recording: Recording) -> list[dict[str, Any]]:
    log, camera = read_device(recording)
    acceleration = accelerometer(recording.gyro, recording.columns)
    report = []
    for exposure in read_captures(recording, recording.duration):
        opens, closes = exposure.span(camera)
        try:
            log.covering(opens - camera.time_offset, closes - camera.time_offset, exposure.epoch_ns)
            state = "complete"
        except CoverageError as error:
            state = str(error)
        start_ns = exposure.epoch_ns + round(exposure.start * 1e9)
        angle = None if acceleration is None else acceleration.gravity_angle(camera, exposure)
        gravity = {} if angle is None else {"gravity_deg": round(math.degrees(angle), 1)}
        report.append({"start_ns": start_ns, "duration_s": exposure.duration} | gravity | {"coverage": state})
    return report


def lines_of(entry: dict[str, Any]) -> Iterator[str]:
    """Yield the lines that show a result of `describe`."""
    yield f"{entry['file']}: {entry['kind']}"
    for key, value in entry.items():
        if key in ("file", "kind") or value in ([], None):
            continue
        if isinstance(value, list) and isinstance(value[0], (dict, list, str)):
            yield f"  {key}:"
            yield from (f"    {i}: {linked(rs.plain(item))}" for i, item in enumerate(value[:SHOWN]))
            if len(value) > SHOWN:
                yield f"    ... {len(value) - SHOWN} more, see --json"
        else:
            yield f"  {key}: {rs.plain(value)}"
