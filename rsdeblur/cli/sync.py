"""`rsdeblur sync`: estimate the clock offset from the blur of one or several pictures."""

from pathlib import Path

import click

from rsdeblur.choices import Auto, Transfer
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _inputs, _options
from rsdeblur.cli._options import SERIES, Command, Recording, Target, option
from rsdeblur.cli._output import progress
from rsdeblur.cli._types import PATH, SECONDS

EXAMPLES = """\b
Examples:
  rsdeblur sync photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4
  rsdeblur sync photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 --write
  rsdeblur sync frame2.jpg frame5.jpg frame9.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv
"""


@click.command("sync", cls=Command, epilog=EXAMPLES)
@click.argument("photos", type=PATH, metavar="PHOTO...", nargs=-1, required=True)
@_options.recording_options(*SERIES)
@_options.transfer_option
@option(*("--from", "first"), type=SECONDS, help="First shift.  [default: -60ms, or -2s with --start exif]")
@option(*("--to", "last"), type=SECONDS, help="Last shift.  [default: 60ms, or 1s with --start exif]")
@option("--write", is_flag=True, help="Write the time offset into the camera file.")
@_options.target_options()
def command(
    photos: tuple[Path, ...],
    recording: Recording,
    transfer: Transfer | Auto,
    first: float | None,
    last: float | None,
    write: bool,
    target: Target,
) -> None:
    """Estimate the time offset of the clocks from the blur in PHOTO. Several PHOTOs share one.

    The time offset is camera time minus gyro time. Shifts are relative to the camera file's time offset, or to
    --time-offset. Exit code 1 means that the picture does not determine the offset: use one with more blur, and with
    motion that changes; or that the photos disagree. The moments of several photos come from --capture, by the
    timestamps or frame numbers in their names.
    """
    if first is not None and last is not None and first >= last:
        raise click.UsageError(f"--from {1e3 * first:g}ms must be less than --to {1e3 * last:g}ms")
    if write:
        # Before the search: the file may be of a kind that has no place for the offset.
        rs.check_editable(recording.camera)
    usual = _inputs.exif_error(photos[0]) if recording.start == "exif" else None
    inputs = []
    for photo, each in zip(photos, _inputs.recordings_of(photos, recording), strict=True):
        inputs.append(_inputs.read_inputs(photo, each))
        _inputs.photo_gravity(photo, inputs[-1], each)
    transfers = sorted({str(_inputs.transfer_of(each.picture, transfer)) for each in inputs})
    if len(transfers) > 1:
        raise click.UsageError(f"the photos encode light differently ({', '.join(transfers)}); give --transfer")
    with progress("sync") as move, _inputs.naming(photos[0] if len(photos) == 1 else None, recording):
        found = rs.find_time_offset(
            [each.picture.pixels for each in inputs],
            *(inputs[0].log, inputs[0].camera, [each.exposure for each in inputs]),
            search=_inputs.search_span(rs.find_time_offset, first, last, usual),
            transfer=_inputs.transfer_of(inputs[0].picture, transfer),
            progress=move,
        )
    lines, written = [], None
    if found.time_offset is not None:
        lines = [f"time offset {1e3 * found.time_offset:.1f} ms (+- {1e3 * found.sd:.1f})"]
        if write:
            rs.write_time_offset(recording.camera, found.time_offset)
            written = str(recording.camera)
            lines.append(f"written to {written}")
    target.show(rs.offset_facts(found) | {"written": written}, *lines)
    _inputs.check_offset(found, photos)
