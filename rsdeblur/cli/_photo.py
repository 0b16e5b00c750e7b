"""One photo, from its files to the plan and the written result: the same preparation in every command."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from rsdeblur.choices import Mode
from rsdeblur.cli import _engine as rs
from rsdeblur.cli._inputs import (
    Inputs,
    naming,
    photo_gravity,
    read_inputs,
    read_recording,
    transfer_of,
    translation_of,
    with_axes_of,
    with_offset,
)
from rsdeblur.cli._log import Gravity
from rsdeblur.cli._options import ONE_PHOTO, Recording, flag, require
from rsdeblur.cli._output import LOG, level, prepare_folder
from rsdeblur.pipeline.options import BLUR, Options

# Pixels along the picture's edges that do not count, because light from beyond the frame blurred them.
BORDER = 24


@dataclass(frozen=True, slots=True)
class Prepared:
    """A photo that is ready to be planned.

    `options` contain what the files decide: transfer, translation, and whether to refine. Without a photo, the picture
    of `inputs` is None.
    """

    inputs: Inputs
    options: Options
    gravity: Gravity
    photo: Path | None
    recording: Recording

    @property
    def naming(self) -> Any:
        """Context that names the file at fault in errors."""
        return naming(self.photo, self.recording)

    def plan(self, move: rs.Progress | None = None, options: Options | None = None) -> rs.Plan:
        """Plan the deblurring, and refine the recording first if the options do."""
        picture, log, camera, exposure = self.inputs
        known = self.options.refine and self.gravity.confirms
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
    """Read the inputs of a photo unless they are given, and decide by them how it is deblurred.

    Without a photo, only kernels can be computed. With `max_memory`, it is mapped instead of read. `refine_anyway`
    refines where the options do although gravity contradicts the axes.
    """
    gravity = Gravity()
    if photo is None:
        picture: Any = None
        inputs = Inputs(picture, *read_recording(recording))
    else:
        is_timed = inputs is not None or recording.start != "exif"
        inputs = inputs or read_inputs(photo, recording, in_place=options.max_memory is not None)
        gravity = photo_gravity(photo, inputs, recording)
        if gravity.contradicts and not refine_anyway:
            given, inputs = inputs, with_axes_of(gravity, inputs, photo)
            gravity = gravity if inputs is given else Gravity(confirms=True)
        inputs = inputs if is_timed else with_offset(inputs, photo)
        options = replace(options, transfer=transfer_of(inputs.picture, options.transfer))
    # With wrong axes, a correction may make the motion more like the right one, but never right.
    if options.refine and gravity.contradicts and not refine_anyway:
        LOG.info("%s: recording not corrected, because of the direction of gravity; --refine does it anyway", photo)
        options = replace(options, refine=False)
    translation = translation_of(recording, inputs.camera, inputs.exposure)
    return Prepared(inputs, replace(options, translation=translation), gravity, photo, recording)


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoJob:
    """A photo to deblur, with its recording or the file of its PSFs, options and output.

    `refine_anyway` refines where the options do although gravity contradicts the axes, as the user asked for it.
    """

    photo: Path
    recording: Recording
    options: Options
    output: Path
    psf: Path | None = None
    force: bool = False
    dry_run: bool = False
    make_folder: bool = False
    refine_anyway: bool = False


def check_sources(context: click.Context, recording: Recording, psf: Path | None) -> None:
    """Raise `click.UsageError` unless the blur comes either from a recording or from a file of PSFs."""
    if psf is None:
        require(recording, "gyro")
        return
    blur = [each.name for each in fields(Options) if each.metadata.get("section") == BLUR]
    # Kernels have no half colours, and results no verdict.
    motion = (*ONE_PHOTO, *blur, "chroma", "fallback")
    given = [flag(name) for name in motion if context.get_parameter_source(name) is not ParameterSource.DEFAULT]
    if given:
        raise click.UsageError(
            f"--psf gives the blur itself, so these options have no meaning: {', '.join(given)}", context
        )


def deblur_photo(job: PhotoJob, move: rs.Progress | None = None) -> dict[str, Any]:
    """Deblur and write one photo, or only read and check its files, and return the facts to report."""
    _prepare_result(job)
    if job.psf is not None:
        return _deconvolve(job, job.psf, move)
    ready = prepare(job.photo, job.recording, job.options, refine_anyway=job.refine_anyway)
    if job.dry_run:
        with ready.naming:
            rs.check_size(ready.inputs.picture.pixels.shape, ready.inputs.camera)
        # As much as possible is checked without solving.
        bank, _, mode = ready.kernels()
        return _planned(job, bank, mode, ready.inputs.picture)

    def solve(out: Any) -> rs.DeblurResult:
        with ready.naming:
            return ready.plan(move).apply(ready.inputs.picture.pixels, out=out, progress=move)

    facts = _written(job, ready.inputs.picture, solve)
    return facts | moment_facts(job.recording, ready.inputs)


def _deconvolve(job: PhotoJob, psf: Path, move: rs.Progress | None) -> dict[str, Any]:
    """Deblur one photo with PSFs from a file, which needs neither log nor camera."""
    picture = rs.read_picture(job.photo, in_place=job.options.max_memory is not None)
    bank = rs.read_psfs(psf, picture.pixels.shape)
    options = replace(job.options, transfer=transfer_of(picture, job.options.transfer))
    with naming(psf):
        rs.check_bank(bank, picture.pixels.shape)
    if job.dry_run:
        return _planned(job, bank, rs.mode_of(bank), picture)

    def solve(out: Any) -> rs.DeblurResult:
        with naming(job.photo):
            return rs.deconvolve_with(options, picture.pixels, bank, out=out, progress=move)

    return _written(job, picture, solve)


def _prepare_result(job: PhotoJob) -> None:
    """Check that the result can be written, and make its folder if the job does; a dry run makes none."""
    if job.make_folder:
        prepare_folder(job.output.parent, [], force=job.force, dry_run=job.dry_run)
    if job.dry_run and job.make_folder and not job.output.parent.is_dir():
        rs.check_kind(job.output)
    else:
        rs.check_writable(job.output, force=job.force)


def _planned(job: PhotoJob, bank: rs.PsfBank, mode: Mode, picture: rs.Picture) -> dict[str, Any]:
    """Return the facts that a dry run knows."""
    return {
        "output": str(job.output),
        "dry_run": True,
        "mode": mode,
        "psf_px": list(bank.size[::-1]),
        "prior": job.options.prior_name,
        "size_px": list(picture.pixels.shape[1::-1]),
    }


def _written(job: PhotoJob, picture: rs.Picture, solve: Any) -> dict[str, Any]:
    """Solve and write a picture, and return the facts to report."""
    in_place = job.options.max_memory is not None
    # The result goes into an array of the file's type: with 8 bits, a quarter of the memory of float32.
    with (
        stopwatch() as watch,
        rs.picture_to_fill(job.output, picture.pixels.shape, like=picture, force=job.force, in_place=in_place) as out,
    ):
        result = solve(out)
    return facts_of(result, job.output, job.options.prior_name, watch[0])


def facts_of(result: rs.DeblurResult, output: Path, prior: str, seconds: float) -> dict[str, Any]:
    """Return the facts to report about a written result."""
    return {
        "output": str(output),
        "mode": result.mode,
        "tile_error_px": result.tile_error,
        "psf_px": list(result.psfs.size[::-1]),
        "prior": prior,
        **{name: getattr(result, name) for name in ("bands", "strips", "nsr", "weight", "noise", "chroma", "timings")},
        "seconds": seconds,
        "check": None if result.check is None else asdict(result.check),
        "refinement": None if result.refinement is None else refinement_facts(result.refinement),
    }


def summary(facts: Mapping[str, Any]) -> str:
    """Return the facts about a result in one line: how it was made, and the verdict of the check."""
    wide, tall = facts["psf_px"]
    tiles = "rows" if facts["mode"] == "rowwise" else "bands"
    strength = f"NSR {facts['nsr']:.2g}" if facts["weight"] is None else f"weight {facts['weight']:.2g}"
    check = facts["check"]
    verdict = "" if check is None else f"; {check['verdict']}"
    blended = ", blended towards the photo" if check and check["blended"] else ""
    error = facts.get("tile_error_px")
    because = f" (tiles would err by {error:.2f} px)" if facts["mode"] == "rowwise" and error is not None else ""
    return (
        f"{facts['mode']}{because}, "
        f"{facts['bands']} x {facts['strips']} PSFs ({tiles} x strips) of {wide} x {tall} px, "
        f"{facts['prior']}, {strength}, {facts['seconds']:.2f} s{verdict}{blended}"
    )


def remarks(facts: Mapping[str, Any], *, asked: bool) -> list[str]:
    """Return lines about a result: reasons of the check, its moment, and the correction if there is one or `asked`."""
    check, refinement = facts.get("check"), facts.get("refinement")
    lines = [f"  {' '.join(check['reasons'])}"] if check and check["reasons"] else []
    if (offset := facts.get("time_offset_s")) is not None:
        lines.append(
            f"  The exposure began {abs(offset):.3f} s {'before' if offset > 0 else 'after'} the time in EXIF."
        )
    if refinement and (asked or refinement["accepted"] or level() > 0):
        lines.append(f"  {correction_text(refinement)}")
    return lines


def moment_facts(recording: Recording, inputs: Inputs) -> dict[str, float]:
    """Return the time offset that the picture determined, if its time is that of its EXIF block."""
    return {"time_offset_s": inputs.camera.time_offset} if recording.start == "exif" else {}


def refinement_facts(refinement: rs.Refinement) -> dict[str, Any]:
    """Return the facts about a correction of the recording, for JSON."""
    return {
        **{name: getattr(refinement, name) for name in ("accepted", "reason", "confidence", "gain", "fall")},
        "values": asdict(refinement.values),
        "sd": asdict(refinement.sd),
        "regions": None if refinement.regions is None else refinement.regions.tolist(),
    }


def correction_text(facts: Mapping[str, Any]) -> str:
    """Return a sentence about a correction of the recording, of which `refinement_facts` are given."""
    if not facts["accepted"]:
        reason = facts["reason"]
        return f"Recording not corrected: {reason}{'' if reason.endswith('?') else '.'}"
    values = facts["values"]
    drift, acceleration = ((values[f"{name}_x"], values[f"{name}_y"]) for name in ("drift", "acceleration"))
    regions = facts["regions"]
    near = f" (x {min(map(min, regions)):g} to {max(map(max, regions)):g} by region)" if regions else ""
    texts = {
        f"focal length x {math.exp(values['scale']):.3f}": values["scale"],
        "drift {:+.1f} and {:+.1f} px".format(*drift) + near: any(drift),
        "acceleration {:+.0f} and {:+.0f} px/s²".format(*acceleration): any(acceleration),
        f"time offset {1e3 * values['offset']:+.1f} ms": values["offset"],
        f"readout time x {math.exp(values['readout']):.2f}": values["readout"],
        f"roll bias {values['roll']:+.3f} rad/s": values["roll"],
    }
    return f"Recording corrected: {', '.join(text for text, changed in texts.items() if changed)}."


def similarity(image: rs.NDArray[Any], truth: rs.NDArray[Any]) -> dict[str, float | None]:
    """Return PSNR in dB and SSIM of display values in [0, 1], without borders and alpha.

    PSNR is None for equal pictures, because JSON has no infinity. SSIM uses the Gaussian window of its authors (Wang
    et al. 2004).
    """
    # Small pictures lose no more than a quarter of a side at each edge.
    y, x = (min(BORDER, side // 4) for side in image.shape[:2])
    a, b = (values[y : values.shape[0] - y, x : values.shape[1] - x] for values in (image, truth))
    axis = None if a.ndim == 2 else 2
    if axis and a.shape[2] in (2, 4):
        a, b = a[..., :-1], b[..., :-1]
    ssim = rs.structural_similarity(
        a, b, data_range=1.0, channel_axis=axis, gaussian_weights=True, sigma=1.5, use_sample_covariance=False
    )
    psnr = None if (a == b).all() else float(rs.peak_signal_noise_ratio(b, a, data_range=1.0))
    return {"psnr_db": psnr, "ssim": float(ssim)}


def forget_peak_memory() -> None:
    """Start a new measurement of the peak; without effect where the system has no such measurement."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory_mib() -> float | None:
    """Return the process's peak resident memory in MiB since `forget_peak_memory`, None where it is unknown."""
    try:
        match = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    except OSError:
        return None
    return int(match[1]) / 1024 if match else None


@contextmanager
def stopwatch() -> Iterator[list[float]]:
    """Measure the time of the block in s, without compilation; the yielded list contains it after the block."""
    seconds: list[float] = []
    begin = time.perf_counter()
    with rs.compilation() as compiled:
        yield seconds
    seconds.append(time.perf_counter() - begin - compiled())
