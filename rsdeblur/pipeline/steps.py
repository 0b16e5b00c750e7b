"""The steps that a picture takes whether its PSFs come from a motion or from the caller, and their times."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur.choices import DENOISERS, LINEAR_PRIORS
from rsdeblur.deconv.plug_and_play import WEIGHT_OF_VARIANCE
from rsdeblur.deconv.priors import LEAST_PEAK, brightness
from rsdeblur.estimate.check import QualityCheck, assess
from rsdeblur.estimate.motion_evidence import MotionEvidence
from rsdeblur.image.encoded import EncodedImage, blocks
from rsdeblur.image.highlights import HighlightSplit, find_spots, lights, separate_highlights, small_spots
from rsdeblur.image.mending import UndershootMeter, fade_undershoot, keep_colours_near_clipped
from rsdeblur.image.transfer import normalized
from rsdeblur.motion.alignment import rectify
from rsdeblur.motion.paths import Capture
from rsdeblur.pipeline.memory import plan_chunks
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.solver import PictureSolver, Strengths
from rsdeblur.pipeline.tiles import Blur, few_psfs, psfs_of
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.strength import Tuning
from rsdeblur.types import FloatImage, Progress, StageProgress

LOG = logging.getLogger("rsdeblur")
# Share of the border's error that is left if the border is solved for. Only exact PSFs allow for so little: with those
# of a motion, which is never exact, the whole one is better.
SOLVED_BORDER_ERROR = 0.1
# Least `nsr` of denoisers as a multiple of the variance of the noise in a picture whose bright parts have the value 1.
# They restore what a PSF lost less well than other priors.
NSR_OF_VARIANCE = 2.0


class StageClock:
    """Times the stages of one computation, reports their progress, and logs them at the level DEBUG."""

    def __init__(self, progress: Progress | None = None) -> None:
        self.timings: dict[str, float] = {}  # s spent in each stage so far
        self._progress = progress

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body as a stage; the times of several bodies of one stage add up."""
        begin = time.perf_counter()
        if name not in self.timings:
            self._report(name, 0.0)
        yield
        seconds = time.perf_counter() - begin
        LOG.debug("stage %s: %.3f s", name, seconds)
        self.timings[name] = self.timings.get(name, 0.0) + seconds
        # The solver reports its own end.
        if name != "apply":
            self._report(name, 1.0)

    def within(self, name: str, part: int = 0, parts: int = 1) -> StageProgress:
        """Return a function that reports the progress of one of several parts of a stage."""
        return lambda fraction: self._report(name, (part + fraction) / parts)

    def _report(self, name: str, fraction: float) -> None:
        if self._progress is not None:
            self._progress(name, fraction)


def split_highlights(
    frames: Sequence[EncodedImage], options: Options, blurs: Sequence[Blur], clock: StageClock
) -> list[HighlightSplit]:
    """Separate the clipped highlights of frames of one scene, if the options request it and there are any.

    A saturation of "auto" takes all spots of several frames or none. Only frames with clipped pixels need PSFs.
    """
    whole = [HighlightSplit(encoded) for encoded in frames]
    if options.saturation_in_effect == "ignore":
        return whole
    found = [
        (spots, psfs_of(blur, threads=options.threads) if spots else None)
        for spots, blur in zip(map(find_spots, frames), blurs, strict=True)
    ]
    small = [([] if psfs is None else small_spots(spots, psfs), psfs) for spots, psfs in found]
    if options.saturation_in_effect == "auto":
        few = [(lights(spots, encoded), psfs) for (spots, psfs), encoded in zip(small, frames, strict=True)]
        if len(frames) > 1 and any(len(a) < len(b) for (a, _), (b, _) in zip(few, small, strict=True)):
            return whole
        small = few
    for n, (spots, psfs) in enumerate(small):
        if spots and psfs is not None:
            with clock.stage("highlights"):
                whole[n] = separate_highlights(frames[n], spots, psfs, threads=options.threads)
    return whole


def derive_strengths(
    split: HighlightSplit, options: Options, blur: Blur, *, light: FloatImage | None = None
) -> Strengths:
    """Return the strengths of a picture; what the options set is not derived.

    `blur` is the motion, or the caller's own PSFs, which count as exact and may describe a picture that repeats.
    `light` is the picture's linear light (H, W, C) without highlights, if it is decoded already.
    """
    given = isinstance(blur, PsfBank)
    peak = brightness(split.remainder(slice(None), 4))
    if options.prior_in_effect == "wiener" and options.nsr != "auto":
        return Strengths(options.nsr, None, peak, options.nsr)
    rows, part = tuned_part(split.encoded.shape, few_psfs(blur, threads=options.threads))
    noise = None if options.noise == "auto" else options.noise
    one_psf = blur.kernels.shape[:2] == (1, 1) if isinstance(blur, PsfBank) else options.has_one_psf
    continued = options.mode_in_effect != "rowwise"
    repeats = given and options.border == "periodic"
    tuned = split.remainder(rows, threads=options.threads) if light is None else light[rows]
    tuning = Tuning.of(tuned, part, noise=noise, one_filter=one_psf, continued=continued, repeats=repeats)
    return tuned_strengths(tuning, options, peak, given=given)


def tuned_part(shape: tuple[int, ...], bank: PsfBank) -> tuple[slice, PsfBank]:
    """Return the middle rows that strengths are derived from, and PSFs at places counted from the first of them.

    `shape` is that of the picture (H, W, C), whose PSFs `bank` contains.
    """
    height, width = shape[:2]
    # The middle rows of larger pictures are enough.
    half = min(height, max(1, 8_000_000 // width)) // 2
    first = height // 2 - half
    return slice(first, height - first), replace(bank, rows=bank.rows - first) if first else bank


def tuned_strengths(tuning: Tuning, options: Options, peak: float, *, given: bool = False) -> Strengths:
    """Return the strengths that follow from the measurements of a picture, or of several together.

    What the options set is not derived. `peak` is the value of the picture's bright parts; `given` says that the PSFs
    are the caller's own.
    """
    prior = options.prior_in_effect
    if prior == "wiener":
        nsr = tuning.wiener_nsr if options.nsr == "auto" else options.nsr
        return Strengths(nsr, None, peak, nsr, noise=tuning.noise)
    nsr = _prior_nsr(tuning, options, peak, given=given) if options.nsr == "auto" else options.nsr
    if options.weight != "auto":
        weight = options.weight
    else:
        weight = (
            tuning.denoiser_weight if callable(prior) or prior in DENOISERS else tuning.weight(prior, options.exponent)
        )
    return Strengths(nsr, weight, peak, tuning.gradient_nsr, noise=tuning.noise)


def _prior_nsr(tuning: Tuning, options: Options, peak: float, *, given: bool) -> float:
    """Return the `nsr` that goes with a prior."""
    share = SOLVED_BORDER_ERROR if given and options.border == "unknown" else 1.0
    nsr = share * tuning.border_error
    prior = options.prior_in_effect
    if callable(prior) or prior in DENOISERS:
        variance = tuning.denoiser_weight / WEIGHT_OF_VARIANCE
        return max(nsr, min(NSR_OF_VARIANCE * variance / max(peak, LEAST_PEAK) ** 2, 1.0))
    return nsr


def solve_chunks(
    split: HighlightSplit,
    out: NDArray[Any],
    solver: PictureSolver,
    clock: StageClock,
    *,
    light: FloatImage | None = None,  # the picture's linear light (H, W, C) without highlights, if decoded already
    meter: UndershootMeter | None = None,  # measures light before and after the solve
    capture: Capture | None = None,  # the motion by which the options may request to rectify the picture
) -> NDArray[np.bool_]:
    """Solve chunk by chunk into `out`, which is upright and encoded; return a mask of the pixels that were exposed."""
    options, size, threads = solver.options, solver.bank.size, solver.options.threads
    coverage: NDArray[np.bool_] = np.broadcast_to(np.True_, split.encoded.shape[:2])
    # Linear methods, of which the published filter is one, stay linear.
    is_corrected = options.prior_in_effect not in LINEAR_PRIORS
    chunks = plan_chunks(solver, split.encoded.shape, options.max_memory)
    for n, chunk in enumerate(chunks):
        first = chunk.source.start
        linear = split.remainder(chunk.source, threads=threads) if light is None else light[chunk.source]
        inner = slice(chunk.target.start - first, chunk.target.stop - first)
        if meter is not None:
            meter.before(linear[inner], chunk.target)
        with clock.stage("plan"):
            solve = solver.plan(chunk, linear.shape)
        with clock.stage("apply"):
            linear = solve(linear, clock.within("apply", n, len(chunks)))
        split.add_highlights(linear, first)
        if meter is not None:
            meter.after(linear[inner], chunk.target)
        if is_corrected:
            fade_undershoot(linear, split.encoded, first, size, solver.strengths.peak, threads=threads)
            keep_colours_near_clipped(linear, split.encoded, first, size, threads=threads)
        if options.geometry == "rectify" and capture is not None:
            with clock.stage("rectify"):
                linear, coverage = rectify(linear, capture, threads=threads)
        if options.normalize:
            linear = normalized(linear)
        split.encoded.encode(linear[inner], chunk.target, out, threads=threads)
        # Free the memory before the next chunk is planned.
        del linear, solve
    return coverage


def judged(
    encoded: EncodedImage,
    out: NDArray[Any],
    evidence: Callable[[], MotionEvidence],
    meter: UndershootMeter,
    options: Options,
    clock: StageClock,
) -> QualityCheck | None:
    """Check the upright result `out`, if the options request it; the picture may replace a bad one."""
    if not options.judges:
        return None
    with clock.stage("check"):
        check = assess(evidence(), EncodedImage(out, encoded.transfer), meter, threads=options.threads)
        if not (options.fallback and check.verdict == "bad"):
            return check
        for _, rows in blocks(slice(0, encoded.shape[0])):
            encoded.encode(encoded.linear(rows), rows, out)
        return replace(check, replaced=True)
