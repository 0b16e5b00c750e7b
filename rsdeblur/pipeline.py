"""The one call: photo, gyro log, camera and exposure in, sharp picture out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur import _validate
from rsdeblur.border import Border
from rsdeblur.camera import Camera
from rsdeblur.errors import InputError
from rsdeblur.exposure import Exposure
from rsdeblur.geometry import rectify
from rsdeblur.gyro import GyroLog
from rsdeblur.motion import GEOMETRIES, BlurPaths, Geometry, Motion, Shot
from rsdeblur.priors import EXPONENT, PRIORS, Prior, Quadratic, brightness, check_exponent, minimise, restore
from rsdeblur.psf import PsfBank, tile_centres
from rsdeblur.quadratic import TileQuadratic
from rsdeblur.rowwise import SOLVERS, RowDeconvolver, Solver
from rsdeblur.transfer import Transfer, check_transfer, from_linear, to_linear
from rsdeblur.tuning import KERNELS, Tuning
from rsdeblur.wiener import Deconvolver

Mode = Literal["global", "banded", "rowwise"]
MODES: tuple[Mode, ...] = ("global", "banded", "rowwise")
Count = int | Literal["auto"]
Strength = float | Literal["auto"]
Progress = Callable[[str, float], None]
Solve = Callable[[NDArray[np.float32], Callable[[float], None]], NDArray[np.float32]]

# Results are interpolated linearly between tiles, so tiles are added until paths interpolated likewise are this close
# to the true ones (px).
PATH_ERROR = 0.1
# Interpolating results is not quite interpolating paths: at the highest frequency that the filter restores, about
# 1 / (pi L sqrt(nsr)) for a path of L px and never more than 1/2, neighbouring bands must still agree in phase. Their
# paths may differ by this many L sqrt(nsr). (Both numbers: docs/developer/decisions.md.)
BAND_CHANGE = 0.4
# Of the PSFs of all rows, rowwise shows this many per strip.
ROWS_SHOWN = 9
# Bounds of the cost where the motion is wild.
MOST_BANDS = 64
MOST_STRIPS = 16


@dataclass(frozen=True, slots=True, eq=False)
class DeblurResult:
    """What `deblur` returns.

    Parameters
    ----------
    image : ndarray, float32
        The sharp picture, shaped and coded like the input, nominal range [0, 1]. Integer input is clipped to that
        range; float input is not.
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
    """

    image: NDArray[np.float32]
    psfs: PsfBank
    bands: int
    strips: int
    nsr: float
    weight: float | None
    coverage: NDArray[np.bool_]
    timings: dict[str, float] = field(default_factory=dict)


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
    border: Border = "blend",
    motion: Motion = "rotation",
    transfer: Transfer = "linear",
    threads: int | None = None,
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
        Regularisation: the Wiener filter, or a penalty on the gradient (:mod:`rsdeblur.priors`). The last two keep
        edges sharp and even parts quiet, and take some twenty times as long to apply.
    weight : float or "auto"
        Weight of the penalty on the gradient: larger is smoother. "auto" derives it from the picture's noise and the
        blur (:mod:`rsdeblur.tuning`).
    exponent : float, default 2/3
        Exponent of the hyper-Laplacian, in (0, 1].
    nsr : float or "auto"
        Noise-to-signal power ratio Phi: larger is smoother. "auto" expects it from noise and blur for the Wiener
        filter; for the others, which hardly need it, from the blur's share of the picture.
    solver : {"auto", "direct", "cg"}
        How "rowwise" solves, see :class:`rsdeblur.RowDeconvolver`.
    geometry : {"keep", "rectify"}
        Keep the rolling shutter's shape, or resample to the middle row's mid-exposure.
    border : {"blend", "periodic"}
        See :class:`rsdeblur.Deconvolver`.
    motion : {"rotation", "small-angle"}
        The full homography path, or the paper's eq. 6.
    transfer : {"linear", "srgb"} or float
        How stored values code light; a number is a gamma. The result is coded the same way.
    threads : int, optional
        Threads that share the work; default all processors.
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
    _validate.choice("prior", prior, PRIORS)
    _validate.choice("solver", solver, SOLVERS)
    _validate.choice("geometry", geometry, GEOMETRIES)
    transfer = check_transfer(transfer)
    nsr, weight = _strength("nsr", nsr), _strength("weight", weight)
    check_exponent(exponent)
    values, clip = _values(image)
    _check_size(values.shape, camera)
    shot, quarter = _upright_shot(log, camera, exposure)
    clock = _Clock(progress)
    colour, alpha = _split_alpha(np.rot90(values, -1) if quarter else values)
    light = to_linear(np.ascontiguousarray(colour), transfer)
    with clock.stage("tune"):
        phi, penalty, band_nsr = _strengths(light, shot, motion, prior, exponent, nsr, weight)
    with clock.stage("psfs"):
        bank = _bank(shot, mode, bands, strips, motion, band_nsr)
    with clock.stage("plan"):
        solve = _planned(
            shot,
            bank,
            light.shape,
            mode,
            prior,
            exponent,
            phi,
            penalty,
            solver=solver,
            motion=motion,
            border=border,
            threads=threads,
        )
    with clock.stage("apply"):
        light = solve(light, clock.within("apply"))
    coverage = np.ones(light.shape[:2], dtype=np.bool_)
    if geometry == "rectify":
        with clock.stage("rectify"):
            light, coverage = rectify(light, shot)
    sharp = from_linear(light, transfer)
    if clip:
        sharp = sharp.clip(0.0, 1.0)
    if alpha is not None:
        sharp = np.concatenate([sharp, alpha], axis=2)
    n_bands, n_strips = bank.kernels.shape[:2]
    if mode == "rowwise":
        n_bands = len(light)
    if quarter:
        sharp, coverage, bank = np.rot90(sharp), np.rot90(coverage), bank.turned(camera.height)
    sharp = np.ascontiguousarray(sharp.reshape(np.shape(image)))
    coverage = np.ascontiguousarray(coverage)
    return DeblurResult(sharp, bank, n_bands, n_strips, phi, penalty, coverage, clock.timings)


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
) -> PsfBank:
    """Return the PSFs that :func:`deblur` would undo, without a picture.

    Parameters and errors are those of :func:`deblur`; `nsr` counts only for the number of bands, which without a
    picture cannot follow from its noise.
    """
    nsr = _validate.finite("nsr", nsr, above=0.0)
    shot, quarter = _upright_shot(log, camera, exposure)
    bank = _bank(shot, mode, bands, strips, motion, nsr)
    return bank.turned(camera.height) if quarter else bank


def _strength(name: str, value: Strength) -> Strength:
    return "auto" if value == "auto" else _validate.finite(name, value, above=0.0)


def _strengths(
    light: NDArray[np.float32],
    shot: Shot,
    motion: Motion,
    prior: Prior,
    exponent: float,
    nsr: Strength,
    weight: Strength,
) -> tuple[float, float | None, float]:
    """Return the `nsr`, the weight, and the `nsr` that the number of bands goes by."""
    if prior == "wiener" and nsr != "auto":
        return nsr, None, nsr
    tuning = Tuning.of(light, _bank(shot, "banded", KERNELS, KERNELS, motion, 1.0))
    if prior == "wiener":
        return tuning.wiener_nsr, None, tuning.wiener_nsr
    return (
        tuning.border_error if nsr == "auto" else nsr,
        tuning.weight(prior, exponent) if weight == "auto" else weight,
        tuning.gradient_nsr,
    )


def _planned(
    shot: Shot,
    bank: PsfBank,
    shape: tuple[int, int, int],
    mode: Mode,
    prior: Prior,
    exponent: float,
    nsr: float,
    weight: float | None,
    *,
    solver: Solver,
    motion: Motion,
    border: Border,
    threads: int | None,
) -> Solve:
    """Plan what turns a picture and a report of progress into the sharp picture."""
    if mode == "rowwise":
        paths = BlurPaths.every_row(shot, bank.cols, motion=motion)
        rows = RowDeconvolver(paths, shape, nsr=nsr, solver=solver, border=border, threads=threads)
        if weight is None:
            return lambda light, progress: rows.apply(light, progress=progress)
        strips = len(bank.cols)

        def solve_rows(light: NDArray[np.float32], progress: Callable[[float], None]) -> NDArray[np.float32]:
            peak, done = brightness(light), iter(range(strips))

            def with_prior(term: Quadratic) -> NDArray[np.float32]:
                strip = next(done)
                return minimise(
                    term,
                    prior=prior,
                    weight=weight,
                    exponent=exponent,
                    peak=peak,
                    threads=threads,
                    progress=lambda fraction: progress((strip + fraction) / strips),
                )

            return rows.apply(light, minimise=with_prior)

        return solve_rows
    if weight is None:
        filters = Deconvolver(bank, shape, nsr=nsr, border=border, threads=threads)
        return lambda light, progress: filters.apply(light, progress=progress)
    tiles = TileQuadratic(bank, shape, nsr=nsr, border=border, threads=threads)
    return lambda light, progress: restore(
        tiles, light, prior=prior, weight=weight, exponent=exponent, threads=threads, progress=progress
    )


def _bank(shot: Shot, mode: Mode, bands: Count, strips: Count, motion: Motion, nsr: float) -> PsfBank:
    _validate.choice("mode", mode, MODES)
    # A coarse look first: it refuses nonsense before its many samples are computed.
    probe = BlurPaths.probe(shot, motion=motion)
    height, width = shot.camera.height, shot.camera.width
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
        tile_centres(_validate.count(name, counts[name]), length)
        for name, length in zip(counts, (height, width), strict=True)
    )
    return PsfBank.from_paths(BlurPaths.from_shot(shot, rows, cols, motion=motion))


def _check_reach(paths: BlurPaths, height: int, width: int) -> None:
    down, across = paths.extent
    if 2 * down + 1 > height or 2 * across + 1 > width:
        raise InputError(
            f"the blur reaches {across:.0f} px sideways and {down:.0f} px up and down from its centre, more than "
            f"the picture of {width}x{height} px can hold; are the rates in rad/s, the focal length in px, times in s?"
        )


def _upright_shot(log: GyroLog, camera: Camera, exposure: Exposure) -> tuple[Shot, bool]:
    """Return the shot with its readout along y, and whether the picture has to be turned for that."""
    quarter = camera.horizontal_readout
    return Shot.from_log(log, camera.turned() if quarter else camera, exposure), quarter


def _values(image: ArrayLike) -> tuple[NDArray[np.float32], bool]:
    """Return the picture as finite float32 (H, W, C), and whether it came as integers."""
    array: NDArray[Any] = np.asarray(image)
    if array.ndim not in (2, 3) or array.size == 0 or (array.ndim == 3 and array.shape[2] > 4):
        raise InputError(f"image must have shape (H, W) or (H, W, C) with C from 1 to 4, got {array.shape}")
    integer = array.dtype in (np.uint8, np.uint16)
    if not integer and not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"image must be uint8, uint16 or float, got {array.dtype}")
    values = array.astype(np.float32)
    if integer:
        values /= np.iinfo(array.dtype).max
    elif not np.isfinite(values).all():
        raise InputError("image must be finite")
    return values if values.ndim == 3 else values[:, :, None], integer


def _split_alpha(values: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    if values.shape[2] in (2, 4):
        return values[:, :, :-1], values[:, :, -1:]
    return values, None


def _check_size(shape: tuple[int, ...], camera: Camera) -> None:
    height, width = shape[:2]
    if (height, width) == (camera.height, camera.width):
        return
    if (height, width) == (camera.width, camera.height):
        hint = "it is turned by a quarter; turn the picture or describe the camera as the picture is stored"
    elif abs(width * camera.height - height * camera.width) <= max(width, camera.width):
        hint = f"if it was resized, scale the camera (file) too: camera.scaled({width / camera.width:.6g})"
    else:
        hint = "if it was cut out, cut the camera (file) too: camera.cropped(left, top, width, height)"
    raise InputError(
        f"the picture is {width}x{height} px but the camera's is {camera.width}x{camera.height} px; {hint}"
    )


class _Clock:
    """Times the stages and reports progress."""

    def __init__(self, progress: Progress | None) -> None:
        self.timings: dict[str, float] = {}
        self._progress = progress

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        self._tell(name, 0.0)
        yield
        self._tell(name, 1.0)
        self.timings[name] = time.perf_counter() - begin

    def within(self, name: str) -> Callable[[float], None]:
        return lambda fraction: self._tell(name, fraction)

    def _tell(self, name: str, fraction: float) -> None:
        if self._progress is not None:
            self._progress(name, fraction)
