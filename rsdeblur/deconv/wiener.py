"""Filters of tiles in the hybrid domain: the Wiener filter, and the blur itself.

Global mode is one band and one strip; it has no code of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsdeblur._util import validate
from rsdeblur._util.memory import empty
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import BORDERS, Border
from rsdeblur.deconv import otf
from rsdeblur.deconv.hybrid import COLUMNS, Hybrid
from rsdeblur.deconv.otf import OtfPlanner
from rsdeblur.deconv.tiling import BAND_EXCESS, Tiling
from rsdeblur.errors import InputError
from rsdeblur.kernels import spectral
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, FloatImage

# Margins of tiles, in PSF sizes: by how much a tile is longer than the part that it contributes. Priors on derivatives
# need the least one. The inverse filter of a straight PSF of K px at NSR Phi rings with a decay length of
# K / (2 pi sqrt(Phi)), so a margin of 0.2 K / sqrt(Phi) is some 1.3 decay lengths (docs/developer/decisions.md).
DECAY_MARGIN = 0.2
LEAST_MARGIN = 1.5
# Least `nsr`. OTFs of up to 1 have rounding errors of some 1e-7, so that a filter with a gain beyond 1 / (2 sqrt(nsr)),
# 500, would mostly amplify these.
LEAST_NSR = 1e-6


def decay_margin(nsr: float) -> float:
    """Return the margin of a tile, in PSF sizes, that the inverse filter needs at a noise-to-signal ratio."""
    return max(LEAST_MARGIN, DECAY_MARGIN / math.sqrt(max(nsr, LEAST_NSR)))


# Called as ``change(strip, ...)`` with the arguments of :class:`rsdeblur.deconv.hybrid.Filter` after the strip.
StripFilter = Callable[[int, int, int, slice, ComplexArray], None]


class TileFilter:
    """Base of all solvers of tiles: applies one filter per tile to pictures of one shape.

    `margin` is by how much a tile is longer than the part that it contributes, in PSF sizes. Other arguments and errors
    are those of :class:`Deconvolver`.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        margin: float,
        border: Border,
        threads: int | None,
    ) -> None:
        validate.instance("bank", bank, PsfBank)
        self.shape = validate.shape(shape)
        validate.choice("border", border, BORDERS)
        height, width = self.shape[:2]
        if bank.size[0] > height or bank.size[1] > width:
            raise InputError(
                f"the PSF of {bank.size[1]}x{bank.size[0]} px is larger than the picture of {width}x{height} px; "
                "are the rates in rad/s, the focal length in px and the exposure in s?"
            )
        tall, wide = (int(np.ceil(margin * kernel)) for kernel in bank.size)
        periodic = border == "periodic"
        self._bands = Tiling.plan(bank.rows, height, bank.size[0], tall, periodic=periodic, excess=BAND_EXCESS)
        self._strips = Tiling.plan(bank.cols, width, bank.size[1], wide, periodic=periodic)
        threads = thread_count(threads)
        self._hybrid = Hybrid(
            self._channelled,
            self._bands,
            self._strips,
            border=border,
            threads=threads,
        )
        self._team = self._hybrid.team
        tiles = bank.kernels[..., 0, 0].size
        validate.memory(
            f"the filters of {tiles} tiles of {self._strips.length}x{self._bands.length} px",
            self._bytes_per_frequency * tiles * self._hybrid.blocks * COLUMNS * self._bands.length,
            height * width,
        )
        self._planners = [OtfPlanner(bank.size, (self._bands.length, self._strips.length)) for _ in range(threads)]
        self._kernel_size = bank.size
        # The inverse transforms are not scaled, so every filter contains this factor.
        self._scale = 1.0 / (self._bands.length * self._strips.length)

    @property
    def _bytes_per_frequency(self) -> int:
        """Bytes that are kept for each frequency of a tile: its filter."""
        return 8

    @property
    def _channelled(self) -> tuple[int, int, int]:
        """The planned shape as (H, W, C)."""
        height, width, *channels = self.shape
        return height, width, channels[0] if channels else 1

    def _apply(
        self,
        filters: ComplexArray,
        image: ArrayLike,
        out: NDArray[np.float32] | None,
        progress: Callable[[float], None] | None,
    ) -> NDArray[np.float32]:
        """Filter a picture as :meth:`Deconvolver.apply` does, with filters as of :meth:`_new_filters`."""
        validate.callback("progress", progress)
        picture = validate.linear_light(image, self.shape)
        out = validate.output(out, self.shape)

        def multiply(strip: int, _thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            spectral.multiply(slabs, filters[strip, block, bands])

        source, target = picture.reshape(self._channelled), out.reshape(self._channelled)
        with self._team.turn():
            self._pass(source, target, multiply, progress=progress)
        return out

    def _pass(
        self,
        source: FloatImage | None,
        target: FloatImage,
        change: StripFilter,
        *,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Filter `source` into `target`, strip by strip; None is a picture of zeros, and `target` may be `source`."""
        with self._team.lock:
            if len(self._strips.tiles) > 1 and source is not None and np.shares_memory(source, target):
                source = source.copy()
            self._hybrid.filter(source, target, lambda strip: partial(change, strip), progress=progress)

    def _new_filters(self, strips: int | None = None) -> ComplexArray:
        """Return memory for one filter per tile, shape (S, blocks of columns, B, COLUMNS, L): in the order of a pass.

        They are for all strips, or for a number of them. Columns that fill up the last block are zero.
        """
        strips, bands = strips or len(self._strips.tiles), len(self._bands.tiles)
        filters = empty((strips, self._hybrid.blocks, bands, COLUMNS, self._bands.length), np.complex64)
        filters[:, -1] = 0
        return filters

    def _fill_otfs(
        self,
        bank: PsfBank,
        out: ComplexArray,
        change: Callable[[ComplexArray], None] = lambda _: None,
        *,
        first: int = 0,
    ) -> None:
        """Fill `out` with the OTFs of the tiles of the strips from `first` on; `change` may change their columns."""
        parts, gains = range(0, self._hybrid.frequencies, otf.COLUMNS), self._planners[0].gains(bank)

        def fill(thread: int, s: int, b: int, spectrum: ComplexArray, part: int) -> None:
            otfs = self._planners[thread].columns(spectrum, gains, part)
            change(otfs)
            blocks = out[s, part // COLUMNS : (part + otf.COLUMNS) // COLUMNS, b]
            blocks[...] = otfs.reshape(-1, COLUMNS, otfs.shape[1])[: len(blocks)]

        def plan(thread: int, tile: int) -> None:
            s, b = divmod(tile, out.shape[2])
            spectrum = self._planners[thread].rows(bank, gains, b, first + s)
            for part in parts:
                fill(thread, s, b, spectrum, part)

        tiles = out.shape[0] * out.shape[2]
        if tiles > 1:
            self._team.share(plan, range(tiles))
            return
        spectrum = self._planners[0].rows(bank, gains, 0, first)
        self._team.share(lambda thread, part: fill(thread, 0, 0, spectrum, part), parts)


@one_line("shape", "nsr", "_kernel_size")
class Deconvolver(TileFilter):
    """Wiener deconvolution with a bank of PSFs, planned once and applied often.

    Each tile is filtered with

        U = (1 + nsr) conj(H) / (|H|^2 + nsr) G

    which is eq. 7 of Sindelar and Sroubek (2013) times (1 + nsr). With this factor a constant picture keeps its
    brightness, and no motion is the identity, at any `nsr`.

    Parameters
    ----------
    bank : PsfBank
        B x S kernels; 1 x 1 is the global mode.
    shape : (H, W) or (H, W, C)
        Shape of the pictures.
    nsr : float, default 0.01
        Noise-to-signal power ratio Phi, from 1e-20 to 1e20; less than 1e-6, the limit of float32, counts as 1e-6.
    border : {"blend", "periodic"}
        "blend" continues the picture and fades opposite borders into each other over the PSF's size; "periodic" assumes
        that the picture repeats.
    threads : int, optional
        Threads that share the work; default all processors. Any number gives the same bits.

    Raises
    ------
    InputError
        If a kernel is larger than the picture, two kernels are less than a pixel apart, one lies outside the picture,
        or an argument is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> bank = rsdeblur.PsfBank.for_picture(np.full((1, 5), 0.2), (64, 64))
    >>> solver = rsdeblur.Deconvolver(bank, (64, 64), nsr=0.02)
    >>> solver
    Deconvolver(shape=(64, 64), nsr=0.02, kernel_size=(1, 5))
    >>> solver.apply(np.full((64, 64), 0.5))[0, :2].round(3)
    array([0.5, 0.5], dtype=float32)
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        nsr: float = 0.01,
        border: Border = "blend",
        threads: int | None = None,
    ) -> None:
        self.nsr = max(validate.strength("nsr", nsr), LEAST_NSR)
        margin = decay_margin(self.nsr)
        super().__init__(bank, shape, margin=margin, border=border, threads=threads)
        self._filters = self._new_filters()
        ratio, scale = np.float32(self.nsr), np.float32((1.0 + self.nsr) * self._scale)

        def invert(otfs: ComplexArray) -> None:
            gains = scale / (np.square(otfs.real) + np.square(otfs.imag) + ratio)
            otfs.real *= gains
            otfs.imag *= -gains

        self._fill_otfs(bank, self._filters, invert)

    def apply(
        self,
        image: ArrayLike,
        out: NDArray[np.float32] | None = None,
        *,
        progress: Callable[[float], None] | None = None,
    ) -> NDArray[np.float32]:
        """Deblur one picture.

        Parameters
        ----------
        image : array_like of the planned shape
            Linear light, floats; converted to float32.
        out : ndarray, float32, optional
            Receives the result; may be `image` itself.
        progress : callable, optional
            Called with the finished fraction after each strip.

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
        return self._apply(self._filters, image, out, progress)


class TileBlur(TileFilter):
    """The blur of a bank of PSFs, interpolated between tiles, and its adjoint.

    The adjoint blends tiles by where light arrives, not by where it comes from. It is exact for one tile; for several
    it is as accurate as the PSF is constant over its own size. Arguments are those of :class:`Deconvolver`.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        border: Border = "blend",
        threads: int | None = None,
    ) -> None:
        super().__init__(bank, shape, margin=LEAST_MARGIN, border=border, threads=threads)
        self._filters = self._new_filters()
        self._fill_otfs(bank, self._filters)
        self._filters *= np.float32(self._scale)
        # Computed for the first adjoint: many blurs are never sent back.
        self._conjugates: ComplexArray | None = None

    def forward(self, latent: ArrayLike) -> NDArray[np.float32]:
        """Return a picture of the planned shape blurred."""
        return self._apply(self._filters, latent, None, None)

    def adjoint(self, picture: ArrayLike) -> NDArray[np.float32]:
        """Return a picture of the planned shape with its light sent back along the paths."""
        with self._team.lock:
            if self._conjugates is None:
                self._conjugates = self._filters.conj()
            return self._apply(self._conjugates, picture, None, None)
