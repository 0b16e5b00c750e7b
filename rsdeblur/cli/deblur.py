"""`rsdeblur deblur`: one sharp picture."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rsdeblur.cli import _options
from rsdeblur.cli._inputs import naming, read_inputs, transfer_of
from rsdeblur.cli._options import Blur, Recording, Solver
from rsdeblur.cli._output import print_json, progress
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.io.pictures import Picture
    from rsdeblur.method import Mode

EXAMPLES = """\b
Examples:
  rsdeblur deblur photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o sharp.jpg
  rsdeblur deblur photo.png --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 -o sharp.png
  rsdeblur deblur photo.tif --gyro log.gcsv --camera cam.toml --start 3 --duration 50ms --geometry rectify -o o.tif
"""


@click.command("deblur", epilog=EXAMPLES)
@click.argument("photo", type=_options.PATH)
@_options.recording_options
@_options.mode_option
@_options.blur_options
@_options.solver_options
@click.option(
    "--work-size",
    type=_options.WorkSizeType(),
    metavar="paper|full|N",
    help="Reduce the picture first: its longer side in px, paper means 2048.  [default: full]",
)
@click.option("--nsr-from-iso", is_flag=True, help="Take --nsr from the picture's EXIF sensitivity: 0.01 at ISO 100.")
@_options.max_memory_option
@click.option("-o", "--output", type=_options.PATH, required=True, metavar="OUT", help="Picture to write.")
@_options.force_option
@_options.json_option
def command(
    photo: Path,
    recording: Recording,
    mode: Mode,
    blur: Blur,
    solver: Solver,
    work_size: int | None,
    nsr_from_iso: bool,
    max_memory: int | None,
    output: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Deblur PHOTO; EXIF, colour profile and bit depth are kept."""
    from rsdeblur.io.pictures import check_writable, picture_to_fill

    check_writable(output, force=force)
    picture, log, camera, exposure = read_inputs(photo, recording, in_place=max_memory is not None)

    from rsdeblur.pipeline import deblur
    from rsdeblur.stored import reduced

    arguments = asdict(blur) | asdict(solver) | {"transfer": transfer_of(picture, solver.transfer)}
    if nsr_from_iso:
        arguments["nsr"] = _nsr_of(photo, picture)
    pixels = picture.pixels
    begin = time.perf_counter()
    if work_size is not None:
        with naming(photo, recording):
            pixels, camera = reduced(pixels, camera, work_size)
    # Straight into what is to be written: a quarter of the memory that float32 would take.
    with (
        picture_to_fill(output, pixels.shape, like=picture, force=force, in_place=max_memory is not None) as out,
        progress("deblur") as move,
        naming(photo, recording),
    ):
        result = deblur(
            *(pixels, log, camera, exposure),
            mode=mode,
            max_memory=max_memory,
            out=out,
            progress=move,
            **arguments,
        )
    seconds = time.perf_counter() - begin
    tall, wide = result.psfs.size
    if as_json:
        print_json(
            {
                "output": str(output),
                "mode": mode,
                "bands": result.bands,
                "strips": result.strips,
                "psf_px": [wide, tall],
                "prior": solver.prior,
                "nsr": result.nsr,
                "weight": result.weight,
                "seconds": seconds,
                "timings": result.timings,
            }
        )
    else:
        tiles = "rows" if mode == "rowwise" else "bands"
        kernels = f"{result.bands} x {result.strips} PSFs ({tiles} x strips) of {wide} x {tall} px"
        strength = f"NSR {result.nsr:.2g}" if result.weight is None else f"weight {result.weight:.2g}"
        click.echo(f"{output}: {mode}, {kernels}, {solver.prior}, {strength}, {seconds:.2f} s")


def _nsr_of(photo: Path, picture: Picture) -> float:
    from rsdeblur.io.exif import Exif
    from rsdeblur.tuning import nsr_of_iso

    iso = Exif(picture.exif).iso
    if iso is None:
        raise InputError(f"{photo}: the picture's EXIF block has no ISO sensitivity; give --nsr instead")
    return nsr_of_iso(iso)
