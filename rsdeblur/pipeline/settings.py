"""How a picture, or a slab of its rows, is solved: the mode, the prior and their numbers in one place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

from rsdeblur.deconv.border import Border, Boundary
from rsdeblur.deconv.boundary import extended, extended_shape
from rsdeblur.deconv.fft import Planning
from rsdeblur.deconv.priors import GradientPrior, Prior
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.deconv.rowwise import RowDeconvolver, Solver
from rsdeblur.deconv.wiener import Deconvolver, TileFilter
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

    @property
    def _gradient_prior(self) -> GradientPrior | None:
        return None if self.weight is None else GradientPrior(self.prior, self.weight, self.exponent, self.peak)

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

    def tiles(self, bank: PsfBank, shape: tuple[int, int, int]) -> TileSolver:
        """Plan the same for a mode of tiles, so that it can be re-planned."""
        if self.mode == "rowwise":
            raise InputError('mode="rowwise" has no tiles')
        if self._gradient_prior is None:
            wiener = Deconvolver(bank, shape, **self._engine)
            return TileSolver(wiener, wiener.apply)
        quadratic = TileQuadratic(bank, shape, **self._engine)
        return TileSolver(quadratic, partial(quadratic.apply, prior=self._gradient_prior))

    def _extended(self, capture: Capture, bank: PsfBank, shape: tuple[int, int, int], boundary: Boundary) -> Solve:
        height, width, _ = shape
        solve = replace(self, boundary=None).planned(capture, bank, extended_shape(shape, bank, boundary))
        return lambda light, report_progress: solve(extended(light, bank, boundary), report_progress)[:height, :width]

    def _rowwise(self, capture: Capture, bank: PsfBank, shape: tuple[int, int, int], first: int) -> Solve:
        paths = BlurPaths.every_row(capture, bank.cols, within=slice(first, first + shape[0]))
        rows = RowDeconvolver(replace(paths, rows=paths.rows - first), shape, solver=self.solver, **self._engine)
        return lambda light, report_progress: rows.apply(light, prior=self._gradient_prior, progress=report_progress)


@dataclass(frozen=True, slots=True, eq=False)
class TileSolver:
    """Tiles planned for pictures of one shape, which take other PSFs at the same places without new plans."""

    filters: TileFilter
    apply: Callable[..., FloatImage]

    def replan(self, bank: PsfBank) -> None:
        """Undo other PSFs from now on; see :meth:`rsdeblur.Deconvolver.replan`."""
        self.filters.replan(bank)

    def __call__(self, light: FloatImage, report_progress: StageProgress) -> FloatImage:
        """Turn a blurred picture into the sharp one."""
        return self.apply(light, progress=report_progress)
