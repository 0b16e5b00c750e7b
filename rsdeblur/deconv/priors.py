"""Priors on derivatives of the sharp picture: Tikhonov, total variation, hyper-Laplacian.

The restored picture minimises

    |A u - g|^2 + weight sum_k a_k |D_k u|^p

where `|D_k u|` is one number per pixel, over all channels (colour edges coincide). For p = 2 that is one linear solve.
For p <= 1 half-quadratic splitting [1]_ introduces targets w_k,

    |A u - g|^2 + sum_k a_k (beta |D_k u - w_k|^2 + weight |w_k|^p)

and alternates between w, which is a shrinkage of the derivatives, and u, which is a linear solve, while beta grows.

Tikhonov and total variation have one D, the gradient, whose two directions are one vector. The hyper-Laplacian has the
derivatives of first and second order [2]_, each a number of its own: edges are rare in each of them. Second derivatives
let slopes pass, of which first ones would make steps.

.. [1] D. Krishnan and R. Fergus, "Fast image deconvolution using hyper-Laplacian priors", NIPS 2009.
.. [2] A. Levin, R. Fergus, F. Durand and W. T. Freeman, "Image and depth from a conventional camera with a coded
   aperture", ACM Transactions on Graphics 26(3), 2007.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import chebyshev

from rsdeblur._util import validate
from rsdeblur._util.threads import share
from rsdeblur.choices import DERIVATIVE_PRIORS, EXPONENT, Prior
from rsdeblur.errors import InputError
from rsdeblur.kernels.shrink import TERMS, shrunk_derivatives_adjoint, shrunk_grad_adjoint, workspace
from rsdeblur.types import Float32Array, FloatImage

# What users meet; the site describes these.
__all__ = ["LatentPrior", "QuadraticSolver", "brightness"]

# Steps of :meth:`DerivativePrior.steps`: their penalties, and how far ahead they look.
PENALTIES, AHEAD = (7.0, 35.0, 178.0, 900.0), 0.5
# Largest strength of the splitting's quadratic term. The pull of a stronger one, of which tiles do not keep the sum,
# outweighs the observation, and the steps diverge beside a very bright pixel. White noise of 0.3 leads to 600.
MOST_STRENGTH = 1e3
# Percentile of a picture's values that counts as the value of its bright parts, and the least value used.
BRIGHTEST, LEAST_PEAK = 99.9, 1e-3
# The splitting ends when a step changes the picture by less than this share of its norm.
TOLERANCE = 1e-4


class Coupling(NamedTuple):
    """Weights of `|u|^2`, `|D u|^2` and `|D^T D u|^2` in a prior's quadratic term of strength 1.

    D takes forward differences in both directions. In the Fourier domain all three are factors, powers of `|D|^2`. The
    weights are at least 0.
    """

    picture: float
    gradient: float
    bend: float

    def response(self, squared: Float32Array) -> Float32Array:
        """Return the term's factor at frequencies at which `|D|^2` has the values `squared`."""
        picture, gradient, bend = np.array(self, np.float32)
        response: Float32Array = picture + squared * (gradient + squared * bend)
        return response


# The target is a picture, a gradient, or the derivatives of kernels.shrink.shrunk_derivatives_adjoint.
TO_PICTURE = Coupling(1.0, 0.0, 0.0)
TO_GRADIENT = Coupling(0.0, 1.0, 0.0)
TO_DERIVATIVES = Coupling(0.0, 0.5, 0.125)


class Kind(NamedTuple):
    """A penalty on a power of derivatives."""

    exponent: float | None  # p; None is the caller's
    # Kernel that computes the pull of the shortened derivatives, None for p = 2, which is one solve; and their term.
    shrink: Callable[..., None] | None
    coupling: Coupling
    # Automatic weight, per root of p, where that of "gradient" and the energy of the gradient are 1
    # (docs/benchmarks/quality.md).
    strength: float

    def power(self, exponent: float) -> float:
        """Return its exponent, or the caller's where it has none of its own."""
        return exponent if self.exponent is None else self.exponent


# The priors by name; `rsdeblur.choices.DERIVATIVE_PRIORS` lists the names.
KINDS = {
    "gradient": Kind(2.0, None, TO_GRADIENT, 1.0),
    "tv": Kind(1.0, shrunk_grad_adjoint, TO_GRADIENT, 2.0),
    "hyper-laplacian": Kind(None, shrunk_derivatives_adjoint, TO_DERIVATIVES, 1.6),
}


class QuadraticSolver(Protocol):
    """Interface on which priors are built: a solver that holds its observation g.

    It minimises over latent pictures u

        |A u - g|^2 + nsr |u|^2 + beta sum_k a_k |D_k u - w_k|^2

    for targets w_k of the picture itself, of its gradient or of its derivatives of first and second order (`Coupling`).
    Differences are zero across the last row and column or, if `periodic`, wrap around.
    """

    @property
    def periodic(self) -> bool:
        """Whether latent pictures repeat."""

    def solve(
        self,
        beta: float,
        pull: FloatImage | None = None,
        coupling: Coupling = TO_GRADIENT,
        *,
        out: FloatImage | None = None,
    ) -> FloatImage:
        """Return u (H', W', C), which may be larger than the observation.

        Parameters
        ----------
        beta : float
            Strength of the prior's quadratic term.
        pull : ndarray, shape (H', W', C), float32, optional
            `sum_k a_k D_k^T w_k`, to which the targets come down; None is zero.
        coupling : Coupling
            What has a target.
        out : ndarray, shape (H', W', C), float32, optional
            Memory that the solver may return u in; it may be that of `pull`.
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


def check_prior(prior: LatentPrior | None) -> LatentPrior:
    """Return `prior`, as a solver's caller gives it; raise `InputError` if it is no instance of a class of priors."""
    if prior is None or isinstance(prior, type) or not hasattr(prior, "restore"):
        raise InputError(f"prior must be a DerivativePrior or a PlugAndPlayPrior, got {validate.shown(prior)}")
    return prior


@dataclass(frozen=True, slots=True)
class DerivativePrior:
    """A penalty on derivatives of the sharp picture, with its numbers.

    Parameters
    ----------
    kind : {"gradient", "tv", "hyper-laplacian"}
        `weight sum |grad u|^p` with p = 2 or 1, or `weight / 2 sum_k |D_k u|^exponent` over five derivatives of first
        and second order.
    weight : float
        Weight of the penalty, from 1e-20 to 1e20: larger is smoother. :class:`rsdeblur.tuning.Tuning` derives one
        from a picture.
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
    >>> rsdeblur.deconv.DerivativePrior("hyper-laplacian", weight=0.01, exponent=0.5)
    DerivativePrior(kind='hyper-laplacian', weight=0.01, exponent=0.5, peak=None)
    """

    kind: Prior
    weight: float
    exponent: float = EXPONENT
    peak: float | None = None

    def __post_init__(self) -> None:
        validate.choice("kind", self.kind, DERIVATIVE_PRIORS)
        object.__setattr__(self, "weight", validate.strength("weight", self.weight))
        object.__setattr__(self, "exponent", validate.exponent("exponent", self.exponent))
        if self.peak is not None:
            object.__setattr__(self, "peak", validate.finite("peak", self.peak, maximum=validate.MOST_LIGHT))

    def with_peak_of(self, image: FloatImage) -> DerivativePrior:
        """Return this prior with the `peak` of a picture, unless it has one."""
        return self if self.peak is not None else replace(self, peak=brightness(image))

    def restore(
        self,
        solver: QuadraticSolver,
        *,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> FloatImage:
        """Return the minimiser of data term and penalty; see :meth:`rsdeblur.deconv.priors.LatentPrior.restore`."""
        if KINDS[self.kind].shrink is None:
            latent = solver.solve(self.weight)
        else:
            for done, step in enumerate(self.steps(solver, threads=threads), 1):
                latent, change = step
                if progress is not None:
                    progress(done / len(PENALTIES))
                # The first step repeats the penalty of the initial solve, so where all derivatives vanish it changes
                # nothing.
                if done > 1 and change < TOLERANCE:
                    break
        if progress is not None:
            progress(1.0)
        return latent

    def steps(
        self,
        solver: QuadraticSolver,
        *,
        penalties: Sequence[float] = PENALTIES,
        ahead: float = AHEAD,
        threads: int | None = None,
    ) -> Iterator[tuple[FloatImage, float]]:
        """Yield the pictures of half-quadratic splitting with a sparse prior; the caller may stop early.

        Parameters
        ----------
        solver : QuadraticSolver
            Solver that holds its observation.
        penalties : sequence of float
            Values of beta / weight, one for each step, for a peak of 1.
        ahead : float
            Steps after the first one shrink the derivatives of a picture that is this share of the last change ahead.
        threads : int, optional
            Threads that share the shrinking; default all processors.

        Yields
        ------
        latent : ndarray, float32
            The picture, in the solver's frame. The next step overwrites it.
        change : float
            Norm of its difference from the step before, as a share of its own norm.
        """
        # Derivatives are proportional to the peak, so the largest one that vanishes must be, too.
        kind, exponent = KINDS[self.kind], KINDS[self.kind].power(self.exponent)
        kernel = kind.shrink
        assert kernel is not None, "restore() solves it at once"
        weight, peak = self.weight, max(1.0 if self.peak is None else self.peak, LEAST_PEAK)
        penalties = [min(penalty * peak ** (exponent - 2.0), MOST_STRENGTH / weight) for penalty in penalties]
        latent = guess = solver.solve(weight * penalties[0], None, kind.coupling)
        polynomial, pull, tops = shrinkage(exponent), np.empty_like(latent), _blocks(latent)

        def shrink(picture: FloatImage, vanishing: np.float32) -> None:
            def block(_: int, top: int) -> None:
                rows, memory = min(tops.step, len(picture) - top), workspace(picture)
                kernel(picture, top, rows, vanishing, polynomial, solver.periodic, memory, pull)

            share(block, tops, threads)

        for penalty in penalties:
            # In units of (weight / beta)^(1 / (2 - p)) the shrinkage has no parameter but p.
            vanishing = np.float32(threshold(exponent) * penalty ** (-1.0 / (2.0 - exponent)))
            shrink(guess, vanishing)
            out = None if guess is latent else guess
            before, latent = latent, solver.solve(weight * penalty, pull, kind.coupling, out=out)
            change, guess = extrapolate(before, latent, np.float32(ahead), threads), before
            yield latent, change


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


def extrapolate(before: FloatImage, after: FloatImage, ahead: np.float32, threads: int | None) -> float:
    """Replace `before` by `after + ahead (after - before)`; threads share blocks of rows.

    Return the norm of the change as a share of that of `after`.
    """
    # One sum per block of rows, so that the total does not depend on the threads.
    tops = _blocks(after)
    squares = np.zeros((len(tops), 2))

    def block(_: int, n: int) -> None:
        old, new = (picture[tops[n] : tops[n] + tops.step] for picture in (before, after))
        step = new - old
        squares[n] = np.square(step).sum(), np.square(new).sum()
        np.add(new, np.multiply(step, ahead, out=step), out=old)

    share(block, range(len(tops)), threads)
    change, norm = squares.sum(axis=0)
    return float(np.sqrt(change / (norm or 1.0)))


def _blocks(latent: FloatImage) -> range:
    """Return the first rows of the blocks that threads share, which have as many rows as its step."""
    height, width, channels = latent.shape
    # So few values at a time that threads finish together.
    return range(0, height, max(1, 150_000 // (width * channels)))


def threshold(exponent: float) -> float:
    """Return the largest t for which `argmin_w |w|^p + (w - t)^2` is zero, for an exponent p in (0, 1]."""
    free = 1.0 - exponent
    return float((1.0 + free) / 2.0 * free ** (-free / (1.0 + free)))


def shrinkage(exponent: float) -> Float32Array:
    """Return the polynomial of w / t, the share of t that `w = argmin_w |w|^p + (w - t)^2` keeps, for p in (0, 1].

    Its variable is `2 T / t - 1`, T being the :func:`threshold`. Its error is at most 3e-4 for exponents up to 2/3, at
    most 3e-3 up to 1, and none at 1.
    """
    places = chebyshev.chebpts1(TERMS)
    t = threshold(exponent) / (0.5 + 0.5 * places)
    w = t - 0.5  # for p = 1, total variation
    if exponent < 1.0:
        w = t.copy()
        # Newton's method on w + p/2 w^(p-1) = t. The left side is convex, so from above it descends to the larger root.
        # At T, where the share is steepest, it needs 6 steps for float64 precision.
        for _ in range(8):
            slope = 1 + exponent / 2 * (exponent - 1) * w ** (exponent - 2)
            w -= (w + exponent / 2 * w ** (exponent - 1) - t) / slope
    polynomial = chebyshev.cheb2poly(chebyshev.chebfit(places, w / t, TERMS - 1)).astype(np.float32)
    # Leading zeros are left out.
    return np.pad(polynomial, (0, TERMS - len(polynomial)))
