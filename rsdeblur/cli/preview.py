"""`rsdeblur preview`: a sheet of results for different clocks, sizes of the motion or drifts, to choose from by eye."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import Inputs, display_values, naming, read_inputs, transfer_of, with_translation
from rsdeblur.cli._options import Recording, Target, Track
from rsdeblur.cli._output import print_json, progress, say
from rsdeblur.cli._types import PATH, SecondsType
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


Varied = Literal["offset", "scale", "readout", "drift"]
Value = tuple[float, ...]


def _shifts(first: float, last: float, steps: int) -> list[Value]:
    import numpy as np

    return [(shift,) for shift in np.linspace(first, last, steps).tolist()]


def _factors(first: float, last: float, steps: int) -> list[Value]:
    import numpy as np

    if not min(first, last) > 0:
        raise click.UsageError(f"--from and --to are factors, which must be positive, got {first:g} and {last:g}")
    return [(factor,) for factor in np.geomspace(first, last, steps).tolist()]


def _drifts(first: float, last: float, steps: int) -> list[Value]:
    side = math.isqrt(steps)
    if side**2 != steps:
        raise click.UsageError(
            f"--steps of a drift is a square, along x times along y, like {side**2} or {(side + 1) ** 2}"
        )
    along = _shifts(first, last, side)
    return [x + y for y, x in product(along, along)]


@dataclass(frozen=True, slots=True)
class Variation:
    """A number of the recording that a sheet can vary.

    Parameters
    ----------
    ends : (float, float)
        First and last value unless given: a shift in s, factors, px.
    values : callable
        Returns the values, given the first, the last and their number.
    correction : callable
        Returns the fields of the correction that a value makes.
    text : callable
        Returns a value as text.
    option : callable
        Returns the option that other commands need, given the camera and the drift that result from a value.
    """

    ends: tuple[float, float]
    values: Callable[[float, float, int], list[Value]]
    correction: Callable[..., dict[str, float]]
    text: Callable[..., str]
    option: Callable[[Camera, tuple[float, float]], str]


VARIATIONS: dict[Varied, Variation] = {
    "offset": Variation(
        (-0.1, 0.1),
        _shifts,
        lambda shift: {"offset": shift},
        lambda shift: f"{1e3 * shift:+.1f} ms",
        lambda camera, _: f"--time-offset {camera.time_offset:.7g}",
    ),
    "scale": Variation(
        (0.7, 1.4),
        _factors,
        lambda factor: {"scale": math.log(factor)},
        lambda factor: f"x {factor:.3g}",
        lambda camera, _: f"--focal-length {camera.focal_length[0]:.7g}",
    ),
    "readout": Variation(
        (0.5, 2.0),
        _factors,
        lambda factor: {"readout": math.log(factor)},
        lambda factor: f"x {factor:.3g}",
        lambda camera, _: f"--readout-time {camera.readout_time:.7g}",
    ),
    "drift": Variation(
        (-6.0, 6.0),
        _drifts,
        lambda x, y: {"drift_x": x, "drift_y": y},
        lambda x, y: f"{x:+.1f}, {y:+.1f} px",
        lambda _, drift: f"--drift {drift[0]:.4g},{drift[1]:.4g}",
    ),
}


@dataclass(frozen=True, slots=True)
class Sweep:
    """What the sheet varies, and from where to where: shifts of the clock in s, factors, or px."""

    vary: Varied
    first: float | None
    last: float | None
    steps: int

    @property
    def variation(self) -> Variation:
        """The variation that `vary` names."""
        return VARIATIONS[self.vary]

    def values(self) -> list[Value]:
        """Return the values, evenly spaced; factors by their ratio, and drifts along both axes.

        Raises
        ------
        click.UsageError
            If a factor is not positive, or the number of drifts is not a square.
        """
        first, last = (
            default if given is None else given
            for given, default in zip((self.first, self.last), self.variation.ends, strict=True)
        )
        return self.variation.values(first, last, self.steps)

    def correction(self, value: Value) -> Correction:
        """Return the correction of the recording with a value."""
        from rsdeblur.estimate.correction import Correction

        return Correction(**self.variation.correction(*value))

    def label(self, value: Value) -> str:
        """Return a value as text."""
        return self.variation.text(*value)


class Cell(NamedTuple):
    """A result on the sheet, its value, the option that asks for it, and the kernel at the middle of the picture."""

    value: Value
    option: str
    time_offset: float
    picture: NDArray[Any]
    kernel: NDArray[Any]


@click.command("preview", cls=Command, epilog=EXAMPLES)
@click.argument("photo", type=PATH)
@_options.recording_options()
@_options.track_options
@_options.solve_options(*_options.BLUR, *_options.SOLVER, *_options.ONE_PICTURE, *_options.ENGINE)
@_options.gathered(
    "sweep",
    Sweep,
    (
        click.option(
            "--vary",
            type=click.Choice(list(VARIATIONS)),
            default="offset",
            show_default=True,
            help="The clock, the size of the motion, the readout time, or a drift that the gyro does not measure.",
        ),
        click.option(
            "--from",
            "first",
            type=SecondsType(),
            metavar="VALUE",
            help="First value: a shift like -8ms, a factor, or px.  [default: -100ms, 0.7, 0.5 or -6]",
        ),
        click.option(
            "--to", "last", type=SecondsType(), metavar="VALUE", help="Last value.  [default: 100ms, 1.4, 2 or 6]"
        ),
        click.option(
            "--steps",
            type=click.IntRange(1, MOST_STEPS),
            default=9,
            show_default=True,
            help="Number of values; for a drift, those along x times those along y.",
        ),
    ),
)
@click.option("--region", type=RegionType(), help="Use only this part of the picture, in px.")
@click.option(
    "--choose", type=click.IntRange(min=1), metavar="N", help="Write cell N's offset into the camera file, or frame it."
)
@_options.target_options("OUT", "Contact sheet to write.")
def command(
    photo: Path,
    recording: Recording,
    track: Track,
    options: Options,
    sweep: Sweep,
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
    if choose is not None and sweep.vary == "offset":
        # Before the work: the file may be of a kind that has no place for the offset.
        check_editable(recording.camera)
    values = sweep.values()
    cells = _cells(photo, recording, track, options, sweep, region)
    if choose is not None and choose > len(cells):
        raise InputError(f"{photo}: there is no cell {choose}: the sheet has {len(cells)}")
    labelled = [
        (f"{number}: {sweep.label(cell.value)}", cell.picture, cell.kernel) for number, cell in enumerate(cells, 1)
    ]
    marked = None if choose is None else choose - 1
    write_picture(target.output, contact_sheet(labelled, marked=marked), force=target.force)
    listed = [
        {"cell": number, "value": cell.value if len(cell.value) > 1 else cell.value[0], "option": cell.option}
        for number, cell in enumerate(cells, 1)
    ]
    if marked is not None and sweep.vary == "offset":
        write_time_offset(recording.camera, cells[marked].time_offset)
    if target.as_json:
        chosen = None if marked is None else listed[marked]
        print_json({"output": str(target.output), "vary": sweep.vary, "cells": listed, "chosen": chosen})
        return
    first, last = (sweep.label(values[end]) for end in (0, -1))
    say(f"{target.output}: {len(cells)} of {len(values)} cells, {sweep.vary} {first} to {last}")
    if marked is not None and sweep.vary == "offset":
        say(f"{recording.camera}: time_offset = {1e3 * cells[marked].time_offset:.2f} ms")
    elif marked is not None:
        say(f"cell {choose}: {cells[marked].option}")


def _cells(
    photo: Path, recording: Recording, track: Track, options: Options, sweep: Sweep, region: Region | None
) -> list[Cell]:
    """Deblur the photo, or a region of it, with every value that the log covers."""
    from rsdeblur.estimate import correction
    from rsdeblur.pipeline.plan import plan

    inputs = read_inputs(photo, recording)
    if sweep.vary == "readout" and not inputs.camera.readout_time > 0:
        raise InputError(f"{recording.camera}: the readout time is 0; give one with --readout-time to vary it")
    whole = correction.Recording(inputs.log, inputs.camera, inputs.exposure)
    options = with_translation(options, track, inputs.camera, inputs.exposure)
    if region is not None:
        if options.translation is not None:
            options = replace(options, translation=options.translation.cropped(inputs.camera, *region))
        inputs = _cut(inputs, region)
    picture, log, camera, exposure = inputs
    transfer = transfer_of(picture, options.transfer)
    options = replace(options, transfer=transfer, check=False)
    given = correction.Recording(log, camera, exposure, options.translation)
    cells: list[Cell] = []
    error: CoverageError | None = None
    values = sweep.values()
    with progress("preview") as move, naming(photo, recording):
        for i, value in enumerate(values):
            if move is not None:
                move(sweep.label(value), i / len(values))
            change = sweep.correction(value)
            varied = given.corrected(change)
            try:
                planned = plan(log, varied.camera, exposure, replace(options, translation=varied.translation))
            except CoverageError as uncovered:
                error = uncovered
                continue
            result = planned.apply(picture.pixels)
            bands, strips = (n // 2 for n in result.psfs.kernels.shape[:2])
            shown = display_values(result.image, transfer)
            # A region has a readout and a clock of its own.
            used = whole.corrected(change).camera
            x, y = track.drift or (0.0, 0.0)
            option = sweep.variation.option(used, (x + change.drift_x, y + change.drift_y))
            cells.append(Cell(value, option, used.time_offset, shown, result.psfs.kernels[bands, strips]))
        if error is not None and not cells:
            raise error
    return cells


def _cut(inputs: Inputs, region: Region) -> Inputs:
    left, top, width, height = region
    try:
        camera = inputs.camera.cropped(left, top, width, height)
    except InputError as error:
        raise click.UsageError(f"--region: {error}") from error
    pixels = inputs.picture.pixels[top : top + height, left : left + width]
    return inputs._replace(picture=replace(inputs.picture, pixels=pixels), camera=camera)
