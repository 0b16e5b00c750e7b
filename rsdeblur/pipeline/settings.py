"""Strengths, and settings of a solver for a picture or a chunk of it, with a number for all that is automatic."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from rsdeblur.choices import Border, Boundary, Chroma, Mode, Planning, Prior, Solver
from rsdeblur.deconv.boundary import extended, extended_shape
from rsdeblur.deconv.chroma import HalfChroma, Solve, half_shape, halved, luma_share, suits_half
from rsdeblur.deconv.plug_and_play import DENOISERS, PlugAndPlayPrior
from rsdeblur.deconv.priors import DerivativePrior, LatentPrior
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.deconv.rowwise import RowDeconvolver
from rsdeblur.deconv.unknown_border import UnknownBorderQuadratic
from rsdeblur.deconv.wavelet import WaveletPrior
from rsdeblur.deconv.wiener import Deconvolver
from rsdeblur.errors import InputError
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.pipeline.options import Options
from rsdeblur.psf import PsfBank
from rsdeblur.types import Denoiser, FloatImage, StageProgress


@dataclass(frozen=True, slots=True)
class Strengths:
    """Strengths of a solution, derived from a picture's noise and blur or set by the options.

    Parameters
    ----------
    nsr : float
        Noise-to-signal ratio.
    weight : float or None
        Weight of the prior; None for the Wiener filter.
    peak : float
        Value of the picture's bright parts, see :func:`rsdeblur.deconv.priors.brightness`.
    tile_nsr : float
        Noise-to-signal ratio that decides the automatic numbers of bands and strips.
    wavelet : WaveletPrior, optional
        The learned prior with all its numbers; None for other priors.
    noise : float, optional
        Standard deviation of the picture's noise; None where no strength needed it.
    """

    nsr: float
    weight: float | None
    peak: float
    tile_nsr: float
    wavelet: WaveletPrior | None = None
    noise: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverSettings:
    """Everything that a solution depends on except picture and blur; the names are those of :func:`rsdeblur.deblur`.

    Parameters
    ----------
    nsr, weight : float
        Numbers, never "auto"; `weight` is None for the Wiener filter.
    peak : float
        Value of the picture's bright parts, see :func:`rsdeblur.deconv.priors.brightness`.
    wavelet : WaveletPrior, optional
        The learned prior with all its numbers; None for other priors.
    border, boundary
        How the solver continues the picture beyond its frame; "unknown" if it leaves that open, or None; see
        :class:`rsdeblur.Options`.
    """

    mode: Mode
    prior: Prior | Denoiser
    exponent: float
    nsr: float
    weight: float | None
    peak: float
    wavelet: WaveletPrior | None = None
    solver: Solver
    chroma: Chroma
    border: Border
    boundary: Boundary | None = None
    planning: Planning
    threads: int | None

    @classmethod
    def of(cls, options: Options, strengths: Strengths) -> SolverSettings:
        """Return the settings that follow from all options and the strengths."""
        return cls(
            mode=options.mode_in_effect,
            prior=options.prior_in_effect,
            exponent=options.exponent,
            nsr=strengths.nsr,
            weight=strengths.weight,
            peak=strengths.peak,
            wavelet=strengths.wavelet,
            solver=options.solver,
            chroma=options.chroma_in_effect,
            border=options.border_in_effect,
            boundary=options.boundary_in_effect,
            planning=options.planning,
            threads=options.threads,
        )

    @property
    def engine(self) -> dict[str, Any]:
        """The settings that every solver takes under the same name."""
        return {name: getattr(self, name) for name in ("nsr", "border", "planning", "threads")}

    @property
    def latent_prior(self) -> LatentPrior | None:
        """The prior as the solvers take it; None for the Wiener filter."""
        if self.weight is None:
            return None
        if callable(self.prior):
            return PlugAndPlayPrior(self.prior, self.weight, self.peak)
        if self.prior in DENOISERS:
            return PlugAndPlayPrior(partial(DENOISERS[self.prior], threads=self.threads), self.weight, self.peak)
        if self.wavelet is not None:
            return self.wavelet
        return DerivativePrior(self.prior, self.weight, self.exponent, self.peak)

    def chroma_of(self, size: tuple[int, int], shape: tuple[int, int, int]) -> Chroma:
        """Return the resolution of the colours of pictures (H, W, C), restored with kernels of a size (px)."""
        return "half" if self.chroma == "half" and suits_half(size, shape) else "full"

    def plan_solver(
        self,
        capture: Capture | None,
        bank: PsfBank,
        shape: tuple[int, int, int],
        first: int = 0,
        half: PsfBank | None = None,
    ) -> Solve:
        """Plan the solver. The returned function restores one picture and reports its progress.

        Parameters
        ----------
        capture : Capture or None
            The motion of the whole picture; None if the PSFs do not come from a motion, which "rowwise" needs.
        bank : PsfBank
            PSFs, at places counted from the first of the rows to be solved.
        shape : (H, W, C)
            Shape of the rows to be solved.
        first : int
            Row of the whole picture at which those rows start.
        half : PsfBank, optional
            PSFs of the picture at half the size, where colours are restored at that; default those of
            :func:`rsdeblur.deconv.chroma.halved`.

        Returns
        -------
        callable
            Called as ``solve(light, progress)``; returns the restored light.
        """
        if self.boundary is not None:
            return self._open_border(bank, shape)
        if self.mode == "rowwise" and capture is not None:
            return self._rowwise(capture, bank, shape, first)
        if self.mode == "rowwise":
            raise InputError('mode="rowwise" has no tiles')
        if self.chroma_of(bank.size, shape) == "half":
            return self._half_chroma(bank, half or halved(bank, threads=self.threads), shape)
        prior = self.latent_prior
        if prior is None:
            wiener = Deconvolver(bank, shape, **self.engine)
            return lambda light, progress: wiener.apply(light, progress=progress)
        quadratic = TileQuadratic(bank, shape, **self.engine)
        return lambda light, progress: quadratic.apply(light, prior=prior, progress=progress)

    def _half_chroma(self, bank: PsfBank, half_bank: PsfBank, shape: tuple[int, int, int]) -> HalfChroma:
        """Plan a solver of the brightness, and one of the picture at half size."""
        half = replace(self, chroma="full")
        share = luma_share(self.prior, self.exponent)
        luma = replace(half, nsr=share * self.nsr) if self.weight is None else replace(half, weight=share * self.weight)
        return HalfChroma(
            luma.plan_solver(None, bank, (*shape[:2], 1)),
            half.plan_solver(None, half_bank, half_shape(shape)),
            peak=self.peak,
            threads=self.threads,
        )

    def _open_border(self, bank: PsfBank, shape: tuple[int, int, int]) -> Solve:
        """Plan a solver for which what lies beyond the frame is unknown."""
        (height, width, _), prior = shape, self.latent_prior
        assert prior is not None, "Options refuses the Wiener filter"
        unknown = UnknownBorderQuadratic(
            bank,
            extended_shape(shape, bank),
            recorded=(height, width),
            nsr=self.nsr,
            planning=self.planning,
            threads=self.threads,
        )

        def solve(light: FloatImage, progress: StageProgress) -> FloatImage:
            restored = unknown.apply(extended(light, bank), prior=prior, progress=progress)
            return restored[:height, :width]

        return solve

    def _rowwise(self, capture: Capture, bank: PsfBank, shape: tuple[int, int, int], first: int) -> Solve:
        paths = BlurPaths.every_row(capture, bank.cols, within=slice(first, first + shape[0]))
        paths = replace(paths, rows=paths.rows - first)
        # Of all rows of the picture, not only of these; paths between those of the probe are hardly longer.
        reach = min(int(capture.probe.extent[1]) + 2, (shape[1] - 1) // 2)
        rows = RowDeconvolver(paths, shape, reach=reach, solver=self.solver, **self.engine)
        return lambda light, progress: rows.apply(light, prior=self.latent_prior, progress=progress)
