"""`rsdeblur psf`: draw and save the kernels of an exposure."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.files import atomic_write
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import transfer_of
from rsdeblur.cli._options import Command, Recording, Target, option, refuse_given, require
from rsdeblur.cli._output import check_output, progress
from rsdeblur.cli._photo import check_sources, prepare
from rsdeblur.cli._types import PATH, NumberType, TextType, numbers
from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur psf --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o psfs.png
  rsdeblur psf --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 --bank psfs.npz --json
  rsdeblur psf --line 12,30 --disc 4 --gauss 1.2 -o kernel.png
"""
LINE = TextType("LENGTH,ANGLE", partial(numbers, example="12,30 (px and degrees)", count=2))


@click.command("psf", cls=Command, epilog=EXAMPLES)
@_options.recording_options(*_options.ONE_PHOTO, required=())
@_options.solve_options("mode", "bands", "strips", "motion", "softness", "nsr")
@option("--picture", "photo", type=PATH, metavar="PHOTO", help="Draw the kernels over this picture.")
@option("--bank", type=PATH, metavar="NPZ", help="Save the kernels and their places.")
@option("--path", type=PATH, metavar="CSV", help="Save the paths: row and column, t (s), x and y (px).")
@option("--line", type=LINE, help="Straight motion in px and degrees, instead of a log.")
@option("--disc", type=NumberType(0, 200), help="Diameter of the defocus in px, instead of a log.")
@option("--gauss", type=NumberType(0, 30), help="Standard deviation of a Gaussian in px, instead of a log.")
@_options.target_options("PNG", "Draw the kernels at their places in the picture; without it, print their sizes only.")
def command(
    recording: Recording,
    options: Options,
    photo: Path | None,
    bank: Path | None,
    path: Path | None,
    target: Target,
    **shape: Any,
) -> None:
    """Compute the blur kernels of an exposure; needs no picture. Or one kernel from a line, a disc and a Gaussian.

    `deblur` undoes the same kernels. The automatic numbers of tiles depend on --nsr; auto means 0.01 here. A kernel of
    --line, --disc and --gauss, which are convolved, is written to a PNG, NPY or NPZ file for `deblur --psf`.
    """
    output: Path | None = target.output
    if shape := {name: value for name, value in shape.items() if value is not None}:
        refuse_given("has no meaning with --line, --disc or --gauss", picture=photo, bank=bank, path=path)
        check_sources(recording, shape)
        return _draw(shape, target)
    require(recording, "gyro", "camera")
    if path is not None:
        check_output(path, force=target.force, suffixes=(".csv",), kind="paths are a CSV file")
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
    if path is not None:
        _save_paths(path, kernels, ready.inputs.exposure.duration)
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
    place = "" if target.output is None else f"{target.output}: "
    target.show(facts, f"{place}{grid}, paths {shortest:.1f} to {longest:.1f} px long")


def _save_paths(path: Path, bank: rs.PsfBank, duration: float) -> None:
    """Write the paths of a bank, at times relative to the middle of each place's exposure."""
    import numpy as np

    paths = bank.displacements
    assert paths is not None
    bands, strips, samples, _ = paths.shape
    places = np.repeat(bank.centres.reshape(-1, 2), samples, axis=0)
    t = np.tile(duration * np.linspace(-0.5, 0.5, samples), bands * strips)
    table = np.column_stack([places, t, paths.reshape(-1, 2)])
    with atomic_write(path) as file:
        np.savetxt(file, table, fmt="%.9g", delimiter=",", header="row,column,t,x,y", comments="")


def _draw(shape: dict[str, Any], target: Target) -> None:
    """Write a parametric kernel: a picture or an array with its peak 1, or a bank."""
    output = target.output
    if output is None:
        raise click.UsageError("a kernel of --line, --disc and --gauss needs -o")
    check_output(output, force=target.force, suffixes=(".png", ".npy", ".npz"), kind="a kernel is PNG, NPY or NPZ")
    bank = rs.PsfBank.parametric(**shape)
    kernel, suffix = bank.kernels[0, 0], output.suffix.lower()
    if suffix == ".npz":
        bank.save(output)
    else:
        rs.write_picture(output, kernel / kernel.max(), bits=16 if suffix == ".png" else 32, force=target.force)
    tall, wide = bank.size
    facts = {"bands": 1, "strips": 1, "psf_px": [wide, tall], "rows": [0.0], "cols": [0.0]}
    target.show(facts, f"{output}: a kernel of {wide} x {tall} px")
