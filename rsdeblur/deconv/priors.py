"""Priors on the gradient of the sharp picture: Tikhonov, total variation, hyper-Laplacian.

The restored picture minimises

    |A u - g|^2 + weight sum |grad u|^p

where `|grad u|` is one number per pixel, over both directions and all channels (colour edges coincide). For p = 2 that
is one linear solve. For p <= 1 half-quadratic splitting [1]_ introduces a target gradient w,

    |A u - g|^2 + beta |grad u - w|^2 + weight sum |w|^p

and alternates between w, which is a shrinkage of `grad u`, and u, which is a linear solve, while beta grows.

.. [1] D. Krishnan and R. Fergus, "Fast image deconvolution using hyper-Laplacian priors", NIPS 2009.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.threads import share
from rsdeblur.choices import PRIORS, Prior
from rsdeblur.errors import InputError
from rsdeblur.kernels.shrink import shrunk_grad_adjoint
from rsdeblur.types import FloatImage

EXPONENT = 2 / 3

# beta / weight at each step, for pictures whose bright parts have the value 1.
PENALTIES = (5.0, 14.0, 40.0, 112.0, 316.0, 900.0)
# Percentile of a picture's values that counts as the value of its bright parts, and the least value used.
BRIGHTEST, LEAST_PEAK = 99.9, 1e-3
# The splitting ends when a step changes the picture by less than this share of its norm.
TOLERANCE = 1e-4
# Entries of the shrinkage table; linear interpolation between them has an error of at most 1e-6.
TABLE = 2049
# Rows that a thread shrinks at a time.
ROWS = 64


class GradientSolver(Protocol):
    """Interface on which :func:`half_quadratic` builds a prior: a solver that holds its observation g.

    It minimises over latent pictures u

        |A u - g|^2 + nsr |u|^2 + beta |D u - w|^2

    D takes forward differences, which are zero across the last row and column or, if `periodic`, wrap around. The
    target gradient w enters only as `D^T w`, which is a picture like u.
    """

    @property
    def periodic(self) -> bool:
        """Whether latent pictures repeat."""

    def solve(self, beta: float, grad_adjoint: FloatImage | None) -> FloatImage:
        """Return u (H', W', C), which may be larger than the observation.

        Parameters
        ----------
        beta : float
            Weight of the target gradient.
        grad_adjoint : ndarray, shape (H', W', C), float32, or None
            `D^T w`; None is zero. The solver may overwrite it and return u in its memory.
        """


class QuadraticSolver(GradientSolver, Protocol):
    """A solver that also minimises `|A u - g|^2 + nsr |u|^2 + beta |u - v|^2`."""

    def solve_near(self, beta: float, target: FloatImage) -> FloatImage:
        """Return u (H', W', C) near a target picture.

        Parameters
        ----------
        beta : float
            Weight of the target.
        target : ndarray, shape (H', W', C), float32
            The target v. The solver may overwrite it and return u in its memory.
        """


class LatentPrior(Protocol):
    """A prior on the sharp picture, with its strength."""

    def with_peak_of(self, image: FloatImage) -> LatentPrior:
        """Return this prior with the :func:`brightness` of a picture, unless it has one.

        Parameters
        ----------
        image : ndarray, shape (H, W, C), float32
            Linear light.
        """

    def restore(
        self,
        solver: QuadraticSolver,
        *,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> FloatImage:
        """Return the restored picture (H', W', C), float32, in the frame of `solver`.

        Parameters
        ----------
        solver : QuadraticSolver
            Solver that holds its observation.
        threads : int, optional
            Threads that share the work of the prior; default all processors. Any number gives the same bits.
        progress : callable, optional
            Called with the finished fraction after each solve.
        """


def check_prior(prior: LatentPrior) -> LatentPrior:
    """Return `prior`, which must be an instance of a class of priors.

    Parameters
    ----------
    prior : LatentPrior
        The prior, as a solver's caller gives it.

    Raises
    ------
    InputError
        If it is something else.
    """
    if isinstance(prior, type) or not hasattr(prior, "restore"):
        raise InputError(
            f"prior must be a GradientPrior, a WaveletPrior or a PlugAndPlayPrior, got {validate.shown(prior)}"
        )
    return prior


class PriorSolver(Protocol):
    """A planned solver that takes a prior: :class:`rsdeblur.TileQuadratic`, :class:`rsdeblur.RowDeconvolver`."""

    def apply(
        self,
        image: ArrayLike,
        out: FloatImage | None = None,
        *,
        prior: LatentPrior,
        progress: Callable[[float], None] | None = None,
    ) -> FloatImage:
        """Deblur a picture of the planned shape, linear light, under `prior`."""


@dataclass(frozen=True, slots=True)
class GradientPrior:
    """The penalty `weight sum |grad u|^p` on the sharp picture u, with its numbers.

    Parameters
    ----------
    kind : {"gradient", "tv", "hyper-laplacian"}
        The power p is 2, 1 or `exponent`.
    weight : float
        Weight of the penalty, from 1e-20 to 1e20: larger is smoother. :class:`rsdeblur.Tuning` derives one from a
        picture.
    exponent : float, default 2/3
        Exponent of the hyper-Laplacian, in (0, 1].
    peak : float, optional
        Value of the picture's bright parts, to which the penalties of the splitting are scaled; default
        :func:`brightness` of the picture that is solved.

    Raises
    ------
    InputError
        If an argument is out of range.

    Examples
    --------
    >>> import rsdeblur
    >>> rsdeblur.GradientPrior("hyper-laplacian", weight=0.01, exponent=0.5)
    GradientPrior(kind='hyper-laplacian', weight=0.01, exponent=0.5, peak=None)
    """

    kind: Prior
    weight: float
    exponent: float = EXPONENT
    peak: float | None = None

    def __post_init__(self) -> None:
        validate.choice("prior", self.kind, PRIORS)
        others = {
            "wiener": "rsdeblur.Deconvolver",
            "wavelet": "rsdeblur.Tuning.wavelet",
            "nlm": "rsdeblur.PlugAndPlayPrior",
            "cnn": "rsdeblur.PlugAndPlayPrior",
        }
        other = others.get(self.kind)
        if other is not None:
            raise InputError(f'prior "{self.kind}" is not a prior on the gradient: use {other}')
        object.__setattr__(self, "weight", validate.strength("weight", self.weight))
        object.__setattr__(self, "exponent", validate.exponent(self.exponent))
        if self.peak is not None:
            object.__setattr__(self, "peak", validate.finite("peak", self.peak, maximum=validate.MOST_LIGHT))

    def with_peak_of(self, image: FloatImage) -> GradientPrior:
        """Return this prior with the `peak` of a picture, unless it has one.

        Parameters
        ----------
        image : ndarray, shape (H, W, C), float32
            Linear light.
        """
        return self if self.peak is not None else replace(self, peak=brightness(image))

    def restore(
        self,
        solver: QuadraticSolver,
        *,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> FloatImage:
        """Return the picture that minimises the data term plus this penalty.

        Parameters
        ----------
        solver : QuadraticSolver
            Solver that holds its observation.
        threads : int, optional
            Threads that share the work of the prior; default all processors. Any number gives the same bits.
        progress : callable, optional
            Called with the finished fraction after each solve.

        Returns
        -------
        ndarray, shape (H', W', C), float32
            In the frame of `solver`.
        """
        if self.kind == "gradient":
            latent = solver.solve(self.weight, None)
        else:
            exponent = 1.0 if self.kind == "tv" else self.exponent
            peak = 1.0 if self.peak is None else self.peak
            steps = half_quadratic(solver, weight=self.weight, exponent=exponent, peak=peak, threads=threads)
            for done, step in enumerate(steps, 1):
                if progress is not None:
                    progress(done / len(PENALTIES))
                latent = step.latent
                # The first step repeats the penalty of the initial solve, so where all gradients vanish it changes
                # nothing.
                if done > 1 and step.change < TOLERANCE:
                    break
        if progress is not None:
            progress(1.0)
        return latent


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One step of :func:`half_quadratic`.

    Parameters
    ----------
    latent : ndarray, float32
        The picture, in the solver's frame. The step after next overwrites it.
    change : float
        Norm of its difference from the step before, as a share of its own norm.
    """

    latent: FloatImage
    change: float


def restore(
    solver: PriorSolver,
    image: ArrayLike,
    *,
    prior: Prior,
    weight: float,
    exponent: float = EXPONENT,
    peak: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> FloatImage:
    """Deblur a picture with a prior on its gradient.

    The same as ``solver.apply(image, prior=GradientPrior(prior, weight, exponent, peak))``.

    Parameters
    ----------
    solver : TileQuadratic or RowDeconvolver
        Planned solver; its threads share the work.
    image : array_like of the planned shape
        Linear light, floats, nominal range [0, 1].
    prior, weight, exponent, peak
        See :class:`rsdeblur.GradientPrior`.
    progress : callable, optional
        Called with the finished fraction after each solve. An exception that it raises stops the work.

    Returns
    -------
    ndarray of the planned shape, float32
        Not clipped.

    Raises
    ------
    InputError
        If an argument is out of range, or `image` has another shape, holds integers or is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> bank = rsdeblur.PsfBank.for_picture(np.full((1, 5), 0.2), (64, 64))
    >>> solver, light = rsdeblur.TileQuadratic(bank, (64, 64)), np.full((64, 64), 0.5)
    >>> rsdeblur.restore(solver, light, prior="tv", weight=0.01).shape
    (64, 64)
    """
    if not hasattr(solver, "apply"):
        raise InputError(f"solver must be a TileQuadratic or a RowDeconvolver, got {validate.shown(solver)}")
    return solver.apply(image, prior=GradientPrior(prior, weight, exponent, peak), progress=progress)


def brightness(image: FloatImage) -> float:
    """Return the value of the bright parts of a picture; it looks at every fourth row and column.

    Parameters
    ----------
    image : ndarray, shape (H, W, C), float32
        Linear light.

    Raises
    ------
    InputError
        If a value there is not finite.
    """
    value = float(np.percentile(image[::4, ::4], BRIGHTEST))
    if not np.isfinite(value):
        raise InputError("image must be finite")
    return value


def half_quadratic(
    solver: GradientSolver, *, weight: float, exponent: float, peak: float = 1.0, threads: int | None = None
) -> Iterator[Step]:
    """Yield the pictures of the splitting, one for each of `PENALTIES`; the caller may stop early.

    Parameters
    ----------
    solver : GradientSolver
        Solver that holds its observation.
    weight : float
        Weight of the prior, positive.
    exponent : float
        Power p of the gradient, in (0, 1].
    peak : float, default 1.0
        Value of the picture's bright parts.
    threads : int, optional
        Threads that share the shrinking; default all processors.

    Yields
    ------
    Step
    """
    # Gradients are proportional to the peak, so the largest gradient that vanishes must be, too.
    penalties = [penalty * max(peak, LEAST_PEAK) ** (exponent - 2.0) for penalty in PENALTIES]
    latent = solver.solve(weight * penalties[0], None)
    table, spare = shrinkage(exponent), np.empty_like(latent)
    for penalty in penalties:
        # In units of (weight / beta)^(1 / (2 - p)) the shrinkage has no parameter but p.
        vanishing = np.float32(threshold(exponent) * penalty ** (-1.0 / (2.0 - exponent)))
        _shrink(latent, vanishing, table, solver.periodic, spare, threads)
        latent, spare = solver.solve(weight * penalty, spare), latent
        yield Step(latent, _change(spare, latent, threads))


def _shrink(
    latent: FloatImage,
    vanishing: np.float32,
    table: NDArray[np.float32],
    periodic: bool,
    grad_adjoint: FloatImage,
    threads: int | None,
) -> None:
    """Fill `grad_adjoint` with `D^T w`, w being the shrunk gradient of `latent`; threads share blocks of rows."""
    height = len(latent)

    def block(_: int, top: int) -> None:
        shrunk_grad_adjoint(latent, top, min(ROWS, height - top), vanishing, table, periodic, grad_adjoint)

    share(block, range(0, height, ROWS), threads)


def _change(before: FloatImage, after: FloatImage, threads: int | None) -> float:
    """Return the norm of the difference as a share of the norm of `after`."""
    # One sum per block of rows, so that the total does not depend on the threads.
    squares = np.zeros((-(-len(after) // ROWS), 2))

    def block(_: int, n: int) -> None:
        new = after[n * ROWS : (n + 1) * ROWS].ravel()
        step = new - before[n * ROWS : (n + 1) * ROWS].ravel()
        squares[n] = np.dot(step, step), np.dot(new, new)

    share(block, range(len(squares)), threads)
    change, norm = squares.sum(axis=0)
    return float(np.sqrt(change / (norm or 1.0)))


def threshold(exponent: float) -> float:
    """Return the largest t for which `argmin_w |w|^p + (w - t)^2` is zero.

    Parameters
    ----------
    exponent : float
        Exponent p, in (0, 1].
    """
    free = 1.0 - exponent
    return float((1.0 + free) / 2.0 * free ** (-free / (1.0 + free)))


def shrinkage(exponent: float) -> NDArray[np.float32]:
    """Return a table of w / t, the share of t that `w = argmin_w |w|^p + (w - t)^2` keeps.

    Its entries are at evenly spaced values of T / t from 0 to 1, T being the :func:`threshold`.

    Parameters
    ----------
    exponent : float
        Exponent p, in (0, 1].
    """
    t = threshold(exponent) / np.linspace(0.0, 1.0, TABLE)[1:]
    w = t - 0.5  # for p = 1, total variation
    if exponent < 1.0:
        w = t.copy()
        # Newton's method on w + p/2 w^(p-1) = t. The left side is convex, so from above it descends to the larger root.
        # At T, where the table is steepest, it needs 6 steps for float64 precision.
        for _ in range(8):
            slope = 1 + exponent / 2 * (exponent - 1) * w ** (exponent - 2)
            w -= (w + exponent / 2 * w ** (exponent - 1) - t) / slope
    return np.concatenate([[1.0], w / t]).astype(np.float32)
