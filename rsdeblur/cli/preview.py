"""`rsdeblur preview`: a sheet of results for different clocks, sizes of the motion or drifts, to choose from by eye."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rsdeblur.cli import _options
from rsdeblur.cli._inputs import Inputs, display_values, transfer_of
from rsdeblur.cli._options import Command, Recording, Target, option
from rsdeblur.cli._output import print_json, progress, say
from rsdeblur.cli._photo import Prepared, prepare
from rsdeblur.cli._types import PATH, SECONDS, TextType, numbers
from rsdeblur.errors import CoverageError, InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.estimate.correction import Correction
    from rsdeblur.motion.camera import Camera
    from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur preview photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 \\
      --from -100ms --to 100ms --steps 9 -o sheet.png
  rsdeblur preview photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 \\
      --region 400,300,640,480 --from -8ms --to 8ms -o sheet.png --choose 5
  rsdeblur preview photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 \\
      --vary drift --from -6 --to 6 --steps 25 -o sheet.png
"""

# A sheet of more cells cannot be viewed at once.
MOST_STEPS = 100

Region = tuple[int, int, int, int]
Value = tuple[float, ...]
REGION = TextType("LEFT,TOP,WIDTH,HEIGHT", partial(numbers, example="400,300,640,480", kind=int, count=4))


class Variation(NamedTuple):
    """A number of the recording that a sheet can vary.

    `ends` are the first and the last value unless given, `correction` makes the fields of the correction, `text` the
    label, and `option` what other commands need, from the camera and the drift that result.
    """

    ends: tuple[float, float]
    correction: Callable[..., dict[str, float]]
    text: Callable[..., str]
    option: Callable[[Camera, tuple[float, float]], str]


VARIATIONS = {
    "offset": Variation(
        (-0.1, 0.1),
        lambda shift: {"offset": shift},
        lambda shift: f"{1e3 * shift:+.1f} ms",
        lambda camera, _: f"--time-offset {camera.time_offset:.7g}",
    ),
    "scale": Variation(
        (0.7, 1.4),
        lambda factor: {"scale": math.log(factor)},
        lambda factor: f"x {factor:.3g}",
        lambda camera, _: f"--focal-length {camera.focal_length[0]:.7g}",
    ),
    "readout": Variation(
        (0.5, 2.0),
        lambda factor: {"readout": math.log(factor)},
        lambda factor: f"x {factor:.3g}",
        lambda camera, _: f"--readout-time {camera.readout_time:.7g}",
    ),
    "drift": Variation(
        (-6.0, 6.0),
        lambda x, y: {"drift_x": x, "drift_y": y},
        lambda x, y: f"{x:+.1f}, {y:+.1f} px",
        lambda _, drift: f"--drift {drift[0]:.4g},{drift[1]:.4g}",
    ),
}


def _values(vary: str, first: float, last: float, steps: int) -> list[Value]:
    """Return the values, evenly spaced; factors by their ratio, and drifts along both axes."""
    import numpy as np

    if vary == "offset":
        return [(shift,) for shift in np.linspace(first, last, steps).tolist()]
    if vary == "drift":
        side = math.isqrt(steps)
        if side**2 != steps:
            raise click.UsageError(
                f"--steps of a drift is a square, along x times along y, like {side**2} or {(side + 1) ** 2}"
            )
        along = np.linspace(first, last, side).tolist()
        return [(x, y) for y, x in product(along, along)]
    if not min(first, last) > 0:
        raise click.UsageError(f"--from and --to are factors, which must be positive, got {first:g} and {last:g}")
    return [(factor,) for factor in np.geomspace(first, last, steps).tolist()]


class Cell(NamedTuple):
    """A result on the sheet, its value, the option that asks for it, and the kernel at the middle of the picture."""

    value: Value
    label: str
    option: str
    time_offset: float
    picture: NDArray[Any]
    kernel: NDArray[Any]


@click.command("preview", cls=Command, epilog=EXAMPLES)
@click.argument("photo", type=PATH)
@_options.recording_options(*_options.ONE_PHOTO)
@_options.solve_options(*_options.MANY_RESULTS)
@option(
    "--vary",
    type=click.Choice(list(VARIATIONS)),
    default="offset",
    show_default=True,
    help="The clock, the size of the motion, the readout time, or a drift that the gyro does not measure.",
)
@option(
    *("--from", "first"),
    type=SECONDS,
    metavar="VALUE",
    help="First value: a shift like -8ms, a factor, or px.  [default: -100ms, 0.7, 0.5 or -6]",
)
@option(*("--to", "last"), type=SECONDS, metavar="VALUE", help="Last value.  [default: 100ms, 1.4, 2 or 6]")
@option(
    "--steps",
    type=click.IntRange(1, MOST_STEPS),
    default=9,
    show_default=True,
    help="Number of values; for a drift, those along x times those along y.",
)
@option("--region", type=REGION, help="Use only this part of the picture, in px.")
@option(
    "--choose", type=click.IntRange(min=1), metavar="N", help="Write cell N's offset into the camera file, or frame it."
)
@_options.target_options("OUT", "Contact sheet to write.")
def command(
    photo: Path,
    recording: Recording,
    options: Options,
    vary: str,
    first: float | None,
    last: float | None,
    steps: int,
    region: Region | None,
    choose: int | None,
    target: Target,
) -> None:
    """Draw a sheet of results for PHOTO, to choose from by eye.

    The cells differ in the gyroscope's clock or, with --vary, in another number. Every cell shows its number, its
    value and the kernel at the middle of the picture. Shifts and factors are relative to the camera file, or to the
    options that replace its values. Shifts that the log does not cover are left out.
    """
    from rsdeblur.io.cameras import check_editable, write_time_offset
    from rsdeblur.io.picture_output import check_writable, write_picture
    from rsdeblur.report import contact_sheet

    check_writable(target.output, force=target.force)
    writes = choose is not None and vary == "offset"
    if writes:
        # Before the work: the file may be of a kind that has no place for the offset.
        check_editable(recording.camera)
    ends = VARIATIONS[vary].ends
    values = _values(vary, ends[0] if first is None else first, ends[1] if last is None else last, steps)
    cells = _cells(prepare(photo, recording, options), vary, values, region)
    if choose is not None and choose > len(cells):
        raise InputError(f"{photo}: there is no cell {choose}: the sheet has {len(cells)}")
    labelled = [(f"{n}: {cell.label}", cell.picture, cell.kernel) for n, cell in enumerate(cells, 1)]
    sheet = contact_sheet(labelled, marked=None if choose is None else choose - 1)
    write_picture(target.output, sheet, force=target.force)
    chosen = None if choose is None else cells[choose - 1]
    if writes and chosen is not None:
        write_time_offset(recording.camera, chosen.time_offset)
    if target.as_json:
        listed = [
            {"cell": n, "value": cell.value if vary == "drift" else cell.value[0], "option": cell.option}
            for n, cell in enumerate(cells, 1)
        ]
        marked = None if choose is None else listed[choose - 1]
        print_json({"output": str(target.output), "vary": vary, "cells": listed, "chosen": marked})
        return
    begin, end = (VARIATIONS[vary].text(*values[i]) for i in (0, -1))
    say(f"{target.output}: {len(cells)} of {len(values)} cells, {vary} {begin} to {end}")
    if chosen is not None:
        written = f"{recording.camera}: time_offset = {1e3 * chosen.time_offset:.2f} ms"
        say(written if writes else f"cell {choose}: {chosen.option}")


def _cells(ready: Prepared, vary: str, values: list[Value], region: Region | None) -> list[Cell]:
    """Deblur the photo, or a region of it, with every value that the log covers."""
    from rsdeblur.estimate import correction
    from rsdeblur.pipeline.plan import plan

    variation, (_, log, whole_camera, exposure) = VARIATIONS[vary], ready.inputs
    camera_file = ready.recording.camera
    if vary == "readout" and not whole_camera.readout_time > 0:
        raise InputError(f"{camera_file}: the readout time is 0; give one with --readout-time to vary it")
    whole = correction.Recording(log, whole_camera, exposure)
    ready = ready if region is None else _cut(ready, region)
    picture, _, camera, _ = ready.inputs
    options = replace(ready.options, check=False)
    given = correction.Recording(log, camera, exposure, options.translation)
    cells: list[Cell] = []
    error: CoverageError | None = None
    with progress("preview") as move, ready.naming:
        for i, value in enumerate(values):
            label = variation.text(*value)
            if move is not None:
                move(label, i / len(values))
            change: Correction = correction.Correction(**variation.correction(*value))
            varied = given.corrected(change)
            try:
                planned = plan(log, varied.camera, exposure, replace(options, translation=varied.translation))
            except CoverageError as uncovered:
                error = uncovered
                continue
            result = planned.apply(picture.pixels)
            bands, strips = (n // 2 for n in result.psfs.kernels.shape[:2])
            shown = display_values(result.image, transfer_of(picture, options.transfer))
            # A region has a readout and a clock of its own.
            used = whole.corrected(change).camera
            x, y = ready.recording.drift or (0.0, 0.0)
            asking = variation.option(used, (x + change.drift_x, y + change.drift_y))
            cells.append(Cell(value, label, asking, used.time_offset, shown, result.psfs.kernels[bands, strips]))
        if error is not None and not cells:
            raise error
    return cells


def _cut(ready: Prepared, region: Region) -> Prepared:
    """Return a photo of which only a region is deblurred."""
    (left, top, width, height), (picture, log, whole, exposure) = region, ready.inputs
    try:
        camera = whole.cropped(*region)
    except InputError as error:
        raise click.UsageError(f"--region: {error}") from error
    cut = replace(picture, pixels=picture.pixels[top : top + height, left : left + width])
    translation = ready.options.translation
    if translation is not None:
        translation = translation.cropped(whole, *region)
    options = replace(ready.options, translation=translation)
    return replace(ready, inputs=Inputs(cut, log, camera, exposure), options=options)
