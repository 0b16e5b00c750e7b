"""The quadratic problem behind priors on derivatives, solved tile by tile in the hybrid domain.

The rows of a picture are transformed once. A solve transforms the rows of the prior's pull, and combines both pictures
while their columns are in the cache.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Border, Planning
from rsdeblur.deconv.coupling import TO_GRADIENT, Coupling
from rsdeblur.deconv.hybrid import COLUMNS
from rsdeblur.deconv.priors import LatentPrior, check_prior
from rsdeblur.deconv.wiener import TileFilter
from rsdeblur.errors import InputError
from rsdeblur.kernels import spectral
from rsdeblur.kernels.normal import add_normal, solve_normal
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, FloatImage

# Margin of a tile: by how much it is longer than the part that it contributes, in PSF sizes.
MARGIN = 1.5


class TileNormal(TileFilter):
    """Base of the quadratic solvers of tiles: normal equations per tile, of one or several pictures of a scene.

    Parameters
    ----------
    bank : PsfBank
        PSFs of a picture; those of all pictures have these places, and at most this size.
    shape : (H, W) or (H, W, C)
        Shape of the pictures.
    nsr : float
        See :class:`TileQuadratic`.
    margin : float
        See :class:`rsdeblur.deconv.wiener.TileFilter`.
    border, planning, threads
        See :class:`rsdeblur.Deconvolver`.

    Raises
    ------
    InputError
        As :class:`rsdeblur.Deconvolver` does.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        nsr: float,
        margin: float,
        border: Border,
        planning: Planning,
        threads: int | None,
    ) -> None:
        super().__init__(bank, shape, margin=margin, border=border, planning=planning, threads=threads)
        self.nsr, self.periodic = nsr, border == "periodic"
        self._otfs = self._new_filters()
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        self._across, self._down = (
            (4 * np.sin(np.pi * np.arange(count) / length) ** 2).astype(np.float32)
            for count, length in (
                (self._hybrid.blocks * COLUMNS, self._strips.length),
                (self._bands.length, self._bands.length),
            )
        )
        self._across = self._across.reshape(-1, COLUMNS)
        # Each thread's matrices of a few bands of a block of columns.
        self._powers = [
            np.empty((self._hybrid.together, COLUMNS, self._bands.length), np.float32) for _ in range(self.threads)
        ]

    def solve(
        self,
        beta: float,
        pull: FloatImage | None = None,
        coupling: Coupling = TO_GRADIENT,
        *,
        out: FloatImage | None = None,
    ) -> FloatImage:
        """Return the minimiser for the observations.

        Parameters
        ----------
        beta : float
            Strength of the prior's quadratic term, at least 0.
        pull : ndarray, shape (H, W, C), float32, optional
            Right-hand side of the term; None is zero.
        coupling : Coupling
            See :meth:`rsdeblur.deconv.priors.QuadraticSolver.solve`.
        out : ndarray, shape (H, W, C), float32, optional
            Receives the result; may be `pull` itself.

        Returns
        -------
        ndarray, shape (H, W, C), float32

        Raises
        ------
        InputError
            If `pull` is not finite, or no observation was set.
        """
        out = np.empty(self._channelled, dtype=np.float32) if out is None else out
        self._solve(beta, pull, coupling, out)
        return out

    def _solve(self, beta: float, pull: FloatImage | None, coupling: Coupling, out: FloatImage) -> None:
        """Write the minimiser to `out`, which may be `pull`."""
        raise NotImplementedError


@one_line("shape", "nsr", "_kernel_size")
class TileQuadratic(TileNormal):
    """Deconvolution with a bank of PSFs and a prior on derivatives, planned once and applied often.

    As a :class:`rsdeblur.deconv.priors.QuadraticSolver` it solves, for a prior on the gradient,

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
    >>> solver.apply(np.full((64, 64), 0.5), prior=rsdeblur.DerivativePrior("tv", 0.01)).shape
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
        nsr = validate.finite("nsr", nsr, minimum=0.0, maximum=validate.MOST_STRENGTH)
        super().__init__(*(bank, shape), nsr=nsr, margin=MARGIN, border=border, planning=planning, threads=threads)
        self._take(bank)
        # The columns of each strip of the observation; made when there is a picture.
        self._observed: list[ComplexArray] = []
        # Each thread's right-hand sides of a few bands of a block of columns.
        block = self._hybrid.together, self._channelled[2], COLUMNS, self._bands.length
        self._signals = [np.empty(block, np.complex64) for _ in range(self.threads)]

    def _take(self, bank: PsfBank) -> None:
        self._fill_otfs(bank, self._otfs)

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
        prior : DerivativePrior, WaveletPrior or PlugAndPlayPrior
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
        light = validate.linear_light(image, self.shape)
        with self._hybrid.team.turn():
            self.prepare(light)
            latent = prior.with_peak_of(light).restore(self, threads=self.threads, progress=progress)
        latent = latent.reshape(self.shape)
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

        Raises
        ------
        InputError
            If it has another shape, holds integers or is not finite.
        """
        if not self._observed:
            self._observed = [self._hybrid.new_columns() for _ in self._strips.tiles]
        picture = validate.linear_light(image, self.shape).reshape(self._channelled)
        with self.lock:
            for strip, columns in zip(self._strips.tiles, self._observed, strict=True):
                if not self._hybrid.transform_rows(picture, strip, self._hybrid.spectra):
                    raise InputError("image must be finite")
                self._hybrid.keep_columns(self._hybrid.spectra, columns)

    def _solve(self, beta: float, pull: FloatImage | None, coupling: Coupling, out: FloatImage) -> None:
        if not self._observed:
            raise InputError("the solver holds no picture: call apply(), or prepare() before solve()")
        self._minimise(self._observed, pull, out, beta, coupling)

    def _minimise(
        self,
        observed: Sequence[ComplexArray],
        picture: FloatImage | None,
        out: FloatImage,
        beta: float,
        coupling: Coupling,
        *,
        blurred: bool = False,
    ) -> None:
        """Write the minimiser, or its blur, to `out`, which may be `picture`.

        `observed` holds the columns of the observation's strips, and `picture` is the pull; without columns, `picture`
        is the observation, and nothing pulls.
        """
        last = 1 if observed and picture is not None else 0
        weights, pull = coupling.weights(beta), np.float32(beta if last else 0.0)
        nsr, scale = np.float32(self.nsr), np.float32(self._scale)

        def restore(strip: int, thread: int, source: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            signal, power = self._signals[thread][: len(slabs)], self._powers[thread][: len(slabs)]
            otfs = self._otfs[strip, block, bands]
            if source == 0:
                add_normal(slabs, otfs, np.float32(1.0), True, signal, power)
            if source == last:
                solve_normal(signal, power, self._across[block], self._down, nsr, weights, pull, scale, slabs)
            if source == last and blurred:
                spectral.multiply(slabs, otfs)

        self._pass(picture, out, restore, kept=observed)
