"""The quadratic problem behind priors on the gradient, solved tile by tile in the hybrid domain."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Border, Planning
from rsdeblur.deconv.priors import LatentPrior, check_prior
from rsdeblur.deconv.wiener import TileFilter
from rsdeblur.kernels.responses import responses
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatImage

# Margin of a tile: by how much it is longer than the part that it contributes, in PSF sizes.
MARGIN = 3.0

Coupling = tuple[NDArray[np.float32], NDArray[np.float32]]


@one_line("shape", "nsr", "_kernel_size")
class TileQuadratic(TileFilter):
    """Deconvolution with a bank of PSFs and a prior on the gradient, planned once and applied often.

    As a :class:`rsdeblur.deconv.priors.QuadraticSolver` it solves, by two passes of filters,

        U = ((1 + nsr) conj(H) G + beta V) / (|H|^2 + nsr + beta |D|^2)

    for the observation G and V = D^T w. The factor 1 + nsr has the purpose that it has in
    :class:`rsdeblur.Deconvolver`.

    Parameters
    ----------
    bank : PsfBank
        See :class:`rsdeblur.Deconvolver`.
    shape : (H, W) or (H, W, C)
        Shape of the pictures.
    nsr : float, default 0.001
        Share of the signal's power that the model of the blur gets wrong, as at the borders; not negative.
    border, planning, threads
        See :class:`rsdeblur.Deconvolver`.

    Raises
    ------
    InputError
        As :class:`rsdeblur.Deconvolver` does.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> bank = rsdeblur.PsfBank.for_picture(np.full((1, 5), 0.2), (64, 64))
    >>> solver = rsdeblur.TileQuadratic(bank, (64, 64))
    >>> solver.apply(np.full((64, 64), 0.5), prior=rsdeblur.GradientPrior("tv", 0.01)).shape
    (64, 64)
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        nsr: float = 0.001,
        border: Border = "blend",
        planning: Planning = "estimate",
        threads: int | None = None,
    ) -> None:
        super().__init__(bank, shape, margin=MARGIN, border=border, planning=planning, threads=threads)
        self.nsr = validate.finite("nsr", nsr, minimum=0.0, maximum=validate.MOST_STRENGTH)
        self.periodic = border == "periodic"
        self._otf, self._filters = self._new_filters(), self._new_filters()
        self.replan(bank)
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        self._across, self._down = (
            (4 * np.sin(np.pi * np.arange(count) / length) ** 2).astype(np.float32)
            for count, length in (
                (self._hybrid.frequencies, self._strips.length),
                (self._bands.length, self._bands.length),
            )
        )

    def _take(self, bank: PsfBank) -> None:
        self._fill_otfs(bank, self._otf)

    def apply(
        self,
        image: ArrayLike,
        out: NDArray[np.float32] | None = None,
        *,
        prior: LatentPrior,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Deblur one picture.

        Parameters
        ----------
        image : array_like of the planned shape
            Linear light, floats; converted to float32.
        out : ndarray, float32, optional
            Receives the result; may be `image` itself.
        prior : GradientPrior, WaveletPrior or PlugAndPlayPrior
            Assumption about the sharp picture.
        progress : callable, optional
            Called with the finished fraction after each solve.

        Returns
        -------
        ndarray, float32
            `out`, or a new array; not clipped.

        Raises
        ------
        InputError
            If `image` or `out` has another shape or type, or `image` is not finite. Integers are no linear light:
            :func:`rsdeblur.image.transfer.to_linear` converts them.
        """
        check_prior(prior)
        validate.callback("progress", progress)
        if out is not None:
            out = validate.output(out, self.shape)
        with self.lock:
            self.prepare(image)
            prior = prior.with_peak_of(self._observation)
            latent = prior.restore(self, threads=self.threads, progress=progress).reshape(self.shape)
            del self._observation
        if out is None:
            return latent
        out[...] = latent
        return out

    def prepare(self, image: ArrayLike) -> None:
        """Set the observation.

        Parameters
        ----------
        image : array_like of the planned shape
            Linear light, floats.
        """
        self._observation = validate.linear_light(image, self.shape).reshape(self._channelled)

    def solve(self, beta: float, grad_adjoint: FloatImage | None = None) -> FloatImage:
        """Return the minimiser for the observation.

        Parameters
        ----------
        beta : float
            Weight of the gradient term, at least 0.
        grad_adjoint : ndarray, shape (H, W, C), float32, optional
            `D^T w`; None is zero. Its memory receives the result.

        Returns
        -------
        ndarray, shape (H, W, C), float32

        Raises
        ------
        InputError
            If the observation is not finite.
        """
        return self._solve(beta, grad_adjoint, (self._across, self._down))

    def solve_near(self, beta: float, target: FloatImage) -> FloatImage:
        """Return the minimiser of the data term plus `beta |u - v|^2`.

        Parameters
        ----------
        beta : float
            Weight of the target, at least 0.
        target : ndarray, shape (H, W, C), float32
            The target v. Its memory receives the result.

        Returns
        -------
        ndarray, shape (H, W, C), float32

        Raises
        ------
        InputError
            If the observation is not finite.
        """
        return self._solve(beta, target, (np.full_like(self._across, 0.5), np.full_like(self._down, 0.5)))

    def _solve(self, beta: float, pull: FloatImage | None, coupling: Coupling) -> FloatImage:
        """Return the minimiser with a term of weight `beta`, whose right-hand side is `beta pull`.

        `coupling` has two parts, along x and along y, whose sum is the term's matrix: |D|^2, or 1.
        """
        latent = np.empty(self._channelled, dtype=np.float32)
        self._respond(beta, self._observation, latent, coupling, of_pull=False)
        if pull is None:
            return latent
        self._respond(beta, pull, pull, coupling, of_pull=True)
        pull += latent
        return pull

    def _respond(
        self, beta: float, source: FloatImage, target: FloatImage, coupling: Coupling, *, of_pull: bool
    ) -> None:
        def plan(_: int, s: int, b: int) -> None:
            inside = np.s_[s, b, : self._hybrid.frequencies]
            responses(
                self._otf[inside],
                *coupling,
                np.float32(self.nsr),
                np.float32(beta),
                np.float32(self._scale),
                of_pull,
                self._filters[inside],
            )

        self._share_tiles(plan)
        self._filter(self._filters, source, target)
