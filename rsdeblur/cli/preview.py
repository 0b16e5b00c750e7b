"""`rsdeblur preview`: a sheet of results for shifted clocks, to choose from by eye."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import display_values, naming, read_inputs, transfer_of
from rsdeblur.cli._options import Recording, Target
from rsdeblur.cli._output import print_json, progress, say
from rsdeblur.cli._types import SecondsType
from rsdeblur.errors import CoverageError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.motion.camera import Camera
    from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur preview photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 \\
      --from -100ms --to 100ms --steps 9 -o sheet.png
  rsdeblur preview photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 \\
      --region 400,300,640,480 --from -8ms --to 8ms -o sheet.png --choose 5
"""

# A sheet of more cells cannot be viewed at once.
MOST_STEPS = 100

Region = tuple[int, int, int, int]


class RegionType(click.ParamType[Region]):
    """A part of the picture, `LEFT,TOP,WIDTH,HEIGHT`."""

    name = "LEFT,TOP,WIDTH,HEIGHT"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Region:
        """Return (left, top, width, height)."""
        try:
            left, top, width, height = (int(number) for number in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a region; write 400,300,640,480", param, ctx)
        return left, top, width, height


@dataclass(frozen=True, slots=True)
class Sweep:
    """Evenly spaced shifts of the gyroscope's clock, s."""

    first: float
    last: float
    steps: int


class Cell(NamedTuple):
    """A result on the sheet, its shift and time offset in s, and the kernel at the middle of the picture."""

    shift: float
    time_offset: float
    picture: NDArray[Any]
    kernel: NDArray[Any]


@click.command("preview", cls=Command, epilog=EXAMPLES)
@click.argument("photo", type=_options.PATH)
@_options.recording_options()
@_options.solve_options(*_options.BLUR, *_options.SOLVER, *_options.ONE_PICTURE, *_options.ENGINE)
@_options.gathered(
    "sweep",
    Sweep,
    (
        click.option("--from", "first", type=SecondsType(), default=-0.1, help="First shift.  [default: -100ms]"),
        click.option("--to", "last", type=SecondsType(), default=0.1, help="Last shift.  [default: 100ms]"),
        click.option(
            "--steps", type=click.IntRange(1, MOST_STEPS), default=9, show_default=True, help="Number of shifts."
        ),
    ),
)
@click.option("--region", type=RegionType(), help="Use only this part of the picture, in px.")
@click.option("--choose", type=click.IntRange(min=1), metavar="N", help="Write cell N's offset into the camera file.")
@_options.target_options("OUT", "Contact sheet to write.")
def command(
    photo: Path,
    recording: Recording,
    options: Options,
    sweep: Sweep,
    region: Region | None,
    choose: int | None,
    target: Target,
) -> None:
    """Draw a sheet of results for PHOTO with shifted clocks.

    Every cell shows its number, its shift of the gyroscope's clock and the kernel at the middle of the picture. Shifts
    are relative to the camera file's time offset, or to --time-offset; those that the log does not cover are left out.
    """
    from rsdeblur.io.camera_file import write_time_offset
    from rsdeblur.io.pictures import check_writable, write_picture
    from rsdeblur.report import contact_sheet

    check_writable(target.output, force=target.force)
    cells = _cells(photo, recording, options, sweep, region)
    if choose is not None and choose > len(cells):
        raise InputError(f"{photo}: there is no cell {choose}: the sheet has {len(cells)}")
    labelled = [
        (f"{number}: {1e3 * cell.shift:+.1f} ms", cell.picture, cell.kernel) for number, cell in enumerate(cells, 1)
    ]
    marked = None if choose is None else choose - 1
    write_picture(target.output, contact_sheet(labelled, marked=marked), force=target.force)
    listed = [
        {"cell": number, "shift_s": cell.shift, "time_offset_s": cell.time_offset}
        for number, cell in enumerate(cells, 1)
    ]
    chosen = None if choose is None else listed[choose - 1]
    if chosen is not None:
        write_time_offset(recording.camera, chosen["time_offset_s"])
    if target.as_json:
        print_json({"output": str(target.output), "cells": listed, "chosen": chosen})
        return
    say(f"{target.output}: {len(cells)} of {sweep.steps} shifts, {1e3 * sweep.first:g} to {1e3 * sweep.last:g} ms")
    if chosen is not None:
        say(f"{recording.camera}: time_offset = {1e3 * chosen['time_offset_s']:.2f} ms")


def _cells(photo: Path, recording: Recording, options: Options, sweep: Sweep, region: Region | None) -> list[Cell]:
    """Deblur the photo, or a region of it, with every shift that the log covers."""
    import numpy as np

    from rsdeblur.pipeline.plan import plan

    picture, log, camera, exposure = read_inputs(photo, recording)
    offset, pixels = camera.time_offset, picture.pixels
    if region is not None:
        pixels, camera = _cut(pixels, camera, region)
    transfer = transfer_of(picture, options.transfer)
    options = replace(options, transfer=transfer, check=False)
    cells: list[Cell] = []
    error: CoverageError | None = None
    with progress("preview") as move, naming(photo, recording):
        for i, shift in enumerate(np.linspace(sweep.first, sweep.last, sweep.steps).tolist()):
            if move is not None:
                move(f"{1e3 * shift:+.1f} ms", i / sweep.steps)
            try:
                result = plan(log, camera.delayed(shift), exposure, options).apply(pixels)
            except CoverageError as uncovered:
                error = uncovered
                continue
            bands, strips = (n // 2 for n in result.psfs.kernels.shape[:2])
            shown = display_values(result.image, transfer)
            cells.append(Cell(shift, offset + shift, shown, result.psfs.kernels[bands, strips]))
        if error is not None and not cells:
            raise error
    return cells


def _cut(pixels: NDArray[Any], camera: Camera, region: Region) -> tuple[NDArray[Any], Camera]:
    left, top, width, height = region
    part = camera.cropped(left, top, width, height)
    return pixels[top : top + height, left : left + width], part
