"""`rsdeblur psf`: draw and save the kernels of an exposure."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import (
    display_values,
    naming,
    read_inputs,
    read_recording,
    transfer_of,
    with_translation,
)
from rsdeblur.cli._options import Recording, Track
from rsdeblur.cli._output import print_json, progress, refuse_inputs, say
from rsdeblur.cli._types import PATH

if TYPE_CHECKING:
    from rsdeblur.motion.paths import BlurPaths
    from rsdeblur.pipeline.options import Options
    from rsdeblur.psf import PsfBank

EXAMPLES = """\b
Examples:
  rsdeblur psf --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o psfs.png
  rsdeblur psf --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 --bank psfs.npz --json
"""


@click.command("psf", cls=Command, epilog=EXAMPLES)
@_options.recording_options()
@_options.solve_options(*_options.BLUR, "nsr")
@_options.track_options
@click.option("-o", "--output", type=PATH, metavar="PNG", help="Draw the kernels at their places in the picture.")
@click.option("--picture", "photo", type=PATH, metavar="PHOTO", help="Draw the kernels over this picture.")
@click.option("--bank", type=PATH, metavar="NPZ", help="Save the kernels and their places.")
@_options.force_option
@_options.json_option
def command(
    recording: Recording,
    options: Options,
    track: Track,
    output: Path | None,
    photo: Path | None,
    bank: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Compute the blur kernels of an exposure; needs no picture.

    `deblur` undoes the same kernels. The automatic numbers of tiles depend on --nsr; auto means 0.01 here.
    """
    from rsdeblur._util.atomic import check_target
    from rsdeblur.io.picture_output import check_writable, write_picture

    if output is not None:
        refuse_inputs(output)
        check_writable(output, force=force)
    if bank is not None:
        if bank.suffix.lower() != ".npz":
            raise click.UsageError(f"--bank {bank}: a bank of kernels is an NPZ file; give it a name like kernels.npz")
        refuse_inputs(bank)
        check_target(bank, force=force)
    if photo is None:
        log, camera, exposure = read_recording(recording)
        picture = None
    else:
        pixels, log, camera, exposure = read_inputs(photo, recording)
        picture = display_values(pixels.pixels, transfer_of(pixels, "auto"))

    from rsdeblur.pipeline.deblur import NSR
    from rsdeblur.pipeline.plan import plan
    from rsdeblur.psf import PsfBank
    from rsdeblur.report import psf_map

    with progress("psf"), naming(photo, recording):
        planned = plan(log, camera, exposure, with_translation(options, track, camera, exposure))
        paths = planned.tile_paths(NSR if options.nsr == "auto" else options.nsr)
        kernels = planned.frame.bank(PsfBank.from_paths(paths))
        if output is not None:
            drawing = psf_map(kernels, (camera.height, camera.width), picture=picture)
            write_picture(output, drawing, force=force)
    if bank is not None:
        kernels.save(bank)
    lengths = paths.lengths
    summary = _summary(kernels, paths)
    if as_json:
        print_json(summary)
    else:
        wide, tall = summary["psf_px"]
        say(
            f"{summary['bands']} x {summary['strips']} kernels (bands x strips) of {wide} x {tall} px, "
            f"paths {lengths.min():.1f} to {lengths.max():.1f} px long"
        )


def _summary(bank: PsfBank, paths: BlurPaths) -> dict[str, Any]:
    bands, strips = paths.lengths.shape
    return {
        "bands": bands,
        "strips": strips,
        "psf_px": [bank.size[1], bank.size[0]],
        "rows": bank.rows.tolist(),
        "cols": bank.cols.tolist(),
        "path_px": {"shortest": float(paths.lengths.min()), "longest": float(paths.lengths.max())},
    }
