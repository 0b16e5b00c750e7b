"""Several frames of one scene, shaken differently, deblurred together: :func:`rsdeblur.deblur_burst`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.burst.alignment import AlignedBurst, aligned, measured
from rsdeblur.burst.solution import BurstSolution
from rsdeblur.choices import MODES, Auto, Mode, Transfer
from rsdeblur.errors import InputError
from rsdeblur.estimate.motion_evidence import MotionEvidence
from rsdeblur.estimate.refine import REFINED_FRAMES
from rsdeblur.image.encoded import EncodedImage, ReadoutFrame, check_size, result_like
from rsdeblur.image.mending import UndershootMeter
from rsdeblur.motion.arguments import check_recording, exposure_list
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import burst_captures
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult, refined_together, result_of
from rsdeblur.pipeline.steps import StageClock, judged, solve_chunks, split_highlights
from rsdeblur.pipeline.tiles import with_mode
from rsdeblur.types import Float32Array, Progress

# Most frames of a burst.
MOST_FRAMES = 64


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class FrameUse:
    """What a frame contributed to a result of :func:`rsdeblur.deblur_burst`.

    Parameters
    ----------
    share : float
        Share of the frame in the data, from 0 to 1: the inverse of its noise power, model errors included, divided by
        the sum over all frames. 0 if the frame was left out.
    support : float
        Mean weight over the reference's detail, from 0 to 1. A frame below 0.5 is left out.
    gain : float
        Brightness of the frame in units of the reference's.
    shift : float
        Root mean square of the shift that rotation does not explain, px.
    noise : float
        Standard deviation of its noise in linear light.
    blur : float
        Root mean square radius of its PSFs, px.
    weights : ndarray, shape (h, w), float32
        Weight from 0 to 1 at each place of the reference as stored, reduced by a whole factor; 0 where the frame does
        not show the place.
    """

    share: float
    support: float
    gain: float
    shift: float
    noise: float
    blur: float
    weights: Float32Array


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class BurstResult:
    """A picture deblurred from several frames.

    Parameters
    ----------
    result : DeblurResult
        The sharp picture in the pose of the reference, and what was used for it; `psfs` are those of the reference.
    reference : int
        Index of the reference, from 0.
    frames : tuple of FrameUse
        What each frame contributed, in the order of the input.
    """

    result: DeblurResult
    reference: int
    frames: tuple[FrameUse, ...]

    @property
    def image(self) -> NDArray[Any]:
        """The sharp picture, see :class:`rsdeblur.pipeline.DeblurResult`."""
        return self.result.image

    @property
    def transfer(self) -> Transfer:
        """How its values encode light, see :class:`rsdeblur.pipeline.DeblurResult`."""
        return self.result.transfer


def deblur_burst(
    images: Sequence[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    *,
    reference: int | Auto = "auto",
    mode: Mode | Auto = "auto",
    out: NDArray[Any] | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> BurstResult:
    """Deblur several frames of one scene together.

    Each shaken frame has lost other frequencies; together they have almost all. The rotation between the frames follows
    from the log, a residual shift from the pictures. A frame counts by the inverse of its noise power, to which the
    errors of its motion add, and nowhere where it does not show the same scene: there the result is that of the
    remaining frames.

    Parameters
    ----------
    images : sequence of array_like, shape (H, W) or (H, W, C)
        At least two frames of one camera, as for :func:`rsdeblur.deblur`. Their brightness may differ.
    log : GyroLog
        Motion, from the first exposure to the last one.
    camera : Camera
        The camera of all frames.
    exposures : sequence of Exposure
        When each frame was exposed and for how long; durations may differ.
    reference : int or "auto"
        Index of the frame whose pose the result has; "auto" takes the frame that alone promises the least error, among
        those that most others agree with.
    mode : {"auto", "global", "banded", "rowwise"}
        See :func:`rsdeblur.deblur`. "auto" is the mode of `quality`; where the motion chooses it, that of the frame
        that tiles suit least counts.
    out : ndarray, optional
        Receives the result, see :func:`rsdeblur.deblur`.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.
    **options
        Fields of :class:`rsdeblur.Options`, except ``border="unknown"``. ``refine=True`` corrects what all frames
        share, see :func:`rsdeblur.refine`. ``saturation="auto"`` separates highlights in all frames or in none. By
        default the work uses some 1 GiB in addition to the pictures, and more where the blur of many large frames is
        very tall, or where ``geometry="rectify"``, ``normalize=True`` or a border other than "blend" and "periodic"
        needs the whole picture at once.

    Returns
    -------
    BurstResult
        The sharp picture, and what each frame contributed.

    Raises
    ------
    InputError
        If an argument is out of range, there are fewer than two frames, their sizes differ, or as
        :func:`rsdeblur.deblur`.
    CoverageError, ClockError, GapError
        If the log does not cover the exposures and the times between them.

    Examples
    --------
    >>> import rsdeblur
    >>> log = rsdeblur.hand_shake(0.4, strength=0.3, seed=3)
    >>> camera = rsdeblur.Camera(96, 72, 150.0, readout_time=0.01)
    >>> exposures = [rsdeblur.Exposure(start, 1 / 40) for start in (0.1, 0.2)]
    >>> scene = rsdeblur.scene(110, 140)
    >>> images = [rsdeblur.simulate(scene, log, camera, exposure).blurred for exposure in exposures]
    >>> burst = rsdeblur.deblur_burst(images, log, camera, exposures, prior="wiener")
    >>> burst.image.shape, len(burst.frames)
    ((72, 96, 3), 2)
    """
    validate.choice("mode", mode, ("auto", *MODES))
    chosen = Options(mode=None if mode == "auto" else mode, **options)
    if chosen.chroma == "half":
        raise InputError('chroma="half" is for single pictures; leave it out')
    images, exposures = list(validate.items("images", images)), exposure_list(exposures)
    check_burst(images, log, camera, exposures, chosen)
    if not validate.is_auto(reference):
        reference = validate.count("reference", reference, minimum=0, maximum=len(images) - 1)
    clock = StageClock(validate.callback("progress", progress))
    refinement = None
    if chosen.refine:
        # The most blurred frames determine the correction best.
        lengths = [ReadoutFrame(camera).capture(log, each, chosen.translation).mean_length for each in exposures]
        most = sorted(np.argsort(lengths, kind="stable")[-REFINED_FRAMES:].tolist())
        pictures, times = [images[n] for n in most], [exposures[n] for n in most]
        refinement = refined_together(pictures, log, camera, times, chosen, progress)
        log, camera, chosen = refinement.log, refinement.camera, replace(chosen, refine=False)
    frame = ReadoutFrame(camera)
    encoded = [EncodedImage.of(image, chosen.transfer, frame) for image in images]
    if isinstance(out, np.ndarray) and any(np.may_share_memory(out, np.asarray(image)) for image in images[1:]):
        raise InputError("out must not overlap images")
    out, upright = result_like(images[0], out, frame)
    translation, motion = frame.translation(chosen.translation), chosen.motion
    captures = burst_captures(log, frame.camera, exposures, translation, motion=motion, softness=chosen.softness)
    chosen = with_mode(chosen, captures)
    splits = split_highlights(encoded, chosen, captures, clock)
    with clock.stage("tune"):
        frames = measured(splits, captures, chosen)
    with clock.stage("align"):
        burst = aligned(frames, reference, clock, chosen.threads)
    with clock.stage("psfs"):
        solution = BurstSolution.of(burst, chosen)
    first, meter = burst.reference, UndershootMeter(burst.reference.encoded.shape[0])
    pairs = [(frame.encoded, frame.capture) for frame in solution.frames]
    evidence = partial(MotionEvidence.of_burst, pairs, threads=chosen.threads)
    coverage = solve_chunks(first.split, upright, solution, clock, meter=meter, capture=first.capture)
    check = judged(first.encoded, upright, evidence, meter, chosen, clock)
    psfs, coverage = frame.bank(solution.bank), frame.back(coverage)
    shares = dict(zip(burst.used, solution.shares, strict=True))
    found: dict[str, Any] = {"timings": clock.timings, "refinement": refinement}
    return BurstResult(
        result_of(out, first.encoded, solution, psfs=psfs, coverage=coverage, check=check, **found),
        burst.index,
        tuple(_use(burst, n, shares.get(n, 0.0), frame) for n in range(len(images))),
    )


def check_burst(
    images: Sequence[ArrayLike], log: GyroLog, camera: Camera, exposures: Sequence[Exposure], options: Options
) -> None:
    """Raise `InputError` unless the frames are those of a burst that can be solved with these options."""
    if not 2 <= len(images) <= MOST_FRAMES:
        raise InputError(f"a burst needs 2 to {MOST_FRAMES} frames, got {len(images)}")
    if len(images) != len(exposures):
        raise InputError(f"each frame needs an exposure, got {len(images)} frames and {len(exposures)} exposures")
    for n, (image, exposure) in enumerate(zip(images, exposures, strict=True)):
        check_recording(log, camera, exposure)
        try:
            shape = EncodedImage.of(image, options.transfer).values.shape
            check_size(shape, camera)
        except InputError as error:
            raise InputError(f"frame {n}: {error}") from error
        if np.shape(image) != np.shape(images[0]):
            raise InputError(f"frame {n} has shape {np.shape(image)}, frame 0 has {np.shape(images[0])}")
    if options.border == "unknown":
        raise InputError('a burst cannot be deblurred with border="unknown"; leave it out')


def _use(burst: AlignedBurst, index: int, share: float, frame: ReadoutFrame) -> FrameUse:
    """Return what a frame contributed."""
    own = burst.frames[index]
    noise, blur = own.tuning.noise, own.tuning.radius
    if own.fit is None:
        weights = np.ones(own.grey.shape, dtype=np.float32)
        return FrameUse(share, 1.0, 1.0, 0.0, noise, blur, frame.back(weights))
    fit = own.fit
    shift = own.factor * float(np.sqrt(np.square(fit.shift).sum(axis=0).mean()))
    return FrameUse(share, fit.support, fit.gain, shift, noise * fit.gain, blur, frame.back(own.shown_weights))
