"""`rsdeblur deblur`: deblur one picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.choices import SHARP
from rsdeblur.cli import _options, _refinement
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import recordings_of
from rsdeblur.cli._items import numbered_from_option, one_name, result_name
from rsdeblur.cli._kernel import check_sources, deconvolve_photo
from rsdeblur.cli._options import PhotoTarget, Recording, Track
from rsdeblur.cli._output import (
    FAILURES,
    SOME_FAILED,
    print_json,
    progress,
    reason,
    refuse_inputs,
    say,
    say_aside,
)
from rsdeblur.cli._photo import PhotoJob, deblur_photo, moment_lines
from rsdeblur.cli._types import PATH
from rsdeblur.errors import OutputError

if TYPE_CHECKING:
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
@click.option("--psf", type=PATH, metavar="KERNEL", help="The blur as a kernel (picture, .npy) or PSF bank.")
@_options.recording_options(required=False)
@numbered_from_option
@_options.solve_options(*_options.ONE_PHOTO, *_options.ONE_RESULT)
@_refinement.option
@_options.track_options
@_options.photo_target_options
def command(
    photos: tuple[Path, ...],
    psf: Path | None,
    recording: Recording,
    numbered_from: int | None,
    options: Options,
    refine: bool | None,
    track: Track,
    target: PhotoTarget,
) -> None:
    """Deblur each PHOTO. Metadata, colour profile and bit depth are kept.

    The blur follows from a gyro log, a camera and an exposure, or is given as a kernel: --psf. Several photos share the
    log and the camera; their exposures come from EXIF, with --start exif, or from --capture, by the timestamps or frame
    numbers in their names. Exit code 3: some of them failed.
    """
    check_sources(click.get_current_context(), recording, psf)
    if psf is None:
        options = _refinement.with_refinement(options, refine)
    make_folder = _is_folder(target.output, len(photos))
    outputs = _outputs(photos, target.output, into_folder=make_folder)
    recordings = [recording] if psf is not None else recordings_of(photos, recording, numbered_from)

    def solve(i: int) -> dict[str, Any]:
        with progress("deblur") as move:
            if psf is not None:
                to = target.at(outputs[i])
                return deconvolve_photo(photos[i], psf, options, to, move, make_folder=make_folder)
            job = PhotoJob(
                photo=photos[i],
                recording=recordings[i],
                options=options,
                output=outputs[i],
                track=track,
                force=target.force,
                dry_run=target.dry_run,
                make_folder=make_folder,
                refine_anyway=bool(refine),
            )
            return deblur_photo(job, move)

    if len(photos) == 1:
        facts = solve(0)
        if target.as_json:
            print_json(facts)
        else:
            _print(photos[0], facts, options, asked=bool(refine))
        return
    entries = _solve_all(photos, solve)
    if target.as_json:
        print_json(entries)
    else:
        for photo, entry in zip(photos, entries, strict=True):
            if "error" not in entry:
                _print(photo, entry, options, asked=bool(refine))
    if any("error" in entry for entry in entries):
        click.get_current_context().exit(SOME_FAILED)


def _solve_all(photos: Sequence[Path], solve: Callable[[int], dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the facts about each photo, or its error, which is printed and does not stop the others."""
    entries: list[dict[str, Any]] = []
    for i, photo in enumerate(photos):
        entry: dict[str, Any] = {"photo": str(photo)}
        try:
            entry |= solve(i)
        except FAILURES as error:
            message = reason(error)
            entry["error"] = message if str(photo) in message else f"{photo}: {message}"
            say_aside(f"error: {entry['error']}")
        entries.append(entry)
    return entries


def _is_folder(output: Path | None, count: int) -> bool:
    """Whether results go into a folder, which need not exist: no picture is named without an extension."""
    return output is not None and (count > 1 or output.is_dir() or not output.suffix)


def _outputs(photos: Sequence[Path], output: Path | None, *, into_folder: bool) -> list[Path]:
    """Return the path of each photo's result.

    Raises
    ------
    OutputError
        If one is an input, or two are the same, or one file on many disks.
    """
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


def _print(photo: Path, facts: dict[str, Any], options: Options, *, asked: bool) -> None:
    """Print the facts about one result; why its recording was not refined only if that was asked for."""
    wide, tall = facts["psf_px"]
    if facts.get("dry_run"):
        size = "{} x {}".format(*facts["size_px"])
        say(
            f"{photo}: {size} px, all inputs fit; would write {facts['output']} ({facts['mode']}, PSFs of up to "
            f"{wide} x {tall} px, {options.prior_name})"
        )
        return
    tiles = "rows" if facts["mode"] == "rowwise" else "bands"
    kernels = f"{facts['bands']} x {facts['strips']} PSFs ({tiles} x strips) of {wide} x {tall} px"
    strength = f"NSR {facts['nsr']:.2g}" if facts["weight"] is None else f"weight {facts['weight']:.2g}"
    verdict, reasons = _verdict(facts["check"])
    seconds = f"{facts['seconds']:.2f} s"
    say(
        f"{facts['output']}: {facts['mode']}, {kernels}, {options.prior_name}, {strength}, {seconds}{verdict}",
        *reasons,
        *moment_lines(facts),
        *_refinement.correction_lines(facts["refinement"], asked=asked),
    )


def _verdict(check: dict[str, Any] | None) -> tuple[str, list[str]]:
    """Return the verdict of the check, and lines with its reasons."""
    if check is None:
        return "", []
    blended = ", blended towards the photo" if check["blended"] else ""
    reasons = [f"  {' '.join(check['reasons'])}"] if check["reasons"] else []
    return f"; {check['verdict']}{blended}", reasons
