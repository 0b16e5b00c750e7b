"""The quadratic problem behind priors on derivatives, solved tile by tile in the hybrid domain.

Its normal equations are one number per frequency and tile on either side. What the observation contributes to them is
computed once and kept; a solve transforms the prior's pull, combines both, and transforms the result back.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from rsdeblur._util import validate
from rsdeblur._util.memory import empty
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import Border
from rsdeblur.deconv.hybrid import COLUMNS
from rsdeblur.deconv.priors import TO_GRADIENT, Coupling, LatentPrior, check_prior
from rsdeblur.deconv.scene import SceneSolver
from rsdeblur.deconv.wiener import LEAST_MARGIN, LEAST_NSR, StripFilter, TileFilter, decay_margin
from rsdeblur.errors import InputError
from rsdeblur.kernels.spectral import add_normal, solve_normal
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, Float32Array, FloatImage

# What pictures contribute to the normal equations of all tiles, each block of columns at its own place: the sums of
# conj(H) G, (S, blocks, B, C, COLUMNS, L), and of |H|^2, (S, blocks, B, COLUMNS, L).
NormalSums = tuple[ComplexArray, Float32Array]


class TileNormal(TileFilter, SceneSolver):
    """Base of the quadratic solvers of tiles: the normal equations of one or several frames of a scene.

    As a :class:`rsdeblur.deconv.priors.QuadraticSolver` it solves, for the frames i,

        U = ((1 + nsr) sum_i a_i conj(H_i) G_i + beta V) / (sum_i a_i |H_i|^2 + nsr + beta |D|^2)

    The `banks` of all frames have the same places and size. The share a_i of a frame is the inverse of its noise power,
    divided by the sum of these over all frames. Both sums are computed once and kept, frame by frame, so memory and the
    time of a solve do not grow with the number of frames. With `wiener`, pictures are solved without a prior, as by
    :class:`rsdeblur.Deconvolver`. Other arguments and errors are those of :class:`TileQuadratic`.
    """

    def __init__(
        self,
        banks: Sequence[PsfBank],
        shares: Sequence[float],
        shape: tuple[int, ...],
        *,
        nsr: float,
        wiener: bool = False,
        border: Border,
        threads: int | None,
    ) -> None:
        margin = decay_margin(nsr) if wiener else LEAST_MARGIN
        super().__init__(banks[0], shape, margin=margin, border=border, threads=threads)
        self.nsr, self.periodic = max(nsr, LEAST_NSR) if wiener else nsr, border == "periodic"
        self._banks, self._shares, self._wiener = banks, shares, wiener
        # OTFs of the tiles of one strip.
        self._otfs = self._new_filters(1)
        # The last frame, if its normal equations wait for the first solve; and the sums of the others.
        self._waiting: tuple[int, FloatImage] | None = None
        self._sums: NormalSums | None = None
        # |exp(i w) - 1|^2 = 4 sin^2(w / 2)
        self._across, self._down = (
            (4 * np.sin(np.pi * np.arange(count) / tiling.length) ** 2).astype(np.float32)
            for count, tiling in ((self._hybrid.blocks * COLUMNS, self._strips), (self._bands.length, self._bands))
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

        `InputError` is raised if no observation was set.
        """
        minimise = self._minimiser(beta, coupling, pulls=pull is not None)
        out = np.empty(self._channelled, dtype=np.float32) if out is None else out
        if self._waiting is not None and pull is None:
            # All priors begin without a pull. One pass instead of two, and equations that are still in the cache.
            self._add(minimise, out)
        else:
            self._add()
            self._pass(pull, out, minimise)
        return out

    def _minimiser(self, beta: float, coupling: Coupling, *, pulls: bool) -> StripFilter:
        """Return the filter that replaces the pull by the minimiser; without `pulls` it only writes."""
        if self._sums is None:
            raise InputError("the solver holds no picture: a prior may solve while apply() restores one")
        signals, powers = self._sums
        weights, pull = np.multiply(beta, coupling).astype(np.float32), np.float32(beta if pulls else 0.0)
        nsr, scale = np.float32(self.nsr), np.float32(self._scale)

        def minimise(strip: int, _thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            signal, power = signals[strip, block, bands], powers[strip, block, bands]
            solve_normal(signal, power, self._across[block], self._down, nsr, weights, pull, scale, slabs)

        return minimise

    def observe(self, frame: int, picture: FloatImage) -> None:
        """Take in a frame, see :class:`rsdeblur.deconv.scene.SceneSolver`."""
        self._waiting, self._sums = (frame, picture), self._sums or self._new_sums()
        if frame + 1 < len(self._banks):
            self._add()

    def _restored(self, prior: LatentPrior | None, progress: Callable[[float], None] | None) -> FloatImage:
        if prior is None and self._wiener:
            latent = self.solve(0.0)
        else:
            latent = check_prior(prior).restore(self, threads=self._team.threads, progress=progress)
        # The sums take more memory than all else.
        self._sums = self._waiting = None
        return latent

    def _add(self, minimise: StripFilter | None = None, out: FloatImage | None = None) -> None:
        """Add what the frame contributes that waits, if any; the first one starts the sums.

        With a function of :meth:`_minimiser`, the minimiser is written to `out` in the same pass.
        """
        if self._waiting is None or self._sums is None:
            return
        (frame, picture), self._waiting = self._waiting, None
        bank, share, (signals, powers) = self._banks[frame], np.float32(self._shares[frame]), self._sums

        def add(strip: int, otfs: ComplexArray, thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            signal, power = signals[strip, block, bands], powers[strip, block, bands]
            add_normal(slabs, otfs[block, bands], share, frame == 0, signal, power)
            if minimise is not None:
                minimise(strip, thread, block, bands, slabs)

        self._hybrid.filter(picture, out, lambda strip: partial(add, strip, self._strip_otfs(bank, strip)))

    def _strip_otfs(self, bank: PsfBank, strip: int) -> ComplexArray:
        """Return the OTFs of the tiles of a strip, shape (blocks, B, COLUMNS, L); the next call overwrites them."""
        self._fill_otfs(bank, self._otfs, first=strip)
        otfs: ComplexArray = self._otfs[0]
        return otfs

    def _new_sums(self) -> NormalSums:
        """Return memory for sums, not initialised."""
        _, blocks, bands, columns, length = self._otfs.shape
        places = len(self._strips.tiles), blocks, bands
        signal = empty((*places, self._channelled[2], columns, length), np.complex64)
        return signal, empty((*places, columns, length), np.float32)


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
        validate.instance("bank", bank, PsfBank)
        nsr = validate.finite("nsr", nsr, minimum=0.0, maximum=validate.MOST_STRENGTH)
        super().__init__([bank], [1.0], shape, nsr=nsr, border=border, threads=threads)
