"""Planning of a video: one pass over all frames decides what they share."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util import validate
from rsdeblur.choices import KEEP, VERDICTS, Chroma, Transfer
from rsdeblur.errors import CoverageError, InputError, RsdeblurWarning
from rsdeblur.estimate.check import QualityCheck
from rsdeblur.estimate.refine import REFINED_FRAMES, Refinement
from rsdeblur.image.encoded import ReadoutFrame, check_size
from rsdeblur.motion.arguments import check_reach, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import Plan, captured, plan, refined_together
from rsdeblur.pipeline.solver import Strengths, chroma_of
from rsdeblur.types import FloatArray, Progress
from rsdeblur.video import QUALITY
from rsdeblur.video.clip import Clip, av, frames, values_of

ColorTrc = av.video.reformatter.ColorTrc
Recorded = tuple[GyroLog, Camera, Sequence[Exposure]]


@dataclass(frozen=True, slots=True)
class ClipPlan:
    """A video with its motion, and the options and strengths that all its frames share.

    Parameters
    ----------
    clip, log, camera
        The video, the motion and the camera.
    exposures : tuple of Exposure
        The exposure of each frame.
    reasons : tuple of str or None
        Reason why a frame is left as it is; None where it is deblurred.
    options : Options
        Options of every frame.
    strengths : Strengths
        Strengths of every frame: those of the sample frame with the median noise.
    tiles : (int, int)
        Most bands and most strips of a sample frame.
    psf_size : (int, int)
        Height and width of the largest kernel of a sample frame, px of the frames as stored; that with the longest path
        is one.
    lengths : tuple of float
        Length of the longest path in each frame, px; NaN where there is a reason.
    shares : tuple of float
        Share of the deblurred frame in each frame of the result; a frame with 0 is left as it is.
    check : QualityCheck, or None
        Check of the median sample frame; None if `options` switches it off.
    refinement : Refinement, or None
        Correction of log and camera; None where none was requested.
    """

    clip: Clip
    log: GyroLog
    camera: Camera
    exposures: tuple[Exposure, ...]
    reasons: tuple[str | None, ...]
    options: Options
    strengths: Strengths
    tiles: tuple[int, int]
    psf_size: tuple[int, int]
    lengths: tuple[float, ...]
    shares: tuple[float, ...]
    check: QualityCheck | None
    refinement: Refinement | None = None

    @property
    def treated(self) -> int:
        """Number of frames that are deblurred."""
        return int(np.count_nonzero(self.shares))

    @property
    def largest(self) -> float:
        """Length of the longest path in the frames that are deblurred, px."""
        return float(np.nanmax(self.lengths))

    @property
    def chroma(self) -> Chroma:
        """Resolution at which colours are restored, with the largest kernels; with very small ones it is full."""
        return chroma_of(self.options, self.psf_size, (self.clip.height, self.clip.width, 3))

    def frame(self, index: int) -> Plan:
        """Return the plan of one frame, whose own motion decides its tiles.

        Parameters
        ----------
        index : int
            Number of the frame, from 0.
        """
        alone = plan(self.log, self.camera, self.exposures[index], self.options)
        return replace(alone, strengths=self.strengths)


def plan_clip(
    clip: Clip,
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    options: Options | None = None,
    *,
    above: float = KEEP,
    progress: Progress | None = None,
) -> ClipPlan:
    """Plan a video: measure the blur of every frame, and derive the strengths that they share from sample frames.

    Frames with shorter paths than `above` are left as they are. Up to twice that length, the deblurred frame is mixed
    with the frame itself, so that no step shows. With ``options.refine``, a few frames together first correct focal
    length, clock, readout time and roll bias, see :func:`rsdeblur.refine`. The results of the sample frames are
    checked; if most of them are bad, a warning says so.

    Parameters
    ----------
    clip, log, camera, exposures
        The video, the motion, the camera and the exposure of each frame.
    options : Options, optional
        Default `Options(quality="fast")`. A transfer of "auto" follows the video's tags.
    above : float, default 1.5
        Longest path in px of a frame that is left as it is; 0 deblurs all frames.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    ClipPlan
        Everything that the frames share, and the reasons why some are left as they are.

    Raises
    ------
    CoverageError, ClockError, GapError
        If the log describes no frame.
    InputError
        If the frames do not have the camera's size, there is not one exposure for each, the blur of every frame is too
        large or at most `above`, `above` is negative, `options.refine` is set and fewer than two frames are blurred, or
        `options` sets one of those for single pictures: `normalize`, ``saturation="always"``, `fallback` and
        `max_memory`.
    """
    check_size((clip.height, clip.width), camera)
    exposures = exposure_list(exposures)
    if len(exposures) != len(clip):
        raise InputError(
            f"{clip.path}: each frame needs an exposure, got {len(clip)} frames, {len(exposures)} exposures"
        )
    options = Options(quality=QUALITY) if options is None else validate.instance("options", options, Options)
    _check_options(options)
    above = validate.finite("above", above, minimum=0.0)
    transfer = _clip_transfer(clip) if options.transfer == "auto" else options.transfer
    # Highlights that are separated in some frames only would flicker, and so would rows in some and tiles in others.
    options = replace(options, transfer=transfer, saturation="ignore", mode=options.mode_in_effect)
    report_progress = progress or (lambda stage, fraction: None)
    refinement = None
    lengths, reasons = _measure((log, camera, exposures), options, report_progress)
    if options.refine:
        refinement = _refinement(clip, (log, camera, exposures), lengths, options, report_progress)
        log, camera, options = refinement.log, refinement.camera, replace(options, refine=False)
        if refinement.accepted:
            lengths, reasons = _measure((log, camera, exposures), options, report_progress)
    shares = np.nan_to_num(np.clip(lengths / above - 1.0, 0.0, 1.0)) if above else 1.0 * np.isfinite(lengths)
    (treated,) = np.nonzero(shares)
    if not len(treated):
        raise InputError(
            f"no frame is blurred by more than {above:g} px, the largest blur is "
            f"{np.nanmax(lengths):.2g} px; there is nothing to deblur unless all frames are requested (--above 0)"
        )
    # Five frames spread over the video represent all: the median of an odd number is one of them. The frame with the
    # longest paths has the largest kernels.
    spread, samples, checks = _spread(treated, 5), list[Plan](), list[QualityCheck]()
    for i in sorted({*spread, int(np.nanargmax(lengths))}):
        report_progress(f"sample frame {i}", 1.0)
        values = _values(clip, i)
        samples.append(plan(log, camera, exposures[i], options).prepare(values))
        if options.check and i in spread and (check := samples[-1].apply(values).check) is not None:
            checks.append(check)
    banks = [sample.frame.bank(sample.bank) for sample in samples if sample.bank is not None]
    strengths = [sample.strengths for sample in samples if sample.strengths is not None]
    return ClipPlan(
        *(clip, log, camera, tuple(exposures), tuple(reasons)),
        options=replace(options, check=False),
        strengths=sorted(strengths, key=lambda each: each.nsr)[len(strengths) // 2],
        tiles=(max(len(bank.rows) for bank in banks), max(len(bank.cols) for bank in banks)),
        psf_size=(max(bank.size[0] for bank in banks), max(bank.size[1] for bank in banks)),
        lengths=tuple(lengths.tolist()),
        shares=tuple(shares.tolist()),
        check=_median_check(checks, clip),
        refinement=refinement,
    )


def _values(clip: Clip, index: int) -> NDArray[Any]:
    """Return the values of a frame."""
    (frame,) = frames(clip, index, index + 1)
    return values_of(frame)


def _spread(numbers: NDArray[np.intp], count: int) -> list[int]:
    """Return up to `count` of these numbers, spread evenly over them."""
    chosen: list[int] = numbers[np.unique(np.linspace(0, len(numbers) - 1, count).astype(int))].tolist()
    return chosen


def _refinement(
    clip: Clip, recorded: Recorded, lengths: FloatArray, options: Options, report_progress: Progress
) -> Refinement:
    """Return the correction of the recording by frames of the more blurred half, or by both of two."""
    covered = np.flatnonzero(np.isfinite(lengths))
    if len(covered) < 2:
        raise InputError(f"{clip.path}: refine=True needs two blurred frames that the log covers, got {len(covered)}")
    least = min(np.median(lengths[covered]), np.sort(lengths[covered])[-2])
    chosen = _spread(covered[lengths[covered] >= least], REFINED_FRAMES)
    log, camera, exposures = recorded
    pictures, times = (_values(clip, i) for i in chosen), [exposures[i] for i in chosen]
    return refined_together(pictures, log, camera, times, options, report_progress)


def _check_options(options: Options) -> None:
    """Refuse options for single pictures."""
    refused = {
        "normalize=True": options.normalize,
        'saturation="always"': options.saturation == "always",
        "fallback=True": options.fallback,
        "max_memory": options.max_memory is not None,
    }
    if given := [text for text, is_set in refused.items() if is_set]:
        raise InputError(f"{' and '.join(given)} would make a video flicker, or is for single pictures; leave it out")


def _clip_transfer(clip: Clip) -> Transfer:
    """Return how values encode light, according to the video's tags."""
    if clip.transfer in (ColorTrc.SMPTE2084, ColorTrc.ARIB_STD_B67):
        text = f"{clip.path}: the video is HDR (HLG or PQ), and is decoded as sRGB; --transfer may fit better"
        warnings.warn(text, RsdeblurWarning, stacklevel=3)
    return "linear" if clip.transfer == ColorTrc.LINEAR else "srgb"


def _measure(recorded: Recorded, options: Options, report_progress: Progress) -> tuple[FloatArray, list[str | None]]:
    """Return the longest path in each frame, px, or NaN, and else the reason why it cannot be deblurred."""
    log, camera, exposures = recorded
    frame, lengths, reasons = ReadoutFrame(camera), np.full(len(exposures), np.nan), list[str | None]()
    first_error: CoverageError | InputError | None = None
    for i, exposure in enumerate(exposures):
        report_progress("measure all frames", (i + 1) / len(exposures))
        try:
            capture = captured(frame, log, exposure, options)
            # Paths at tiles' centres reach up to 1 px further than those probed, and kernels 1 px further than paths.
            check_reach(capture, spare=2)
            lengths[i] = capture.probe.lengths.max()
            reasons.append(None)
        except (CoverageError, InputError) as error:
            first_error = first_error or error
            reasons.append(str(error))
    if first_error is not None and None not in reasons:
        raise first_error
    return lengths, reasons


def _median_check(checks: Sequence[QualityCheck], clip: Clip) -> QualityCheck | None:
    """Return the median check of the sample frames, if there is any; warn if it is bad."""
    ranked = sorted(checks, key=lambda check: VERDICTS.index(check.verdict))
    median = ranked[len(ranked) // 2] if ranked else None
    if median is not None and median.verdict == "bad":
        count = sum(check.verdict == "bad" for check in checks)
        share = f"{count} of {len(checks)} sample frames come out bad"
        warnings.warn(f"{clip.path}: {share}: {' '.join(median.reasons)}", RsdeblurWarning, stacklevel=3)
    return median
