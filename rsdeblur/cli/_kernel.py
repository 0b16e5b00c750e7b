"""Deblurring of one photo with PSFs from a file, which needs neither log nor camera."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rsdeblur.cli._inputs import naming, transfer_of
from rsdeblur.cli._options import Recording, Target, Track
from rsdeblur.cli._photo import facts_of, prepare_result

if TYPE_CHECKING:
    from rsdeblur.pipeline.options import Options
    from rsdeblur.types import Progress

# Options that describe a motion, or depend on one.
MOTION = (
    *(field.name for kind in (Recording, Track) for field in fields(kind)),
    *("mode", "bands", "strips", "motion", "softness", "refine", "chroma", "geometry", "fallback", "numbered_from"),
)


def check_sources(context: click.Context, recording: Recording, psf: Path | None) -> None:
    """Raise `click.UsageError` unless the blur comes either from a recording or from a file of PSFs."""
    if psf is None:
        missing = [f"--{name}" for name in ("gyro", "camera") if getattr(recording, name) is None]
        if missing:
            raise click.UsageError(f"{' and '.join(missing)} missing: give a gyro log and a camera, or --psf", context)
        return
    given = [name for name in MOTION if context.get_parameter_source(name) is not ParameterSource.DEFAULT]
    if given:
        names = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise click.UsageError(f"--psf gives the blur itself, so these options have no meaning: {names}", context)


def deconvolve_photo(
    photo: Path,
    psf: Path,
    options: Options,
    target: Target,
    move: Progress | None = None,
    *,
    make_folder: bool = False,
) -> dict[str, Any]:
    """Deblur and write one photo, or only read and check its files, and return the facts to report.

    Raises
    ------
    RsdeblurError
        If a file is refused or the result cannot be written.
    """
    from rsdeblur.cli._stopwatch import stopwatch
    from rsdeblur.io.arrays import read_psfs
    from rsdeblur.io.picture_output import picture_to_fill
    from rsdeblur.io.pictures import read_picture
    from rsdeblur.pipeline.deconvolve import check_bank, deconvolve_with, mode_of

    prepare_result(target.output, force=target.force, dry_run=target.dry_run, make_folder=make_folder)
    in_place = options.max_memory is not None
    picture = read_picture(photo, in_place=in_place)
    pixels, bank = picture.pixels, read_psfs(psf, picture.pixels.shape)
    options = replace(options, transfer=transfer_of(picture, options.transfer), check=False)
    with naming(psf):
        check_bank(bank, pixels.shape)
    if target.dry_run:
        return {
            "output": str(target.output),
            "dry_run": True,
            "mode": mode_of(bank),
            "psf_px": [bank.size[1], bank.size[0]],
            "prior": options.prior_name,
            "size_px": [pixels.shape[1], pixels.shape[0]],
        }
    with (
        stopwatch() as watch,
        picture_to_fill(target.output, pixels.shape, like=picture, force=target.force, in_place=in_place) as out,
        naming(photo),
    ):
        result = deconvolve_with(options, pixels, bank, out=out, progress=move)
    return facts_of(result, target.output, mode_of(bank), options.prior_name, watch.seconds)
