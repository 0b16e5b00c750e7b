"""Deblurring of one photo, from its files to the written result: once in `deblur`, for every item in `batch`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rsdeblur.cli._gravity import bottom_of_photo, gravity_confirms, gravity_problem
from rsdeblur.cli._inputs import Inputs, naming, read_inputs, transfer_of, with_translation
from rsdeblur.cli._options import Recording, Track
from rsdeblur.cli._output import prepare_folder, say_detail
from rsdeblur.cli._refinement import refinement_facts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rsdeblur.choices import Mode
    from rsdeblur.pipeline.options import Options
    from rsdeblur.pipeline.plan import DeblurResult
    from rsdeblur.types import Progress


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoJob:
    """A photo to deblur, with its recording, options and output.

    `refine_anyway` refines where the options do although gravity contradicts the axes, as the user asked for it.
    """

    photo: Path
    recording: Recording
    options: Options
    output: Path
    track: Track = field(default_factory=Track)
    force: bool = False
    dry_run: bool = False
    make_folder: bool = False
    refine_anyway: bool = False


def prepare_result(output: Path, *, force: bool, dry_run: bool, make_folder: bool) -> None:
    """Check that a result can be written, and make its folder if `make_folder`; a dry run makes none.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from rsdeblur.io.picture_output import check_kind, check_writable

    if make_folder:
        prepare_folder(output.parent, [], force=force, dry_run=dry_run)
    if dry_run and make_folder and not output.parent.is_dir():
        check_kind(output)
    else:
        check_writable(output, force=force)


class Derived(NamedTuple):
    """Inputs of a photo, the options with all that these decide, and whether gravity confirms the camera's axes."""

    inputs: Inputs
    options: Options
    known_axes: bool


def derive(photo: Path, recording: Recording, options: Options, track: Track, *, refine_anyway: bool) -> Derived:
    """Read the inputs of a photo, and decide by them how it is deblurred.

    Parameters
    ----------
    photo : Path
        The photo.
    recording : Recording
        Names the log, the camera and the exposure.
    options : Options
        The options; with `max_memory`, the photo is mapped instead of read.
    track : Track
        Positions of the camera.
    refine_anyway : bool
        Refine where `options` do although gravity contradicts the axes.

    Raises
    ------
    RsdeblurError
        If a file is refused.
    click.UsageError
        If the options do not give the exposure.
    """
    inputs = read_inputs(photo, recording, in_place=options.max_memory is not None)
    picture, _, camera, exposure = inputs
    options = with_translation(options, track, camera, exposure)
    options = replace(options, transfer=transfer_of(picture, options.transfer))
    # With wrong axes, a correction may make the motion more like the right one, but never right.
    known = bottom_of_photo(picture.exif), recording, camera, [exposure]
    if options.refine and not refine_anyway and gravity_problem(photo, *known):
        say_detail(f"{photo}: recording not corrected, because of the direction of gravity; --refine does it anyway")
        options = replace(options, refine=False)
    return Derived(inputs, options, options.refine and gravity_confirms(*known))


def moment_facts(recording: Recording, inputs: Inputs) -> dict[str, float]:
    """Return the time offset that the picture determined, if its time is that of its EXIF block."""
    return {"time_offset_s": inputs.camera.time_offset} if recording.start == "exif" else {}


def moment_lines(facts: Mapping[str, Any]) -> list[str]:
    """Return a line about the start of an exposure whose time in EXIF is later, of which `moment_facts` are given."""
    if (offset := facts.get("time_offset_s")) is None:
        return []
    return [f"  The exposure began {abs(offset):.3f} s {'before' if offset > 0 else 'after'} the time in EXIF."]


def deblur_photo(job: PhotoJob, move: Progress | None = None) -> dict[str, Any]:
    """Deblur and write one photo, or only read and check its files, and return the facts to report.

    Raises
    ------
    RsdeblurError
        If a file is refused or the result cannot be written.
    click.UsageError
        If the options do not give the exposure.
    """
    from rsdeblur.io.picture_output import picture_to_fill

    prepare_result(job.output, force=job.force, dry_run=job.dry_run, make_folder=job.make_folder)
    in_place = job.options.max_memory is not None
    inputs, options, known_axes = derive(
        job.photo, job.recording, job.options, job.track, refine_anyway=job.refine_anyway
    )
    if job.dry_run:
        return _dry_run(job, inputs, options)
    picture, log, camera, exposure = inputs

    from rsdeblur.cli._stopwatch import stopwatch
    from rsdeblur.pipeline.plan import plan_for

    pixels = picture.pixels
    # The result goes into an array of the file's type: with 8 bits, a quarter of the memory of float32.
    with (
        stopwatch() as watch,
        picture_to_fill(job.output, pixels.shape, like=picture, force=job.force, in_place=in_place) as out,
        naming(job.photo, job.recording),
    ):
        planned = plan_for(pixels, log, camera, exposure, options, known_axes=known_axes, progress=move)
        result = planned.apply(pixels, out=out, progress=move)
    facts = facts_of(result, job.output, job.options.mode_in_effect, job.options.prior_name, watch.seconds)
    return facts | moment_facts(job.recording, inputs)


def facts_of(result: DeblurResult, output: Path, mode: Mode, prior: str, seconds: float) -> dict[str, Any]:
    """Return the facts to report about a written result."""
    return result_facts(result, output) | {
        "mode": mode,
        "prior": prior,
        "noise": result.noise,
        "seconds": seconds,
        "refinement": None if result.refinement is None else refinement_facts(result.refinement),
    }


def result_facts(result: DeblurResult, output: Path) -> dict[str, Any]:
    """Return the facts that `compare` reports about the result of each mode, too."""
    tall, wide = result.psfs.size
    return {
        "output": str(output),
        "bands": result.bands,
        "strips": result.strips,
        "psf_px": [wide, tall],
        "nsr": result.nsr,
        "weight": result.weight,
        "chroma": result.chroma,
        "timings": result.timings,
        "check": None if result.check is None else asdict(result.check),
    }


def _dry_run(job: PhotoJob, inputs: Inputs, options: Options) -> dict[str, Any]:
    """Check as much as possible without solving, and return the facts known by then."""
    from rsdeblur.image.encoded import check_size
    from rsdeblur.pipeline.deblur import psfs

    picture, log, camera, exposure = inputs
    with naming(job.photo, job.recording):
        check_size(picture.pixels.shape, camera)
        bank = psfs(
            *(log, camera, exposure),
            mode=options.mode_in_effect,
            bands=options.bands,
            strips=options.strips,
            motion=options.motion,
            translation=options.translation,
            softness=options.softness,
        )
    return {
        "output": str(job.output),
        "dry_run": True,
        "mode": options.mode_in_effect,
        "psf_px": [bank.size[1], bank.size[0]],
        "prior": options.prior_name,
        "size_px": [camera.width, camera.height],
    }
