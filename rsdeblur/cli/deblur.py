"""`rsdeblur deblur`: deblur one picture, or several of one recording."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from rsdeblur.choices import SHARP
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import recordings_of
from rsdeblur.cli._items import one_name, result_name
from rsdeblur.cli._options import RECORDING, Command, Recording, Target, option
from rsdeblur.cli._output import attempt, exit_if_failed, print_json, progress, refuse_inputs, say
from rsdeblur.cli._photo import PhotoJob, check_sources, deblur_photo, remarks, summary
from rsdeblur.cli._types import PATH
from rsdeblur.errors import OutputError
from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur deblur photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o sharp.jpg
  rsdeblur deblur photo.png --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 -o sharp.png
  rsdeblur deblur photo.tif --gyro log.gcsv --camera cam.toml --start 3 --duration 50ms --geometry rectify -o o.tif
  rsdeblur deblur a.jpg b.jpg --gyro Gyroscope.csv --camera phone.toml --start exif -o sharp
  rsdeblur deblur photo.png --psf kernel.png -o sharp.png
"""


@click.command("deblur", cls=Command, epilog=EXAMPLES)
@click.argument("photos", type=PATH, metavar="PHOTO...", nargs=-1, required=True)
@option(
    "--psf", section=RECORDING, type=PATH, metavar="KERNEL", help="The blur as a kernel (picture, .npy) or PSF bank."
)
@_options.recording_options(*_options.ONE_PHOTO, "numbered_from", required=())
@_options.solve_options(*(name for name in _options.SOLVE if name != "refine"))
@_options.refine_option
@_options.target_options(
    "OUT|DIR",
    "Picture to write, or folder for the results.  [default: PHOTO-sharp beside each photo]",
    required=False,
    dry_run=True,
)
def command(
    photos: tuple[Path, ...],
    psf: Path | None,
    recording: Recording,
    options: Options,
    refine: bool | None,
    target: Target,
) -> None:
    """Deblur each PHOTO. Metadata, colour profile and bit depth are kept.

    The blur follows from a gyro log, a camera and an exposure, or is given as a kernel: --psf. Several photos share the
    log and the camera; their exposures come from EXIF, with --start exif, or from --capture, by the timestamps or frame
    numbers in their names. Exit code 3: some of them failed.
    """
    check_sources(click.get_current_context(), recording, psf)
    if psf is None:
        options = _options.with_refinement(options, refine)
    # A folder need not exist: no picture is named without an extension.
    output: Path | None = target.output
    into_folder = output is not None and (len(photos) > 1 or output.is_dir() or not output.suffix)
    outputs = _outputs(photos, output, into_folder=into_folder)
    recordings = [recording] * len(photos) if psf is not None else recordings_of(photos, recording)

    def solve(i: int) -> dict[str, Any]:
        job = PhotoJob(
            photo=photos[i],
            recording=recordings[i],
            options=options,
            output=outputs[i],
            psf=psf,
            force=target.force,
            dry_run=target.dry_run,
            make_folder=into_folder,
            refine_anyway=bool(refine),
        )
        with progress("deblur") as move:
            return deblur_photo(job, move)

    if len(photos) == 1:
        entries = [solve(0)]
    else:
        entries = [attempt({"photo": str(photo)}, photo, partial(solve, i)) for i, photo in enumerate(photos)]
    if target.as_json:
        print_json(entries[0] if len(photos) == 1 else entries)
    else:
        for photo, entry in zip(photos, entries, strict=True):
            _print(photo, entry, asked=bool(refine))
    exit_if_failed(entries)


def _outputs(photos: Sequence[Path], output: Path | None, *, into_folder: bool) -> list[Path]:
    """Return the path of each photo's result."""
    names = [result_name(photo) for photo in photos]
    if output is None:
        results = [name.with_name(f"{name.stem}{SHARP}{name.suffix}") for name in names]
    else:
        results = [output / name.name for name in names] if into_folder else [output]
    known: dict[str, Path] = {}
    for photo, result in zip(photos, results, strict=True):
        refuse_inputs(result)
        # Beside each other, the photos show that their disk tells the names apart.
        other = known.setdefault(one_name(result) if into_folder else str(result), photo)
        if other is not photo:
            raise OutputError(
                f"{result}: {other} and {photo} have the same name, or one that differs only in case; deblur them "
                "into different folders"
            )
    return results


def _print(photo: Path, facts: dict[str, Any], *, asked: bool) -> None:
    """Print the facts about one result; why its recording was not refined only if that was asked for."""
    if facts.get("dry_run"):
        size, kernels = (" x ".join(map(str, facts[name])) for name in ("size_px", "psf_px"))
        say(
            f"{photo}: {size} px, all inputs fit; would write {facts['output']} ({facts['mode']}, PSFs of up to "
            f"{kernels} px, {facts['prior']})"
        )
    elif "error" not in facts:
        say(f"{facts['output']}: {summary(facts)}", *remarks(facts, asked=asked))
