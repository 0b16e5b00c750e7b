"""Deconvolution with the brightness at full resolution and the colours at half of it.

The eye sees detail in brightness, and most cameras measure it there: a sensor has one colour per pixel, and JPEG and
video halve the colours' resolution. So the brightness is restored at full size, the picture itself at half size, and
the colours of the latter follow the former (:mod:`rsdeblur.kernels.chroma`). That is a third and a sixth to a fifth of
the work for three full planes, and no less sharp: the brightness has less noise than its parts, and its edges lead
those of the colours. (docs/developer/decisions/priors.md)
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from rsdeblur.choices import Border, Planning
from rsdeblur.deconv.priors import LEAST_PEAK, DerivativePrior, brightness
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.kernels.chroma import joined, separate
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, FloatImage

# Least size in px of the PSFs of a picture whose colours may have half the resolution: smaller ones leave colours more
# detail than that. The nearly still capture of the benchmarks, PSFs of 3 px, lost 1.0 dB.
LEAST_SIZE = 7
# Share of the solves' work that the brightness takes.
LUMA_WORK = 0.65


class HalfChroma:
    """Deconvolution of RGB pictures with a bank of paths, planned once and applied often.

    Parameters
    ----------
    bank : PsfBank
        PSFs with their paths.
    shape : (H, W, 3)
        Shape of the pictures.
    nsr, border, planning, threads
        See :class:`rsdeblur.TileQuadratic`.

    Raises
    ------
    InputError
        As :class:`rsdeblur.TileQuadratic` does.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, int, int],
        *,
        nsr: float,
        border: Border = "blend",
        planning: Planning = "estimate",
        threads: int | None = None,
    ) -> None:
        height, width, colours = shape
        planned = partial(TileQuadratic, nsr=nsr, border=border, planning=planning, threads=threads)
        self._luma = planned(bank, (height, width, 1))
        self._half = planned(halved(bank, threads=threads), (-(-height // 2), -(-width // 2), colours))
        self._threads = threads

    @staticmethod
    def suits(bank: PsfBank, shape: tuple[int, ...]) -> bool:
        """Return whether pictures of a shape are coloured, and blurred enough to lose colour detail anyway."""
        height, width, channels = shape
        tall, wide = _half_size(bank.size)
        fits = tall <= height // 2 and wide <= width // 2
        return channels == 3 and bank.displacements is not None and max(bank.size) >= LEAST_SIZE and fits

    def replan(self, bank: PsfBank) -> None:
        """Use other PSFs from now on; see :meth:`rsdeblur.Deconvolver.replan`."""
        self._luma.replan(bank)
        self._half.replan(halved(bank, threads=self._threads))

    def apply(
        self, light: FloatImage, *, prior: DerivativePrior, progress: Callable[[float], None] | None = None
    ) -> FloatImage:
        """Deblur one picture; see :meth:`rsdeblur.TileQuadratic.apply`."""

        def part(done: float, share: float) -> Callable[[float], None] | None:
            return None if progress is None else lambda fraction: progress(done + share * fraction)

        prior = prior.with_peak_of(light)
        peak = max(brightness(light) if prior.peak is None else prior.peak, LEAST_PEAK)
        luma, half = separate(light, self._threads)
        luma = self._luma.apply(luma, out=luma, prior=prior.of_luma(), progress=part(0.0, LUMA_WORK))
        half = self._half.apply(half, out=half, prior=prior, progress=part(LUMA_WORK, 1.0 - LUMA_WORK))
        return joined(luma, half, peak, self._threads)


def halved(bank: PsfBank, *, threads: int | None) -> PsfBank:
    """Return the PSFs of a picture at half its size, at half as many places in each direction.

    Paths that are half as long may differ by twice as much of their length from tile to tile.

    Parameters
    ----------
    bank : PsfBank
        PSFs with their paths.
    threads : int, optional
        Threads that draw the kernels.
    """
    assert bank.displacements is not None
    (rows, down), (cols, across) = (_merged(places) for places in (bank.rows, bank.cols))
    paths = np.einsum("bi,sj,ijtk->bstk", down, across, bank.displacements, optimize=True)
    half = BlurPaths(paths / 2, (rows - 0.5) / 2, (cols - 0.5) / 2, bank.softness / 2)
    # A bank that is padded, to plan for larger PSFs, stays so.
    return PsfBank.from_paths(half, threads=threads).padded(_half_size(bank.size))


def _half_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size of kernels of half the length, px."""
    height, width = (2 * (n // 2 // 2 + 1) + 1 for n in size)
    return height, width


def _merged(places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return half as many places along an axis, and the weights with which to interpolate values to them."""
    n = len(places)
    count = -(-n // 2)
    at = (np.arange(count) + 0.5) * n / count - 0.5
    weights = np.array([np.interp(at, np.arange(n), unit) for unit in np.eye(n)]).T
    return weights @ places, weights
