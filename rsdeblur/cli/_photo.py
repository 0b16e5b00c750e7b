"""One photo, from its files to the plan and the written result: the same preparation in every command."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from rsdeblur._util.files import check_target
from rsdeblur.choices import Mode
from rsdeblur.cli import _engine as rs
from rsdeblur.cli._inputs import (
    Inputs,
    naming,
    photo_gravity,
    read_inputs,
    read_recording,
    transfer_of,
    with_axes_of,
    with_offset,
)
from rsdeblur.cli._options import ONE_PHOTO, Recording, flag, refuse_given, require
from rsdeblur.cli._output import LOG, prepare_folder
from rsdeblur.pipeline.options import BLUR, Options

Elapsed = Callable[[], float]


@dataclass(frozen=True, slots=True)
class Prepared:
    """A photo that is ready to be planned, with options that its files decide; without a photo, its picture is None."""

    inputs: Inputs
    options: Options
    gravity: rs.Gravity
    photo: Path | None
    recording: Recording

    @property
    def naming(self) -> Any:
        """Context that names the file at fault in errors."""
        return naming(self.photo, self.recording)

    def plan(self, move: rs.Progress | None = None, options: Options | None = None) -> rs.Plan:
        """Plan the deblurring, and refine the recording first if the options do."""
        picture, log, camera, exposure = self.inputs
        known = self.options.refine and self.gravity.side == "bottom"
        options = options or self.options
        return rs.plan_for(picture.pixels, log, camera, exposure, options, known_axes=known, progress=move)

    def kernels(self) -> tuple[rs.PsfBank, rs.BlurPaths, Mode]:
        """Return the PSFs of the recording as the files give it, their paths, and the mode."""
        nsr = self.options.nsr
        _, log, camera, exposure = self.inputs
        with self.naming:
            planned = rs.plan(log, camera, exposure, replace(self.options, refine=False))
            paths = planned.tile_paths(rs.NSR if nsr == "auto" else nsr)
            return planned.frame.bank(rs.PsfBank.from_paths(paths)), paths, planned.options.mode_in_effect


def prepare(
    photo: Path | None,
    recording: Recording,
    options: Options,
    *,
    refine_anyway: bool = True,
    inputs: Inputs | None = None,
) -> Prepared:
    """Read the inputs of a photo unless they are given, and decide by them how it is deblurred."""
    gravity = rs.Gravity()
    if photo is None:
        picture: Any = None
        inputs = Inputs(picture, *read_recording(recording))
    else:
        is_timed = inputs is not None or recording.start != "exif"
        inputs = inputs or read_inputs(photo, recording)
        gravity = photo_gravity(photo, inputs, recording)
        if gravity.contradicts and not refine_anyway:
            given, inputs = inputs, with_axes_of(gravity, inputs, photo)
            gravity = gravity if inputs is given else rs.Gravity("bottom")
        inputs = inputs if is_timed else with_offset(inputs, photo)
        options = replace(options, transfer=transfer_of(inputs.picture, options.transfer))
    # With wrong axes, a correction may make the motion more like the right one, but never right.
    if options.refine and gravity.contradicts and not refine_anyway:
        LOG.info("%s: recording not corrected, because of the direction of gravity; --refine does it anyway", photo)
        options = replace(options, refine=False)
    if recording.drift is not None:
        with naming("--drift"):
            drift = rs.Translation.drift(recording.drift, inputs.camera, inputs.exposure)
        options = replace(options, translation=drift)
    return Prepared(inputs, options, gravity, photo, recording)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoJob:
    """A photo to deblur, with its recording or the file of its PSFs, options and output."""

    photo: Path
    recording: Recording
    options: Options
    output: Path
    psf: Path | None = None
    save_camera: Path | None = None
    force: bool = False
    dry_run: bool = False
    make_folder: bool = False
    refine_anyway: bool = False


def check_sources(context: click.Context, recording: Recording, psf: object) -> None:
    """Raise `click.UsageError` unless the blur comes either from a recording or from a kernel, `psf`."""
    if psf is None:
        require(recording, "gyro")
        return
    blur = [each.name for each in fields(Options) if each.metadata.get("section") == BLUR]
    # Kernels have no half colours, and results no verdict.
    motion = (*ONE_PHOTO, *blur, "chroma", "fallback")
    unset = None, ParameterSource.DEFAULT
    given = ", ".join(flag(name) for name in motion if context.get_parameter_source(name) not in unset)
    if given:
        raise click.UsageError(f"the kernel is the blur itself, so these options have no meaning: {given}", context)


def deblur_photo(job: PhotoJob, move: rs.Progress | None = None) -> dict[str, Any]:
    """Deblur and write one photo, or only read and check its files, and return the facts to report."""
    with stopwatch() as elapsed:
        return _deblur(job, move, elapsed)


def _deblur(job: PhotoJob, move: rs.Progress | None, elapsed: Elapsed) -> dict[str, Any]:
    if job.make_folder:
        prepare_folder(job.output.parent, [], force=job.force, dry_run=job.dry_run)
    if job.dry_run and job.make_folder and not job.output.parent.is_dir():
        rs.check_kind(job.output)
    else:
        rs.check_writable(job.output, force=job.force)
    if job.psf is not None:
        refuse_given("is for a camera, which --psf does without", save_camera=job.save_camera)
        return _deconvolve(job, job.psf, move, elapsed)
    if job.save_camera is not None:
        check_target(job.save_camera, force=job.force)
    ready = prepare(job.photo, job.recording, job.options, refine_anyway=job.refine_anyway)
    if job.dry_run:
        with ready.naming:
            rs.check_size(ready.inputs.picture.pixels.shape, ready.inputs.camera)
        # As much as possible is checked without solving.
        bank, _, mode = ready.kernels()
        return _planned(job, bank, mode, ready.inputs.picture)

    def solve(out: Any) -> rs.DeblurResult:
        with ready.naming:
            result = ready.plan(move).apply(ready.inputs.picture.pixels, out=out, progress=move)
        if job.save_camera is not None:
            camera = ready.inputs.camera if result.refinement is None else result.refinement.camera
            # How far EXIF is from the moment belongs to the photo.
            camera = replace(camera, time_offset=0.0) if ready.recording.start == "exif" else camera
            camera.save(job.save_camera)
        return result

    facts = _written(job, ready.inputs.picture, solve, elapsed)
    return facts | moment_facts(job.recording, ready.inputs)


def _deconvolve(job: PhotoJob, psf: Path, move: rs.Progress | None, elapsed: Elapsed) -> dict[str, Any]:
    """Deblur one photo with PSFs from a file, which needs neither log nor camera."""
    picture = rs.read_picture(job.photo)
    bank = rs.read_psfs(psf, picture.pixels.shape)
    options = replace(job.options, transfer=transfer_of(picture, job.options.transfer))
    with naming(psf):
        rs.check_bank(bank, picture.pixels.shape)
    if job.dry_run:
        return _planned(job, bank, rs.mode_of(bank), picture)

    def solve(out: Any) -> rs.DeblurResult:
        with naming(job.photo):
            return rs.deconvolve_with(options, picture.pixels, bank, out=out, progress=move)

    return _written(job, picture, solve, elapsed)


def _planned(job: PhotoJob, bank: rs.PsfBank, mode: Mode, picture: rs.Picture) -> dict[str, Any]:
    """Return the facts that a dry run knows."""
    facts = {"output": str(job.output), "dry_run": True, "mode": mode, "prior": job.options.prior_name}
    return facts | {"psf_px": list(bank.size[::-1]), "size_px": list(picture.pixels.shape[1::-1])}


def _written(job: PhotoJob, picture: rs.Picture, solve: Any, elapsed: Elapsed) -> dict[str, Any]:
    """Solve and write a picture, and return the facts to report."""
    # The result goes into an array of the file's type: with 8 bits, a quarter of the memory of float32.
    out = rs.empty(picture.pixels.shape, picture.pixels.dtype)
    result = solve(out)
    rs.write_picture(job.output, out, like=picture, force=job.force)
    return rs.result_facts(result, job.output, job.options.prior_name, elapsed())


def moment_facts(recording: Recording, inputs: Inputs) -> dict[str, float]:
    """Return the time offset that the picture determined, if its time is that of its EXIF block."""
    return {"time_offset_s": inputs.camera.time_offset} if recording.start == "exif" else {}


@contextmanager
def stopwatch() -> Iterator[Elapsed]:
    """Yield a function that returns the time since the start of the block in s, without compilation."""
    begin = time.perf_counter()
    with rs.compilation() as compiled:
        yield lambda: time.perf_counter() - begin - compiled()
