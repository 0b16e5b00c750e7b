"""Plans: everything that is decided for a capture before a picture is deblurred, and the deblurring itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import html_with_pictures, one_line
from rsdeblur._util.threads import beside
from rsdeblur.choices import Chroma, Mode, Transfer
from rsdeblur.errors import InputError
from rsdeblur.estimate.check import QualityCheck, doubted_by
from rsdeblur.estimate.motion_evidence import MotionEvidence
from rsdeblur.estimate.refine import Refinement, refine
from rsdeblur.image.encoded import EncodedImage, ReadoutFrame, check_size, displayed, result_like
from rsdeblur.image.highlights import HighlightSplit
from rsdeblur.image.mending import UndershootMeter
from rsdeblur.motion.arguments import check_recording
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.solver import PictureSolver, Strengths, chroma_of
from rsdeblur.pipeline.steps import StageClock, derive_strengths, judged, solve_chunks, split_highlights
from rsdeblur.pipeline.tiles import tile_errors, tile_paths, with_mode
from rsdeblur.psf import PsfBank, kernel_sheet
from rsdeblur.types import FloatImage, Progress


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class DeblurResult:
    """A deblurred picture and what was used for it.

    Parameters
    ----------
    image : ndarray, float32
        The sharp picture, or `out`. Shape and encoding are those of the input, the nominal range is [0, 1]. Results of
        integer input are clipped to that range, those of float input are not.
    transfer : {"linear", "srgb"} or float
        How values of `image` encode light, as those of the input do.
    psfs : PsfBank
        The PSFs that were undone, at their places in the picture as stored; for ``mode="rowwise"`` those of a few rows.
    bands, strips : int
        Number of tiles along the readout axis (for ``mode="rowwise"`` the number of rows) and across it.
    nsr : float
        Noise-to-signal ratio that was used.
    weight : float or None
        Weight of the prior that was used; None for ``prior="wiener"``.
    coverage : ndarray, shape (H, W), bool
        Whether the scene point of a pixel was exposed in some row; True everywhere for ``geometry="keep"``.
    timings : dict
        Seconds spent in each stage.
    check : QualityCheck or None
        Whether to trust the result, see :class:`rsdeblur.estimate.QualityCheck`; None where no check was requested.
    noise : float or None
        Standard deviation of the noise in linear light, estimated or given; None where no strength needed it.
    refinement : Refinement or None
        Correction of the recording, see :func:`rsdeblur.refine`; None where none was requested.
    chroma : {"full", "half"}
        Resolution at which the colours were restored.
    mode : {"banded", "global", "rowwise"}
        Mode that was used.
    tile_error : float or None
        Error of the paths, px, that tiles make down the picture, because it is blurred otherwise within the height of a
        PSF; root mean square. It decides the mode "auto": above 0.1 px, rows are solved one by one. None where kernels
        were given.
    blurred : ndarray or None
        The input, not a copy; None for a burst.
    """

    image: NDArray[Any]
    transfer: Transfer
    psfs: PsfBank
    bands: int
    strips: int
    nsr: float
    weight: float | None
    coverage: NDArray[np.bool_]
    timings: dict[str, float] = field(default_factory=dict)
    check: QualityCheck | None = None
    noise: float | None = None
    refinement: Refinement | None = None
    chroma: Chroma = "full"
    mode: Mode = "banded"
    tile_error: float | None = None
    blurred: NDArray[Any] | None = field(default=None, repr=False)

    def _repr_html_(self) -> str:
        """Return the representation, the pictures and the kernels for a notebook."""
        pictures = {} if self.blurred is None else {"blurred": self.blurred}
        pictures |= {"sharp" if self.check is None else f"sharp ({self.check.verdict})": self.image}
        step = max(1, max(self.image.shape) // 1000)  # decoding takes as long as the picture is large
        shown = {name: displayed(picture[::step, ::step], self.transfer) for name, picture in pictures.items()}
        return html_with_pictures(self, shown | {"kernels": kernel_sheet(self.psfs)})


@one_line()
@dataclass(frozen=True, eq=False)
class Plan:
    """Plan for deblurring pictures of one capture; made by :func:`rsdeblur.plan`.

    Strengths and tiles that the options leave open are derived from a picture. :meth:`apply` does so for each picture,
    :meth:`prepare` once.

    Parameters
    ----------
    frame : ReadoutFrame
        The camera, and the conversion to the frame of the computation.
    capture : Capture
        The motion, in that frame.
    options : Options
        All options.
    strengths : Strengths, optional
        Fixed strengths.
    bank : PsfBank, optional
        Fixed PSFs, in the upright frame.
    refinement : Refinement, optional
        Correction of the recording that the capture contains.
    spent : dict
        Seconds that stages before the plan took.
    """

    frame: ReadoutFrame
    capture: Capture
    options: Options
    strengths: Strengths | None = None
    bank: PsfBank | None = field(default=None, repr=False)
    refinement: Refinement | None = None
    spent: dict[str, float] = field(default_factory=dict, repr=False)

    def prepare(self, image: ArrayLike) -> Plan:
        """Return this plan with the strengths and tiles that suit `image`.

        Parameters
        ----------
        image : array_like
            See :func:`rsdeblur.deblur`.

        Returns
        -------
        Plan

        Raises
        ------
        InputError
            As :func:`rsdeblur.deblur`.
        """
        clock = StageClock()
        strengths, bank = self._prepared(self._split(self._encoded(image), clock), clock)
        return replace(self, strengths=strengths, bank=bank)

    def apply(
        self, image: ArrayLike, *, out: NDArray[Any] | None = None, progress: Progress | None = None
    ) -> DeblurResult:
        """Deblur one picture.

        Parameters
        ----------
        image, out, progress
            See :func:`rsdeblur.deblur`.

        Returns
        -------
        DeblurResult
            The sharp picture, and what was used for it.

        Raises
        ------
        InputError
            As :func:`rsdeblur.deblur`.
        """
        clock = StageClock(validate.callback("progress", progress))
        encoded = self._encoded(image)
        out, upright = result_like(image, out, self.frame)
        split = self._split(encoded, clock)
        # Decoded once for strengths and solve, unless memory is bounded.
        threads = self.options.threads
        light = split.remainder(slice(None), threads=threads) if self.options.max_memory is None else None
        meter = UndershootMeter(encoded.shape[0])
        # What the check needs of the blurred picture is measured while other steps leave a processor free.
        weigh = partial(MotionEvidence.of, encoded, self.capture, threads=1)
        with beside(weigh, threads if self.options.judges else 1) as evidence:
            strengths, bank = self._prepared(split, clock, light)
            solver = PictureSolver(self.options, strengths, bank, self.capture)
            judging = meter if self.options.judges else None
            coverage = solve_chunks(split, upright, solver, clock, light=light, meter=judging, capture=self.capture)
            del light
            check = judged(encoded, upright, evidence, meter, self.options, clock)
        if check is not None and self.refinement is not None:
            check = doubted_by(self.refinement, check)
        return result_of(
            *(out, encoded, solver),
            psfs=self.frame.bank(bank),
            coverage=self.frame.back(coverage),
            timings=self.spent | clock.timings,
            check=check,
            refinement=self.refinement,
            tile_error=tile_errors(self.capture)[0] ** 0.5,
            blurred=np.asarray(image),
        )

    def _encoded(self, image: ArrayLike) -> EncodedImage:
        encoded = EncodedImage.of(image, self.options.transfer, self.frame)
        check_size(np.shape(image), self.frame.stored)
        return encoded

    def _split(self, encoded: EncodedImage, clock: StageClock) -> HighlightSplit:
        """Separate the clipped highlights, if the options request it and there are any."""
        return split_highlights([encoded], self.options, [self.capture], clock)[0]

    def _prepared(
        self, split: HighlightSplit, clock: StageClock, light: FloatImage | None = None
    ) -> tuple[Strengths, PsfBank]:
        """Return the strengths and the PSFs of this plan, or those that suit a picture where it has none."""
        strengths, bank = self.strengths, self.bank
        if strengths is None:
            with clock.stage("tune"):
                strengths = derive_strengths(split, self.options, self.capture, light=light)
        elif bank is not None:
            return strengths, bank
        with clock.stage("psfs"):
            bank = PsfBank.from_paths(self.tile_paths(strengths.tile_nsr), threads=self.options.threads)
        return strengths, bank

    def tile_paths(self, nsr: float) -> BlurPaths:
        """Trace the paths of the PSFs in the upright frame.

        Parameters
        ----------
        nsr : float
            Noise-to-signal ratio that decides the automatic numbers of bands and strips.
        """
        return tile_paths(self.capture, self.options.mode_in_effect, self.options.bands, self.options.strips, nsr)


def result_of(image: NDArray[Any], encoded: EncodedImage, solver: PictureSolver, **found: Any) -> DeblurResult:
    """Return a result with what its solver used, and the fields that are given."""
    (bands, strips), options, strengths = solver.bank.kernels.shape[:2], solver.options, solver.strengths
    used = {
        "transfer": encoded.transfer,
        "psfs": solver.bank,
        "bands": encoded.shape[0] if options.mode_in_effect == "rowwise" else bands,
        "strips": strips,
        "nsr": strengths.nsr,
        "weight": strengths.weight,
        "noise": strengths.noise,
        "chroma": chroma_of(options, solver.bank.size, encoded.shape),
        "mode": options.mode_in_effect,
    }
    return DeblurResult(image, **used | found)


def captured(frame: ReadoutFrame, log: GyroLog, exposure: Exposure, options: Options) -> Capture:
    """Return the capture with all that the options say of its blur."""
    return frame.capture(log, exposure, options.translation, motion=options.motion, softness=options.softness)


def plan(log: GyroLog, camera: Camera, exposure: Exposure, options: Options | None = None) -> Plan:
    """Plan the deblurring of pictures of one capture.

    Parameters
    ----------
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    options : Options, optional
        See :func:`rsdeblur.deblur` for all of them; default `Options()`.

    Returns
    -------
    Plan
        Plan whose :meth:`Plan.apply` deblurs a picture.

    Raises
    ------
    InputError
        If an argument is of another type, or the options ask for a refinement, which needs a picture.
    CoverageError, ClockError, GapError
        If the log does not cover the exposure, is on another clock, or has a gap inside the exposure.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> log, camera = rsdeblur.hand_shake(0.5, seed=1), rsdeblur.Camera(64, 64, 80.0, readout_time=0.03)
    >>> exposure = rsdeblur.Exposure(0.2, 0.05)
    >>> plan = rsdeblur.plan(log, camera, exposure, rsdeblur.Options(prior="wiener", nsr=0.02))
    >>> plan.apply(np.full((64, 64), 0.5)).image.shape
    (64, 64)
    """
    check_recording(log, camera, exposure)
    options = Options() if options is None else validate.instance("options", options, Options)
    if options.refine:
        raise InputError("refine=True needs a picture; call rsdeblur.refine first, and plan with its result")
    frame = ReadoutFrame(camera)
    capture = captured(frame, log, exposure, options)
    return Plan(frame, capture, with_mode(options, [capture]))


def plan_for(
    image: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    options: Options,
    *,
    known_axes: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Plan the deblurring of one picture; with ``options.refine``, of the recording as corrected by it.

    `known_axes` is that of :func:`rsdeblur.refine`; errors are those of :func:`rsdeblur.deblur`.
    """
    if not options.refine:
        return plan(log, camera, exposure, options)
    clock = StageClock()
    with clock.stage("refine"):
        found = refine(
            image,
            log,
            camera,
            exposure,
            translation=options.translation,
            transfer=options.transfer,
            known_axes=known_axes,
            threads=options.threads,
            progress=progress,
        )
    options = replace(options, translation=found.translation, refine=False)
    planned = plan(found.log, found.camera, found.exposure, options)
    return replace(planned, refinement=found, spent=clock.timings)


def refined_together(
    images: Iterable[ArrayLike],
    log: GyroLog,
    camera: Camera,
    exposures: Sequence[Exposure],
    options: Options,
    progress: Progress | None,
) -> Refinement:
    """Return the correction of the recording that some of its pictures share, as the options describe them."""
    first, *_ = refine(
        *(images, log, camera, exposures),
        translation=options.translation,
        transfer=options.transfer,
        threads=options.threads,
        progress=progress,
    )
    return first
