"""`rsdeblur sync`: estimate the clock offset from the blur of a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import check_offset, naming, read_inputs, transfer_of
from rsdeblur.cli._options import Recording
from rsdeblur.cli._output import print_json, progress, say
from rsdeblur.cli._types import SecondsType

if TYPE_CHECKING:
    from rsdeblur.choices import Auto, Transfer

# Shifts to try, s.
SEARCH = (-0.06, 0.06)

EXAMPLES = """\b
Examples:
  rsdeblur sync photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4
  rsdeblur sync photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 --from -100ms --to 100ms \\
      --write
"""


@click.command("sync", cls=Command, epilog=EXAMPLES)
@click.argument("photo", type=_options.PATH)
@_options.recording_options()
@_options.transfer_option
@click.option("--from", "first", type=SecondsType(), help="First shift.  [default: -60ms, or -2s with --start exif]")
@click.option("--to", "last", type=SecondsType(), help="Last shift.  [default: 60ms, or 1s with --start exif]")
@click.option("--write", is_flag=True, help="Write the time offset into the camera file.")
@_options.json_option
def command(
    photo: Path,
    recording: Recording,
    transfer: Transfer | Auto,
    first: float | None,
    last: float | None,
    write: bool,
    as_json: bool,
) -> None:
    """Estimate the clocks' time offset from the blur in PHOTO.

    The time offset is camera time minus gyro time. Shifts are relative to the camera file's time offset, or to
    --time-offset. Exit code 1 means that the picture does not determine the offset: use one with more blur, and with
    motion that changes.
    """
    from rsdeblur.estimate.time_offset import find_time_offset
    from rsdeblur.io.camera_file import write_time_offset
    from rsdeblur.io.exif_times import EXIF_ERROR

    usual = EXIF_ERROR if recording.start == "exif" else SEARCH
    picture, log, camera, exposure = read_inputs(photo, recording, search=False)
    with progress("sync") as move, naming(photo, recording):
        result = find_time_offset(
            picture.pixels,
            log,
            camera,
            exposure,
            search=(usual[0] if first is None else first, usual[1] if last is None else last),
            transfer=transfer_of(picture, transfer),
            progress=move,
        )
    is_written = write and result.time_offset is not None
    if is_written and result.time_offset is not None:
        write_time_offset(recording.camera, result.time_offset)
    if as_json:
        print_json(
            {
                "time_offset_s": result.time_offset,
                "best_s": result.best,
                "confidence": result.confidence,
                "reason": result.reason,
                "written": str(recording.camera) if is_written else None,
                "offsets_s": result.offsets.tolist(),
                "scores": result.scores.tolist(),
            }
        )
    check_offset(result, photo)
    if not as_json and result.time_offset is not None:
        place = f"; written to {recording.camera}" if is_written else ""
        say(f"time offset {1e3 * result.time_offset:.1f} ms, confidence {result.confidence:.2f}{place}")
