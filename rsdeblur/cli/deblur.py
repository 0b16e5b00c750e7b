"""`rsdeblur deblur`: deblur one picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._kernel import check_sources, deconvolve_photo
from rsdeblur.cli._options import PhotoChanges, Recording, Target, Track
from rsdeblur.cli._output import print_json, progress, say
from rsdeblur.cli._photo import PhotoJob, deblur_photo

if TYPE_CHECKING:
    from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur deblur photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o sharp.jpg
  rsdeblur deblur photo.png --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20 -o sharp.png
  rsdeblur deblur photo.tif --gyro log.gcsv --camera cam.toml --start 3 --duration 50ms --geometry rectify -o o.tif
  rsdeblur deblur photo.png --psf kernel.png -o sharp.png
"""


@click.command("deblur", epilog=EXAMPLES)
@click.argument("photo", type=_options.PATH)
@click.option("--psf", type=_options.PATH, metavar="KERNEL", help="The blur as a kernel (picture, .npy) or PSF bank.")
@_options.recording_options(required=False)
@_options.solve_options(*_options.ONE_PHOTO, *_options.ONE_RESULT)
@_options.track_options
@_options.photo_options
@_options.target_options("OUT", "Picture to write.", dry_run=True)
def command(
    photo: Path,
    psf: Path | None,
    recording: Recording,
    options: Options,
    track: Track,
    changes: PhotoChanges,
    target: Target,
) -> None:
    """Deblur PHOTO; metadata, colour profile and bit depth are kept.

    The blur follows from a gyro log, a camera and an exposure, or is given as a kernel: --psf.
    """
    check_sources(click.get_current_context(), recording, psf)
    with progress("deblur") as move:
        if psf is not None:
            facts = deconvolve_photo(photo, psf, options, changes, target, move)
        else:
            job = PhotoJob(
                photo=photo,
                recording=recording,
                options=options,
                changes=changes,
                output=target.output,
                track=track,
                force=target.force,
                dry_run=target.dry_run,
            )
            facts = deblur_photo(job, move)
    if target.as_json:
        print_json(facts)
        return
    wide, tall = facts["psf_px"]
    if target.dry_run:
        size = "{} x {}".format(*facts["size_px"])
        say(
            f"{photo}: {size} px, all inputs fit; would write {target.output} ({facts['mode']}, PSFs of up to "
            f"{wide} x {tall} px, {options.prior})"
        )
        return
    tiles = "rows" if facts["mode"] == "rowwise" else "bands"
    kernels = f"{facts['bands']} x {facts['strips']} PSFs ({tiles} x strips) of {wide} x {tall} px"
    strength = f"NSR {facts['nsr']:.2g}" if facts["weight"] is None else f"weight {facts['weight']:.2g}"
    verdict, reasons = _verdict(facts["check"])
    say(
        f"{target.output}: {facts['mode']}, {kernels}, {options.prior}, {strength}, {facts['seconds']:.2f} s{verdict}",
        *reasons,
        *_correction(facts["refinement"]),
    )


def _verdict(check: dict[str, Any] | None) -> tuple[str, list[str]]:
    """Return the verdict of the check, and lines with its reasons."""
    if check is None:
        return "", []
    blended = ", blended towards the photo" if check["blended"] else ""
    # A good result has reasons too if a part of it could not be judged.
    reasons = [f"  {' '.join(check['reasons'])}"] if check["reasons"] else []
    return f"; {check['verdict']}{blended}", reasons


def _correction(refinement: dict[str, Any] | None) -> list[str]:
    """Return a line about the correction of the recording, if one was requested."""
    if refinement is None:
        return []
    if not refinement["accepted"]:
        return [f"  Recording not corrected: {refinement['reason']}."]
    values = refinement["values"]
    return [
        f"  Recording corrected: focal length x {math.exp(values['scale']):.3f}, drift {values['drift_x']:+.1f} and "
        f"{values['drift_y']:+.1f} px, time offset {1e3 * values['offset']:+.1f} ms, readout time x "
        f"{math.exp(values['readout']):.2f}, roll bias {values['roll']:+.3f} rad/s."
    ]
