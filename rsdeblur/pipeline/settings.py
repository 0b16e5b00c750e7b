"""How a picture, or a slab of its rows, is solved: the mode, the prior and their numbers in one place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from rsdeblur.deconv.border import Border, Boundary
from rsdeblur.deconv.boundary import extended, extended_shape
from rsdeblur.deconv.fft import Planning
from rsdeblur.deconv.priors import Prior, QuadraticSolver, minimise, restore
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.deconv.rowwise import RowDeconvolver, Solver
from rsdeblur.deconv.wiener import Deconvolver
from rsdeblur.errors import InputError
from rsdeblur.motion.paths import BlurPaths, Capture
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage, StageProgress

Mode = Literal["global", "banded", "rowwise"]
MODES: tuple[Mode, ...] = ("global", "banded", "rowwise")
Solve = Callable[[FloatImage, StageProgress], FloatImage]


@dataclass(frozen=True, slots=True, kw_only=True)
class SolverSettings:
    """Everything but the blur that a solution depends on; the names are those of :func:`rsdeblur.deblur`.

    Parameters
    ----------
    nsr, weight : float
        Numbers, no longer "auto"; `weight` is None for the Wiener filter.
    peak : float
        Value of the picture's bright parts, see :func:`rsdeblur.deconv.priors.brightness`.
    border, extension
        See :func:`rsdeblur.deconv.border.split`.
    """

    mode: Mode
    prior: Prior
    exponent: float
    nsr: float
    weight: float | None
    peak: float
    solver: Solver
    border: Border
    boundary: Boundary | None = None
    planning: Planning
    threads: int | None

    @property
    def _engine(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("nsr", "border", "planning", "threads")}

    def planned(self, capture: Capture, bank: PsfBank, shape: tuple[int, int, int], first: int = 0) -> Solve:
        """Plan what turns a blurred picture and a report of progress into the sharp picture.

        Parameters
        ----------
        capture : Capture
            Of the whole picture.
        bank : PsfBank
            Placed in the picture to be solved.
        shape : (H, W, C)
            Of the picture to be solved: rows of the whole one ...
        first : int
            ... from this one on.
        """
        if self.boundary is not None:
            return self._extended(capture, bank, shape, self.boundary)
        if self.mode == "rowwise":
            return self._rowwise(capture, bank, shape, first)
        return self.tiles(bank, shape)

    def tiles(self, bank: PsfBank, shape: tuple[int, int, int]) -> TileSolve:
        """Plan the same for a mode of tiles, so that it can be re-planned."""
        if self.mode == "rowwise":
            raise InputError('mode="rowwise" has no tiles')
        kind = Deconvolver if self.weight is None else TileQuadratic
        return TileSolve(self, kind(bank, shape, **self._engine))

    def _extended(self, capture: Capture, bank: PsfBank, shape: tuple[int, int, int], boundary: Boundary) -> Solve:
        height, width, _ = shape
        solve = replace(self, boundary=None).planned(capture, bank, extended_shape(shape, bank, boundary))
        return lambda light, report_progress: solve(extended(light, bank, boundary), report_progress)[:height, :width]

    def _rowwise(self, capture: Capture, bank: PsfBank, shape: tuple[int, int, int], first: int) -> Solve:
        paths = BlurPaths.every_row(capture, bank.cols, within=slice(first, first + shape[0]))
        rows = RowDeconvolver(replace(paths, rows=paths.rows - first), shape, solver=self.solver, **self._engine)
        if self.weight is None:
            return lambda light, report_progress: rows.apply(light, progress=report_progress)
        weight, strips = self.weight, len(bank.cols)

        def solve(light: FloatImage, report_progress: StageProgress) -> FloatImage:
            done = iter(range(strips))

            def with_prior(term: QuadraticSolver) -> FloatImage:
                strip = next(done)
                return minimise(
                    term,
                    prior=self.prior,
                    weight=weight,
                    exponent=self.exponent,
                    peak=self.peak,
                    threads=self.threads,
                    progress=lambda fraction: report_progress((strip + fraction) / strips),
                )

            return rows.apply(light, minimise=with_prior)

        return solve


@dataclass(frozen=True, slots=True, eq=False)
class TileSolve:
    """Tiles planned for pictures of one shape, which take other PSFs at the same places without new plans."""

    method: SolverSettings
    filters: Deconvolver | TileQuadratic

    def replan(self, bank: PsfBank) -> None:
        """Undo other PSFs from now on; see :meth:`rsdeblur.Deconvolver.replan`."""
        self.filters.replan(bank)

    def __call__(self, light: FloatImage, report_progress: StageProgress) -> FloatImage:
        """Turn a blurred picture into the sharp one."""
        if isinstance(self.filters, Deconvolver):
            return self.filters.apply(light, progress=report_progress)
        assert self.method.weight is not None
        return restore(
            self.filters,
            light,
            prior=self.method.prior,
            weight=self.method.weight,
            exponent=self.method.exponent,
            peak=self.method.peak,
            threads=self.method.threads,
            progress=report_progress,
        )
