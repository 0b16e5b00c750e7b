"""The quadratic problem behind priors on derivatives, solved tile by tile in the hybrid domain.

Its normal equations are one number per frequency and tile on either side. What the observation contributes to them is
computed once and kept; a solve transforms the prior's pull, combines both, and transforms the result back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.memory import empty
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Border
from rsdeblur.deconv.hybrid import COLUMNS
from rsdeblur.deconv.priors import TO_GRADIENT, Coupling, LatentPrior, check_prior
from rsdeblur.deconv.wiener import LEAST_MARGIN, TileFilter
from rsdeblur.errors import InputError
from rsdeblur.kernels.spectral import add_normal, solve_normal
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, Float32Array, FloatImage


class NormalSums(NamedTuple):
    """What pictures contribute to the normal equations of all tiles; each block of columns has a place of its own."""

    signal: ComplexArray  # sum of conj(H) G, (S, blocks, B, C, COLUMNS, L)
    power: Float32Array  # sum of |H|^2, (S, blocks, B, COLUMNS, L)


# Function of a block of columns, its parts of the sums, and slabs that it changes.
Minimise = Callable[[int, ComplexArray, Float32Array, ComplexArray], None]


class TileNormal(TileFilter):
    """Base of the quadratic solvers of tiles: normal equations per tile, of one or several pictures of a scene.

    The pictures have PSFs at the places of `bank` and of at most its size. Other arguments and errors are those of
    :class:`TileQuadratic` and :class:`rsdeblur.deconv.wiener.TileFilter`.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        nsr: float,
        margin: float,
        border: Border,
        threads: int | None,
    ) -> None:
        super().__init__(bank, shape, margin=margin, border=border, threads=threads)
        self.nsr, self.periodic = nsr, border == "periodic"
        # OTFs of the tiles of one strip.
        self._otfs = self._new_filters(1)
        # The observation, if its normal equations wait for the first solve.
        self._observed: tuple[PsfBank, FloatImage] | None = None
        # Sums of the observation, while there is one.
        self._sums: NormalSums | None = None
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        self._across, self._down = (
            (4 * np.sin(np.pi * np.arange(count) / length) ** 2).astype(np.float32)
            for count, length in (
                (self._hybrid.blocks * COLUMNS, self._strips.length),
                (self._bands.length, self._bands.length),
            )
        )
        self._across = self._across.reshape(-1, COLUMNS)

    @property
    def _bytes_per_frequency(self) -> int:
        """Bytes that are kept for each frequency of a tile: both sums of the normal equations."""
        return 8 * self._channelled[2] + 4

    def solve(
        self,
        beta: float,
        pull: FloatImage | None = None,
        coupling: Coupling = TO_GRADIENT,
        *,
        out: FloatImage | None = None,
    ) -> FloatImage:
        """Return the minimiser for the observations; see :meth:`rsdeblur.deconv.priors.QuadraticSolver.solve`.

        `InputError` is raised if `pull` is not finite, or no observation was set.
        """
        minimise = self._minimiser(beta, coupling, pulls=pull is not None)
        out = np.empty(self._channelled, dtype=np.float32) if out is None else out
        if self._observed is not None:
            # All priors begin without a pull. One pass instead of two, and equations that are still in the cache.
            observed, sums, self._observed, self._sums = self._observed, self._sums or self._new_sums(), None, None
            self._add(sums, *observed, minimise=minimise, out=out)
            self._sums = sums
            return out
        if self._sums is None:
            raise InputError("the solver holds no picture: apply() sets it, or prepare() before solve()")
        signal, power = self._sums

        def restore(strip: int, _thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            place = strip, block, bands
            minimise(block, signal[place], power[place], slabs)

        self._pass(pull, out, restore)
        return out

    def _minimiser(self, beta: float, coupling: Coupling, *, pulls: bool) -> Minimise:
        """Return a function that replaces the pull by the minimiser, in slabs of a block of columns.

        It is called as ``minimise(block, signal, power, slabs)``. What slabs hold counts only if something `pulls`.
        """
        weights, pull = np.array(coupling.weights(beta), np.float32), np.float32(beta if pulls else 0.0)
        nsr, scale = np.float32(self.nsr), np.float32(self._scale)

        def minimise(block: int, signal: ComplexArray, power: Float32Array, slabs: ComplexArray) -> None:
            solve_normal(signal, power, self._across[block], self._down, nsr, weights, pull, scale, slabs)

        return minimise

    def _add(
        self,
        sums: NormalSums,
        bank: PsfBank,
        picture: FloatImage,
        share: float = 1.0,
        *,
        first: bool = True,
        minimise: Minimise | None = None,
        out: FloatImage | None = None,
    ) -> None:
        """Add what a picture (H, W, C) with the PSFs of `bank` contributes; the `first` one starts the sums.

        With a function of :meth:`_minimiser`, the minimiser is written to `out` in the same pass.
        """
        factor = np.float32(share)

        def add(strip: int, otfs: ComplexArray, _thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            signal, power = sums.signal[strip, block, bands], sums.power[strip, block, bands]
            add_normal(slabs, otfs[block, bands], factor, first, signal, power)
            if minimise is not None:
                minimise(block, signal, power, slabs)

        with self.lock:
            if not self._hybrid.filter(picture, out, lambda strip: partial(add, strip, self._strip_otfs(bank, strip))):
                raise InputError("image must be finite")

    def _strip_otfs(self, bank: PsfBank, strip: int) -> ComplexArray:
        """Return the OTFs of the tiles of a strip, shape (blocks, B, COLUMNS, L); the next call overwrites them."""
        self._fill_otfs(bank, self._otfs, first=strip)
        otfs: ComplexArray = self._otfs[0]
        return otfs

    def _new_sums(self) -> NormalSums:
        """Return memory for sums, not initialised."""
        _, blocks, bands, columns, length = self._otfs.shape
        places = len(self._strips.tiles), blocks, bands
        return NormalSums(
            empty((*places, self._channelled[2], columns, length), np.complex64),
            empty((*places, columns, length), np.float32),
        )


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
    border, threads
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
    >>> solver = rsdeblur.deconv.TileQuadratic(bank, (64, 64))
    >>> solver.apply(np.full((64, 64), 0.5), prior=rsdeblur.deconv.DerivativePrior("tv", 0.01)).shape
    (64, 64)
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        nsr: float = 0.001,
        border: Border = "blend",
        threads: int | None = None,
    ) -> None:
        nsr = validate.finite("nsr", nsr, minimum=0.0, maximum=validate.MOST_STRENGTH)
        super().__init__(bank, shape, nsr=nsr, margin=LEAST_MARGIN, border=border, threads=threads)
        self._bank = bank

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
        prior : DerivativePrior or PlugAndPlayPrior
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
            self._observed = self._bank, light.reshape(self._channelled)
            latent = prior.with_peak_of(light).restore(self, threads=self.threads, progress=progress)
            # The sums take more memory than all else.
            self._sums = self._observed = None
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
        picture = validate.linear_light(image, self.shape).reshape(self._channelled)
        with self.lock:
            # The solver does not hold the sums while they change.
            sums, self._sums, self._observed = self._sums or self._new_sums(), None, None
            self._add(sums, self._bank, picture)
            self._sums = sums
