"""`rsdeblur deblur`: deblur one picture; several are a batch."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from rsdeblur.choices import SHARP
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options, batch
from rsdeblur.cli._inputs import with_exif
from rsdeblur.cli._items import result_name
from rsdeblur.cli._options import RECORDING, Command, Recording, Target, option, refuse_given
from rsdeblur.cli._output import level, progress, refuse_inputs
from rsdeblur.cli._photo import PhotoJob, check_sources, deblur_photo
from rsdeblur.cli._types import PATH, NumberType
from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur deblur photo.jpg --gyro gyro.csv --camera phone.toml --start 12.5 --duration 1/20
  rsdeblur deblur a.jpg b.jpg --gyro Gyroscope.csv
  rsdeblur deblur photo.png --psf kernel.png
"""


def default_output(photos: tuple[Path, ...], **_: Any) -> Path:
    """Return where the results of photos go if no option says so."""
    if len(photos) > 1:
        return _options.beside(photos[0].parent, SHARP)
    name = result_name(photos[0])
    return name.with_name(f"{name.stem}{SHARP}{name.suffix}")


@click.command("deblur", cls=Command, epilog=EXAMPLES)
@click.argument("photos", type=PATH, metavar="PHOTO...", nargs=-1, required=True)
@_options.recording_options(*_options.ONE_PHOTO, "numbered_from", required=())
@option(
    "--psf",
    section=RECORDING,
    type=PATH,
    metavar="KERNEL",
    help="The blur as a kernel (picture, .npy) or PSF bank.",
)
@option("--psf-scale", section=RECORDING, type=NumberType(0.001, 10), metavar="N", help="Size of the blur over KERNEL.")
@option(
    "--save-camera",
    section=RECORDING,
    type=PATH,
    metavar="FILE",
    help="Write the camera as it was used, with what EXIF, gravity and the picture gave.",
)
@_options.solve_options(*(name for name in _options.SOLVE if name != "refine"))
@_options.refine_option
@_options.target_options(
    "OUT|DIR",
    "Picture to write; by default PHOTO-sharp beside it. Or a folder, for several photos by default that of the first "
    "one with -sharp after its name.",
    default=default_output,
    dry_run=True,
)
def command(
    photos: tuple[Path, ...],
    psf: Path | None,
    psf_scale: float | None,
    save_camera: Path | None,
    recording: Recording,
    options: Options,
    refine: bool | None,
    target: Target,
) -> None:
    """Deblur each PHOTO by a gyro log, a camera and an exposure, or by a kernel.

    What no option gives of camera and exposure comes from the EXIF block. Metadata, colour profile and bit depth are
    kept. Several photos are handled as by `rsdeblur batch`.
    """
    if len(photos) > 1:
        refuse_given("is for one photo; give one at a time", psf=psf, psf_scale=psf_scale, save_camera=save_camera)
        return batch.run(photos, recording, options, refine, target)
    refuse_given("is for several photos", numbered_from=recording.numbered_from)
    (photo,) = photos
    check_sources(recording, psf)
    if psf is None:
        refuse_given("is for --psf", psf_scale=psf_scale)
        recording, options = with_exif(recording, photo), _options.with_refinement(options, refine)
    output, name = target.output, result_name(photo).name
    # A folder need not exist: no picture is named without an extension.
    into_folder = output.is_dir() or not output.suffix
    if into_folder:
        output /= name
        refuse_inputs(output)
    job = PhotoJob(
        photo=photo,
        recording=recording,
        options=options,
        target=replace(target, output=output),
        psf=psf,
        psf_scale=psf_scale or 1.0,
        save_camera=save_camera,
        make_folder=into_folder,
        refine_anyway=bool(refine),
    )
    with progress("deblur") as move:
        facts = deblur_photo(job, move)
    if target.dry_run:
        size, kernels = (" x ".join(map(str, facts[name])) for name in ("size_px", "psf_px"))
        how = f"{facts['mode']}, PSFs of up to {kernels} px, {facts['prior']}"
        target.show(facts, f"{photo}: {size} px, all inputs fit; would write {output} ({how})")
        return
    asked = bool(refine) or level() > 0
    target.show(facts, f"{output}: {rs.summary(facts)}", *rs.remarks(facts, asked=asked))
