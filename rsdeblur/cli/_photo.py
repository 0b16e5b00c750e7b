"""One photo, from its files to the plan and the written result: the same preparation in every command."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeAlias

import click
from click.core import ParameterSource

from rsdeblur._util.files import check_target
from rsdeblur.choices import Mode
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _inputs
from rsdeblur.cli._options import ONE_PHOTO, Recording, Target, flag, require
from rsdeblur.cli._output import LOG, prepare_folder
from rsdeblur.pipeline.options import BLUR, Options

# A picture, a function that returns its PSFs and the mode, one that deblurs into an array, and facts about the moment.
Work: TypeAlias = "tuple[rs.Picture, Callable[[], tuple[rs.PsfBank, Mode]], Callable[[Any], Any], dict[str, float]]"


@dataclass(frozen=True, slots=True)
class Prepared:
    """A photo that is ready to be planned, with options that its files decide; without a photo, its picture is None."""

    inputs: _inputs.Inputs
    options: Options
    gravity: rs.Gravity
    photo: Path | None
    recording: Recording

    @property
    def naming(self) -> Any:
        """Context that names the file at fault in errors."""
        return _inputs.naming(self.photo, self.recording)

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
    inputs: _inputs.Inputs | None = None,
) -> Prepared:
    """Read the inputs of a photo unless they are given, and decide by them how it is deblurred."""
    gravity = rs.Gravity()
    if photo is None:
        picture: Any = None
        inputs = _inputs.Inputs(picture, *_inputs.read_recording(recording))
    else:
        is_timed = inputs is not None or recording.start != "exif"
        inputs = inputs or _inputs.read_inputs(photo, recording)
        gravity = _inputs.photo_gravity(photo, inputs, recording)
        if gravity.contradicts and not refine_anyway and len(gravity.fits) == 1:
            inputs, gravity = _inputs.with_axes(gravity.fits[0], inputs, photo), rs.Gravity("bottom")
        inputs = inputs if is_timed else _inputs.with_offset(inputs, photo)
        options = replace(options, transfer=_inputs.transfer_of(inputs.picture, options.transfer))
    # With wrong axes, a correction may make the motion more like the right one, but never right.
    if options.refine and gravity.contradicts and not refine_anyway:
        LOG.info("%s: recording not corrected, because of the direction of gravity; --refine does it anyway", photo)
        options = replace(options, refine=False)
    if recording.drift is not None:
        with _inputs.naming("--drift"):
            drift = rs.Translation.drift(recording.drift, inputs.camera, inputs.exposure)
        options = replace(options, translation=drift)
    return Prepared(inputs, options, gravity, photo, recording)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoJob:
    """A photo to deblur, with its recording or the file of its PSFs, options and output."""

    photo: Path
    recording: Recording
    options: Options
    target: Target
    psf: Path | None = None
    psf_scale: float = 1.0
    save_camera: Path | None = None
    make_folder: bool = False
    refine_anyway: bool = False


def check_sources(recording: Recording, psf: object) -> None:
    """Raise `click.UsageError` unless the blur comes either from a recording or from a kernel, `psf`."""
    if psf is None:
        require(recording, "gyro")
        return
    blur = [each.name for each in fields(Options) if each.metadata.get("section") == BLUR]
    # Kernels have no half colours, and results no verdict.
    motion = (*ONE_PHOTO, *blur, "chroma", "fallback", "save_camera")
    source, unset = click.get_current_context().get_parameter_source, (None, ParameterSource.DEFAULT)
    if given := ", ".join(flag(name) for name in motion if source(name) not in unset):
        raise click.UsageError(f"the kernel is the blur itself, so these options have no meaning: {given}")


def deblur_photo(job: PhotoJob, move: rs.Progress | None = None) -> dict[str, Any]:
    """Deblur and write one photo, or only read and check its files, and return the facts to report."""
    target, output = job.target, job.target.output
    with stopwatch() as elapsed:
        if job.make_folder:
            prepare_folder(output.parent, [], force=target.force, dry_run=target.dry_run)
        if target.dry_run and job.make_folder and not output.parent.is_dir():
            rs.check_kind(output)
        else:
            rs.check_writable(output, force=target.force)
        if job.save_camera is not None:
            check_target(job.save_camera, force=target.force)
        picture, kernels, solve, moment = (_by_recording if job.psf is None else _by_kernel)(job, move)
        if target.dry_run:
            # As much as possible is checked without solving.
            bank, mode = kernels()
            facts = {"output": str(output), "dry_run": True, "mode": mode, "prior": job.options.prior_name}
            return facts | {"psf_px": list(bank.size[::-1]), "size_px": list(picture.pixels.shape[1::-1])}
        # The result goes into an array of the file's type: with 8 bits, a quarter of the memory of float32.
        out = rs.empty(picture.pixels.shape, picture.pixels.dtype)
        result = solve(out)
        rs.write_picture(output, out, like=picture, force=target.force)
        return rs.result_facts(result, output, job.options.prior_name, elapsed()) | moment


def _by_recording(job: PhotoJob, move: rs.Progress | None) -> Work:
    ready = prepare(job.photo, job.recording, job.options, refine_anyway=job.refine_anyway)
    picture, _, camera, _ = ready.inputs

    def kernels() -> tuple[rs.PsfBank, Mode]:
        with ready.naming:
            rs.check_size(picture.pixels.shape, camera)
        bank, _, mode = ready.kernels()
        return bank, mode

    def solve(out: Any) -> rs.DeblurResult:
        with ready.naming:
            result = ready.plan(move).apply(picture.pixels, out=out, progress=move)
        if job.save_camera is not None:
            used = camera if result.refinement is None else result.refinement.camera
            # How far EXIF is from the moment belongs to the photo.
            used = replace(used, time_offset=0.0, time_offset_sd=0.0) if ready.recording.start == "exif" else used
            used.save(job.save_camera)
        return result

    return picture, kernels, solve, moment_facts(job.recording, ready.inputs)


def _by_kernel(job: PhotoJob, move: rs.Progress | None) -> Work:
    assert job.psf is not None
    picture = rs.read_picture(job.photo)
    bank = rs.read_psfs(job.psf, picture.pixels.shape)
    bank = bank if job.psf_scale == 1 else bank.scaled(job.psf_scale)
    options = replace(job.options, transfer=_inputs.transfer_of(picture, job.options.transfer))
    with _inputs.naming(job.psf):
        rs.check_bank(bank, picture.pixels.shape)

    def solve(out: Any) -> rs.DeblurResult:
        with _inputs.naming(job.photo):
            return rs.deconvolve_with(options, picture.pixels, bank, out=out, progress=move)

    return picture, lambda: (bank, rs.mode_of(bank)), solve, {}


def moment_facts(recording: Recording, inputs: _inputs.Inputs) -> dict[str, float]:
    """Return the time offset that the picture determined, if its time is that of its EXIF block."""
    return {"time_offset_s": inputs.camera.time_offset} if recording.start == "exif" else {}


@contextmanager
def stopwatch() -> Iterator[Callable[[], float]]:
    """Yield a function that returns the time since the start of the block in s, without compilation."""
    begin = time.perf_counter()
    with rs.compilation() as compiled:
        yield lambda: time.perf_counter() - begin - compiled()
