"""The one call: photo, gyro log, camera and exposure in, sharp picture out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur.deconv.border import BORDERS, BOUNDARIES, Border, Boundary, split
from rsdeblur.deconv.fft import PLANNINGS, Planning
from rsdeblur.deconv.priors import EXPONENT, PRIORS, Prior, brightness, check_exponent
from rsdeblur.deconv.rowwise import SOLVERS, Solver
from rsdeblur.errors import InputError
from rsdeblur.estimate.check import QualityCheck, UndershootMeter, assess, fall_back, refuse_fallback
from rsdeblur.estimate.strength import KERNELS, Tuning
from rsdeblur.image.encoded import EncodedImage, check_size, result_like
from rsdeblur.image.highlights import SATURATIONS, HighlightSplit, Saturation, find_spots, separate_highlights
from rsdeblur.image.transfer import Transfer, check_transfer, normalized
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.motion.paths import GEOMETRIES, BlurPaths, Capture, Geometry, Motion
from rsdeblur.motion.rectify import rectify
from rsdeblur.motion.translation import Translation
from rsdeblur.pipeline.memory import plan_chunks
from rsdeblur.pipeline.settings import MODES, Mode, SolverSettings
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.types import Progress

Count = int | Literal["auto"]
Strength = float | Literal["auto"]

# Results are interpolated linearly between tiles, so tiles are added until paths interpolated likewise are this close
# to the true ones (px).
PATH_ERROR = 0.1
# Interpolating results is not quite interpolating paths: at the highest frequency that the filter restores, about
# 1 / (pi L sqrt(nsr)) for a path of L px and never more than 1/2, neighbouring bands must still agree in phase. Their
# paths may differ by this many L sqrt(nsr). (Both numbers: docs/developer/decisions.md.)
BAND_CHANGE = 0.4
# Bands that highlights are found with, whatever the mode.
HIGHLIGHT_NSR = 0.01
# Of the PSFs of all rows, rowwise shows this many per strip.
ROWS_SHOWN = 9
# Pixels that automatic strengths are derived from.
MOST_LOOKED_AT = 8_000_000
# Bounds of the cost where the motion is wild.
MOST_BANDS = 64
MOST_STRIPS = 16


@dataclass(frozen=True, slots=True, eq=False)
class DeblurResult:
    """What `deblur` returns.

    Parameters
    ----------
    image : ndarray, float32
        The sharp picture, or `out`: shaped and coded like the input, nominal range [0, 1]. Integer input is clipped to
        that range; float input is not.
    psfs : PsfBank
        The PSFs that were undone, where they hold in the picture as stored; for ``mode="rowwise"`` those of a few rows.
    bands, strips : int
        How many tiles the picture was split into along the readout axis, every row for ``mode="rowwise"``, and across
        it.
    nsr : float
        Noise-to-signal ratio that was used.
    weight : float or None
        Weight of the prior that was used; None for ``prior="wiener"``.
    coverage : ndarray, shape (H, W), bool
        Pixels whose scene point was seen by some row; all true for ``geometry="keep"``.
    timings : dict
        Seconds spent in each stage.
    check : Check or None
        Whether to trust the result, see :class:`rsdeblur.QualityCheck`; None if that was not asked.
    """

    image: NDArray[np.float32]
    psfs: PsfBank
    bands: int
    strips: int
    nsr: float
    weight: float | None
    coverage: NDArray[np.bool_]
    timings: dict[str, float] = field(default_factory=dict)
    check: QualityCheck | None = None


def deblur(
    image: ArrayLike,
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    mode: Mode = "banded",
    bands: Count = "auto",
    strips: Count = "auto",
    prior: Prior = "wiener",
    weight: Strength = "auto",
    exponent: float = EXPONENT,
    nsr: Strength = "auto",
    solver: Solver = "auto",
    geometry: Geometry = "keep",
    border: Border | Boundary = "blend",
    motion: Motion = "rotation",
    translation: Translation | None = None,
    transfer: Transfer = "linear",
    normalize: bool = False,
    saturation: Saturation = "ignore",
    check: bool = True,
    fallback: bool = False,
    planning: Planning = "estimate",
    threads: int | None = None,
    max_memory: int | None = None,
    out: NDArray[Any] | None = None,
    progress: Progress | None = None,
) -> DeblurResult:
    """Remove camera shake from a rolling-shutter picture.

    Parameters
    ----------
    image : array_like, shape (H, W) or (H, W, C)
        Grey (C = 1 or none), grey + alpha (2), RGB (3) or RGBA (4); uint8 and uint16 are scaled to [0, 1], floats are
        taken as they are. Alpha passes through.
    log, camera, exposure
        The motion, the camera and the time of the exposure.
    mode : {"banded", "global", "rowwise"}
        One PSF per tile; one for the whole picture (Sindelar and Sroubek 2013); or one per row, solved exactly.
    bands, strips : int or "auto"
        Number of tiles along the readout axis and across it; "auto" bounds how much the blur changes between
        neighbours. "global" ignores both, "rowwise" ignores `bands`.
    prior : {"wiener", "gradient", "tv", "hyper-laplacian"}
        Regularisation: the Wiener filter, or a penalty on the gradient (:mod:`rsdeblur.deconv.priors`). The last two
        keep edges sharp and even parts quiet, and take some twenty times as long to apply.
    weight : float or "auto"
        Weight of the penalty on the gradient: larger is smoother. "auto" derives it from the picture's noise and the
        blur (:mod:`rsdeblur.estimate.strength`).
    exponent : float, default 2/3
        Exponent of the hyper-Laplacian, in (0, 1].
    nsr : float or "auto"
        Noise-to-signal power ratio Phi: larger is smoother. "auto" expects it from noise and blur for the Wiener
        filter; for the others, which hardly need it, from the blur's share of the picture.
    solver : {"auto", "direct", "cg"}
        How "rowwise" solves, see :class:`rsdeblur.RowDeconvolver`.
    geometry : {"keep", "rectify"}
        Keep the rolling shutter's shape, or resample to the middle row's mid-exposure.
    border : {"blend", "periodic", "reflect", "edge-taper", "smooth"}
        How the picture goes on beyond its frame: see :class:`rsdeblur.Deconvolver` for the first two. The others are
        alternatives for comparison: mirrored without a blend; tapered into itself blurred; or filled in without a
        Laplacian, in the manner of Liu and Jia (2008). "rowwise" takes the first two only.
    motion : {"rotation", "small-angle"}
        The full homography path, or the paper's eq. 6.
    translation : Translation, optional
        Where the camera was and how far away the scene is (eq. 3 in full); without it only rotation counts.
    transfer : {"linear", "srgb"} or float
        How stored values code light; a number is a gamma. The result is coded the same way.
    normalize : bool, default False
        Squeeze light that overshoots [0, 1] into it, outliers clipped, at the price of contrast.
    saturation : {"ignore", "auto"}
        Take clipped pixels as they are; or find the highlights behind them, solve the picture without them and put them
        back (:mod:`rsdeblur.image.highlights`), which leaves fewer streaks around lamps and takes 63 passes of a filter
        over boxes around them. A picture without clipped highlights comes out the same.
    check : bool, default True
        Judge the result without a reference.
    fallback : bool, default False
        Blend the result towards the input where the check finds it bad; not with ``geometry="rectify"``.
    planning : {"estimate", "measure"}
        How FFTW plans: at once, or by trying out, up to a second per plan; what it finds is kept for later runs,
        whatever they ask for.
    threads : int, optional
        Threads that share the work; default all processors.
    max_memory : int, optional
        Bytes that the work may take beside the picture and its result: large pictures are solved slab by slab. The
        picture and `out` may be memory-mapped files.
    out : ndarray, float32, uint8 or uint16, shaped like `image`, optional
        Receives the result; integers are clipped and rounded.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    DeblurResult

    Raises
    ------
    InputError
        If an argument is out of range, the picture's size is not the camera's, or the blur is larger than the picture.
    CoverageError, ClockError, GapError
        If the log does not describe the exposure.
    """
    validate.choice("prior", prior, PRIORS)
    validate.choice("solver", solver, SOLVERS)
    validate.choice("planning", planning, PLANNINGS)
    validate.choice("geometry", geometry, GEOMETRIES)
    validate.choice("saturation", saturation, SATURATIONS)
    transfer = check_transfer(transfer)
    nsr, weight = _strength("nsr", nsr), _strength("weight", weight)
    check_exponent(exponent)
    max_memory = None if max_memory is None else validate.count("max_memory", max_memory)
    solved_as, boundary = _border(border, mode)
    _check_whole(max_memory, geometry, normalize, border if boundary else None)
    if fallback:
        refuse_fallback(geometry)
    quarter = camera.horizontal_readout
    encoded = EncodedImage.of(image, transfer, quarter=quarter)
    out, upright = result_like(image, out, quarter=quarter)
    check_size(np.shape(image), camera)
    capture = _upright_capture(log, camera, exposure, translation)
    clock = _Clock(progress)
    if mode == "banded" and bands == strips == 1:
        mode = "global"
    split = HighlightSplit(encoded)
    if saturation == "auto":
        with clock.stage("highlights"):
            split = _split_highlights(encoded, capture, motion, threads, max_memory, clock.within("highlights", 0, 1))
        if max_memory is not None:
            max_memory -= split.nbytes
    with clock.stage("tune"):
        phi, penalty, band_nsr = _strengths(split, capture, mode, motion, prior, exponent, nsr, weight, threads)
    with clock.stage("psfs"):
        bank = _bank(capture, mode, bands, strips, motion, band_nsr, threads)
    settings = SolverSettings(
        mode=mode,
        prior=prior,
        exponent=exponent,
        nsr=phi,
        weight=penalty,
        peak=1.0 if penalty is None else brightness(split.remainder(slice(None), 4)),
        solver=solver,
        motion=motion,
        border=solved_as,
        boundary=boundary,
        planning=planning,
        threads=threads,
    )
    meter = UndershootMeter(encoded.shape[0])
    coverage = _solve(split, capture, bank, settings, _After(geometry, normalize), max_memory, upright, meter, clock)
    quality = None
    if check or fallback:
        with clock.stage("check"):
            resampled = geometry == "rectify"
            sharp = EncodedImage(upright, transfer)
            quality = assess(encoded, sharp, capture, meter, motion=motion, resampled=resampled, threads=threads)
            if fallback and quality.verdict == "bad":
                quality = fall_back(encoded, quality, upright)
    n_bands, n_strips = bank.kernels.shape[:2]
    if mode == "rowwise":
        n_bands = encoded.shape[0]
    if quarter:
        coverage, bank = np.rot90(coverage), bank.turned(camera.height)
    return DeblurResult(out, bank, n_bands, n_strips, phi, penalty, coverage, clock.timings, quality)


class _After(NamedTuple):
    """What is done to a picture once it is sharp."""

    geometry: Geometry
    normalize: bool


def _split_highlights(
    encoded: EncodedImage,
    capture: Capture,
    motion: Motion,
    threads: int | None,
    max_memory: int | None,
    report_progress: Callable[[float], None],
) -> HighlightSplit:
    """Take the highlights out."""
    spots = find_spots(encoded)
    if not spots:
        return HighlightSplit(encoded)
    bank = _bank(capture, "banded", "auto", "auto", motion, HIGHLIGHT_NSR, threads)
    return separate_highlights(encoded, spots, bank, threads=threads, max_memory=max_memory, progress=report_progress)


def _solve(
    split: HighlightSplit,
    capture: Capture,
    bank: PsfBank,
    settings: SolverSettings,
    after: _After,
    max_memory: int | None,
    out: NDArray[Any],
    meter: UndershootMeter,
    clock: _Clock,
) -> NDArray[np.bool_]:
    """Solve slab by slab into `out`, and return what was seen."""
    chunks, _ = plan_chunks(bank, split.encoded.shape, settings, max_memory)
    coverage: NDArray[np.bool_] = np.broadcast_to(np.True_, split.encoded.shape[:2])
    for n, chunk in enumerate(chunks):
        light = split.remainder(chunk.read)
        kept = slice(chunk.given.start - chunk.read.start, chunk.given.stop - chunk.read.start)
        meter.before(light[kept], chunk.given)
        with clock.stage("plan"):
            solve = settings.planned(capture, chunk.bank, light.shape, chunk.read.start)
        with clock.stage("apply"):
            light = solve(light, clock.within("apply", n, len(chunks)))
        split.add_highlights(light, chunk.read.start)
        meter.after(light[kept], chunk.given)
        if after.geometry == "rectify":
            with clock.stage("rectify"):
                light, coverage = rectify(light, capture)
        if after.normalize:
            light = normalized(light)
        split.encoded.encode(light[kept], chunk.given, out)
        # Before the next slab is planned beside them.
        del light, solve
    return coverage


def psfs(
    log: GyroLog,
    camera: Camera,
    exposure: Exposure,
    *,
    mode: Mode = "banded",
    bands: Count = "auto",
    strips: Count = "auto",
    nsr: float = 0.01,
    motion: Motion = "rotation",
    translation: Translation | None = None,
) -> PsfBank:
    """Return the PSFs that :func:`deblur` would undo, without a picture.

    Parameters and errors are those of :func:`deblur`; `nsr` counts only for the number of bands, which without a
    picture cannot follow from its noise.
    """
    nsr = validate.finite("nsr", nsr, above=0.0)
    capture = _upright_capture(log, camera, exposure, translation)
    bank = _bank(capture, mode, bands, strips, motion, nsr)
    return bank.turned(camera.height) if camera.horizontal_readout else bank


def _border(border: Border | Boundary, mode: Mode) -> tuple[Border, Boundary | None]:
    """Return what :func:`rsdeblur.deconv.border.split` does; rowwise knows no alternatives."""
    validate.choice("border", border, (*BORDERS, *BOUNDARIES))
    solved_as, boundary = split(border)
    if mode == "rowwise" and boundary:
        raise InputError(f'mode="rowwise" has rows beyond the frame as unknowns: it takes no border="{boundary}"')
    return solved_as, boundary


def _check_whole(max_memory: int | None, geometry: Geometry, normalize: bool, border: str | None) -> None:
    """Refuse to bound the memory of what needs the whole picture."""
    whole = {
        'geometry="rectify"': geometry == "rectify",
        "normalize=True": normalize,
        f'border="{border}"': border is not None,
    }
    if max_memory is not None and any(whole.values()):
        name = next(name for name, asked in whole.items() if asked)
        raise InputError(f"{name} needs the whole picture at once: leave out max_memory, or that")


def _strength(name: str, value: Strength) -> Strength:
    return "auto" if value == "auto" else validate.finite(name, value, above=0.0)


def _strengths(
    split: HighlightSplit,
    capture: Capture,
    mode: Mode,
    motion: Motion,
    prior: Prior,
    exponent: float,
    nsr: Strength,
    weight: Strength,
    threads: int | None,
) -> tuple[float, float | None, float]:
    """Return the `nsr`, the weight, and the `nsr` that the number of bands goes by."""
    if prior == "wiener" and nsr != "auto":
        return nsr, None, nsr
    # The middle rows tell enough of a large picture.
    height, width, _ = split.encoded.shape
    half = min(height, max(1, MOST_LOOKED_AT // width)) // 2
    light = split.remainder(slice(height // 2 - half, height - height // 2 + half))
    bank = _bank(capture, "banded", KERNELS, KERNELS, motion, 1.0, threads)
    tuning = Tuning.of(light, bank, one_filter=mode == "global", continued=mode != "rowwise")
    if prior == "wiener":
        return tuning.wiener_nsr, None, tuning.wiener_nsr
    return (
        tuning.border_error if nsr == "auto" else nsr,
        tuning.weight(prior, exponent) if weight == "auto" else weight,
        tuning.gradient_nsr,
    )


def _bank(
    capture: Capture,
    mode: Mode,
    bands: Count,
    strips: Count,
    motion: Motion,
    nsr: float,
    threads: int | None = None,
) -> PsfBank:
    validate.choice("mode", mode, MODES)
    # A coarse look first: it refuses nonsense before its many samples are computed.
    probe = BlurPaths.probe(capture, motion=motion)
    height, width = capture.camera.height, capture.camera.width
    _check_reach(probe, height, width)
    allowed = BAND_CHANGE * max(float(probe.lengths.max()) * np.sqrt(nsr), 2 / np.pi)
    wanted = (
        max(np.sqrt(probe.curvature_down / (8 * PATH_ERROR)), probe.change_down / allowed),
        np.sqrt(probe.curvature_across / (8 * PATH_ERROR)),
    )
    counts = {"bands": bands, "strips": strips}
    for name, tiles, reach, length, most in zip(
        counts, wanted, probe.extent, (height, width), (MOST_BANDS, MOST_STRIPS), strict=True
    ):
        if mode == "global":
            counts[name] = 1
        elif mode == "rowwise" and name == "bands":
            counts[name] = min(ROWS_SHOWN, length)
        elif counts[name] == "auto":
            # A PSF spans 2 reach + 1 px. A tile narrower than half of that filters rows that are mostly not its own.
            most = min(most, max(1, int(length / (reach + 0.5))))
            counts[name] = int(np.clip(np.ceil(tiles), 1, most))
    rows, cols = (
        tile_centres(validate.count(name, counts[name]), length)
        for name, length in zip(counts, (height, width), strict=True)
    )
    return PsfBank.from_paths(BlurPaths.from_capture(capture, rows, cols, motion=motion), threads=threads)


def _check_reach(paths: BlurPaths, height: int, width: int) -> None:
    down, across = paths.extent
    if 2 * down + 1 > height or 2 * across + 1 > width:
        raise InputError(
            f"the blur reaches {across:.3g} px sideways and {down:.3g} px up and down from its centre, more than "
            f"the picture of {width}x{height} px can hold; are the rates in rad/s, the focal length in px, times in s?"
        )


def _upright_capture(log: GyroLog, camera: Camera, exposure: Exposure, translation: Translation | None) -> Capture:
    """Return the capture with its readout along y."""
    if camera.horizontal_readout:
        camera, translation = camera.turned(), translation and translation.turned()
    return Capture.from_log(log, camera, exposure, translation)


class _Clock:
    """Times the stages and reports progress."""

    def __init__(self, progress: Progress | None) -> None:
        self.timings: dict[str, float] = {}
        self._progress = progress

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        if name not in self.timings:
            self._tell(name, 0.0)
        yield
        self.timings[name] = self.timings.get(name, 0.0) + time.perf_counter() - begin
        if name != "apply":
            self._tell(name, 1.0)

    def within(self, name: str, separate_highlights: int, parts: int) -> Callable[[float], None]:
        """Return what reports the progress of one of several parts of a stage."""
        return lambda fraction: self._tell(name, (separate_highlights + fraction) / parts)

    def _tell(self, name: str, fraction: float) -> None:
        if self._progress is not None:
            self._progress(name, fraction)
