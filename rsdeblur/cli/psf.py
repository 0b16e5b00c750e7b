"""`rsdeblur psf`: draw and save the kernels of an exposure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import transfer_of
from rsdeblur.cli._options import Command, Recording, Target, option
from rsdeblur.cli._output import check_output, progress
from rsdeblur.cli._photo import prepare
from rsdeblur.cli._types import PATH
from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur psf --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o psfs.png
  rsdeblur psf --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 --bank psfs.npz --json
"""


@click.command("psf", cls=Command, epilog=EXAMPLES)
@_options.recording_options(*_options.ONE_PHOTO)
@_options.solve_options("mode", "bands", "strips", "motion", "softness", "nsr")
@option("--picture", "photo", type=PATH, metavar="PHOTO", help="Draw the kernels over this picture.")
@option("--bank", type=PATH, metavar="NPZ", help="Save the kernels and their places.")
@_options.target_options("PNG", "Draw the kernels at their places in the picture; without it, print their sizes only.")
def command(recording: Recording, options: Options, photo: Path | None, bank: Path | None, target: Target) -> None:
    """Compute the blur kernels of an exposure; needs no picture.

    `deblur` undoes the same kernels. The automatic numbers of tiles depend on --nsr; auto means 0.01 here.
    """
    output: Path | None = target.output
    if output is not None:
        rs.check_writable(output, force=target.force)
    if bank is not None:
        check_output(bank, force=target.force, suffixes=(".npz",), kind="a bank of kernels is an NPZ file")
    # Those of tiles, where the motion would choose rows.
    ready = prepare(photo, recording, replace(options, mode=options.mode_in_effect))
    picture, _, camera, _ = ready.inputs
    with progress("psf"):
        kernels, paths, _ = ready.kernels()
        if output is not None:
            with ready.naming:
                under = None if photo is None else rs.display_values(picture.pixels, transfer_of(picture, "auto"))
                drawing = rs.psf_map(kernels, (camera.height, camera.width), picture=under)
            rs.write_picture(output, drawing, force=target.force)
    if bank is not None:
        kernels.save(bank)
    bands, strips = paths.lengths.shape
    shortest, longest = float(paths.lengths.min()), float(paths.lengths.max())
    tall, wide = kernels.size
    facts = {
        "bands": bands,
        "strips": strips,
        "psf_px": [wide, tall],
        "rows": kernels.rows.tolist(),
        "cols": kernels.cols.tolist(),
        "path_px": {"shortest": shortest, "longest": longest},
    }
    grid = f"{bands} x {strips} kernels (bands x strips) of {wide} x {tall} px"
    target.show("psf", facts, f"{grid}, paths {shortest:.1f} to {longest:.1f} px long")
