"""One photo, from its files to the written result: what `deblur` does once and `batch` for every item."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsdeblur.cli._inputs import Inputs, naming, read_inputs, transfer_of
from rsdeblur.cli._options import Blur, Recording, Solver
from rsdeblur.cli._output import prepare_folder
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.io.pictures import Picture
    from rsdeblur.pipeline.settings import Mode
    from rsdeblur.types import Progress


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoJob:
    """What to deblur, how, and where to."""

    photo: Path
    recording: Recording
    mode: Mode
    blur: Blur
    solver: Solver
    work_size: int | None
    nsr_from_iso: bool
    max_memory: int | None
    fallback: bool
    output: Path
    force: bool = False
    dry_run: bool = False
    make_folder: bool = False


def deblur_photo(job: PhotoJob, move: Progress | None = None) -> dict[str, Any]:
    """Deblur and write one photo, or only read and check its files, and return the facts.

    Raises
    ------
    RsdeblurError
        If a file is refused or the result cannot be written.
    click.UsageError
        If the options do not give the exposure.
    """
    from rsdeblur.io.pictures import check_writable, picture_to_fill

    if job.make_folder and not job.dry_run:
        prepare_folder(job.output.parent, [], force=job.force)
    if not job.make_folder or job.output.parent.is_dir():
        check_writable(job.output, force=job.force)
    in_place = job.max_memory is not None
    inputs = read_inputs(job.photo, job.recording, in_place=in_place)
    if job.dry_run:
        return _foreseen(job, inputs)
    picture, log, camera, exposure = inputs

    from rsdeblur.image.encoded import reduced
    from rsdeblur.pipeline.deblur import deblur

    arguments = asdict(job.blur) | asdict(job.solver) | {"transfer": transfer_of(picture, job.solver.transfer)}
    if job.nsr_from_iso:
        arguments["nsr"] = _nsr_of(job.photo, picture)
    pixels = picture.pixels
    begin = time.perf_counter()
    if job.work_size is not None:
        with naming(job.photo, job.recording):
            pixels, camera = reduced(pixels, camera, job.work_size)
    # Straight into what is to be written: a quarter of the memory that float32 would take.
    with (
        picture_to_fill(job.output, pixels.shape, like=picture, force=job.force, in_place=in_place) as out,
        naming(job.photo, job.recording),
    ):
        result = deblur(
            *(pixels, log, camera, exposure),
            mode=job.mode,
            max_memory=job.max_memory,
            fallback=job.fallback,
            out=out,
            progress=move,
            **arguments,
        )
    seconds = time.perf_counter() - begin
    tall, wide = result.psfs.size
    return {
        "output": str(job.output),
        "mode": job.mode,
        "bands": result.bands,
        "strips": result.strips,
        "psf_px": [wide, tall],
        "prior": job.solver.prior,
        "nsr": result.nsr,
        "weight": result.weight,
        "seconds": seconds,
        "timings": result.timings,
        "check": None if result.check is None else asdict(result.check),
    }


def _foreseen(job: PhotoJob, inputs: Inputs) -> dict[str, Any]:
    """Check what can be checked without solving, and return what is known then."""
    from rsdeblur.image.encoded import check_size, reduced
    from rsdeblur.pipeline.deblur import psfs

    picture, log, camera, exposure = inputs
    with naming(job.photo, job.recording):
        check_size(picture.pixels.shape, camera)
        if job.nsr_from_iso:
            _nsr_of(job.photo, picture)
        if job.work_size is not None:
            camera = reduced(picture.pixels, camera, job.work_size)[1]
        bank = psfs(log, camera, exposure, mode=job.mode, **asdict(job.blur))
    return {
        "output": str(job.output),
        "dry_run": True,
        "mode": job.mode,
        "psf_px": [bank.size[1], bank.size[0]],
        "prior": job.solver.prior,
        "size_px": [camera.width, camera.height],
    }


def _nsr_of(photo: Path, picture: Picture) -> float:
    from rsdeblur.estimate.strength import nsr_of_iso
    from rsdeblur.io.exif import Exif

    iso = Exif(picture.exif).iso
    if iso is None:
        raise InputError(f"{photo}: the picture's EXIF block has no ISO sensitivity; give --nsr instead")
    return nsr_of_iso(iso)
