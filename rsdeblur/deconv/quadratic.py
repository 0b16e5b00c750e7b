"""The quadratic problem behind priors on the gradient, solved tile by tile in the hybrid domain.

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
from rsdeblur.deconv.hybrid import COLUMNS
from rsdeblur.deconv.priors import LatentPrior, check_prior
from rsdeblur.deconv.wiener import TileFilter
from rsdeblur.errors import InputError
from rsdeblur.kernels.normal import add_normal, solve_normal
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, Float32Array, FloatImage

# Margin of a tile: by how much it is longer than the part that it contributes, in PSF sizes.
MARGIN = 1.5


class TileNormal(TileFilter):
    """Base of the quadratic solvers of tiles: the normal equations of one or several pictures of a scene.

    Parameters
    ----------
    banks : sequence of PsfBank
        PSFs of each picture, at the same places and of the same size.
    shares : sequence of float
        Weight of each picture.
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
        banks: Sequence[PsfBank],
        shares: Sequence[float],
        shape: tuple[int, ...],
        *,
        nsr: float,
        margin: float,
        border: Border,
        planning: Planning,
        threads: int | None,
    ) -> None:
        super().__init__(
            *(banks[0], shape), margin=margin, border=border, planning=planning, threads=threads, sources=len(banks) + 1
        )
        self.nsr, self.periodic = nsr, border == "periodic"
        self.shares = tuple(map(float, shares))
        self._otfs = [self._new_filters() for _ in banks]
        for bank, otfs in zip(banks, self._otfs, strict=True):
            self._fill_otfs(bank, otfs)
        # For each picture the spectra of its strips; made when there is one.
        self._observed: list[list[ComplexArray]] = []
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        self._across, self._down = (
            (4 * np.sin(np.pi * np.arange(count) / length) ** 2).astype(np.float32)
            for count, length in (
                (self._hybrid.padded_frequencies, self._strips.length),
                (self._bands.length, self._bands.length),
            )
        )
        # Each thread's sums for a few bands of a block of columns.
        bands, block = self._hybrid.together, (COLUMNS, self._bands.length)
        self._sums = [
            (np.empty((bands, self._channelled[2], *block), np.complex64), np.empty((bands, *block), np.float32))
            for _ in range(self.threads)
        ]

    def prepare(self, *images: ArrayLike) -> None:
        """Set the observations, one for each bank.

        Parameters
        ----------
        *images : array_like of the planned shape
            Linear light, floats.

        Raises
        ------
        InputError
            If one has another shape, holds integers or is not finite.
        """
        if not self._observed:
            self._observed = [[self._hybrid.new_spectra() for _ in self._strips.tiles] for _ in self.shares]
        for image, spectra in zip(images, self._observed, strict=True):
            picture = validate.linear_light(image, self.shape).reshape(self._channelled)
            for strip, part in zip(self._strips.tiles, spectra, strict=True):
                if not self._hybrid.transform_rows(picture, strip, part):
                    raise InputError("image must be finite")

    def solve(self, beta: float, grad_adjoint: FloatImage | None = None) -> FloatImage:
        """Return the minimiser for the observations.

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
            If `grad_adjoint` is not finite, or no observation was set.
        """
        return self._solve(beta, grad_adjoint, self._across, self._down)

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
            If `target` is not finite, or no observation was set.
        """
        return self._solve(beta, target, np.full_like(self._across, 0.5), np.full_like(self._down, 0.5))

    def _solve(self, beta: float, pull: FloatImage | None, across: Float32Array, down: Float32Array) -> FloatImage:
        """Return the minimiser with a term of weight `beta`, whose right-hand side is `beta pull`.

        The term's matrix is the sum of `across` and `down`: |D|^2, or 1.
        """
        if not self._observed:
            raise InputError("the solver holds no picture: call apply(), or prepare() before solve()")
        pictures, weight = len(self._otfs), np.float32(0.0 if pull is None else beta)
        last = pictures - (pull is None)
        nsr, term, scale = np.float32(self.nsr), np.float32(beta), np.float32(self._scale)

        def restore(strip: int, thread: int, source: int, bands: slice, columns: slice, slabs: ComplexArray) -> None:
            signal, power = (sums[: len(slabs)] for sums in self._sums[thread])
            if source < pictures:
                otfs, share = self._otfs[source][strip, bands, columns], np.float32(self.shares[source])
                add_normal(slabs, otfs, share, source == 0, signal, power)
            if source == last:
                solve_normal(signal, power, across[columns], down, nsr, term, weight, scale, slabs)

        latent = np.empty(self._channelled, dtype=np.float32) if pull is None else pull
        self._pass(pull, latent, restore, kept=self._observed)
        return latent


@one_line("shape", "nsr", "_kernel_size")
class TileQuadratic(TileNormal):
    """Deconvolution with a bank of PSFs and a prior on the gradient, planned once and applied often.

    As a :class:`rsdeblur.deconv.priors.QuadraticSolver` it solves

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
        validate.instance("bank", bank, PsfBank)
        nsr = validate.finite("nsr", nsr, minimum=0.0, maximum=validate.MOST_STRENGTH)
        super().__init__(
            *([bank], [1.0], shape), nsr=nsr, margin=MARGIN, border=border, planning=planning, threads=threads
        )

    def _take(self, bank: PsfBank) -> None:
        self._fill_otfs(bank, self._otfs[0])

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
        light = validate.linear_light(image, self.shape)
        with self.lock:
            self.prepare(light)
            latent = prior.with_peak_of(light).restore(self, threads=self.threads, progress=progress)
        latent = latent.reshape(self.shape)
        if out is None:
            return latent
        out[...] = latent
        return out
