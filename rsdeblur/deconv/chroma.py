"""Deconvolution with the brightness at full resolution and the colours at half of it.

The eye sees detail in brightness, and most cameras measure it there: a sensor has one colour per pixel, and JPEG and
video halve the colours' resolution. So the brightness is restored at full size, the picture itself at half size, and
the colours follow the brightness (:mod:`rsdeblur.kernels.chroma`). With a prior on derivatives this takes about three
quarters of the time of three full planes, and the result is as sharp (docs/developer/decisions.md).
"""

import math
from collections.abc import Callable

import numpy as np

from rsdeblur.choices import Prior
from rsdeblur.deconv.priors import KINDS, LEAST_PEAK
from rsdeblur.kernels.chroma import join, separate
from rsdeblur.motion.paths import BlurPaths
from rsdeblur.psf import PsfBank
from rsdeblur.types import Denoiser, FloatArray, FloatImage, StageProgress

# Least size in px of the PSFs of a picture whose colours may have half the resolution: smaller ones leave colours more
# detail than that. The nearly still capture of the benchmarks, PSFs of 3 px, lost 1.0 dB.
LEAST_SIZE = 7
# Strength for the brightness, as a share of what a grey picture needs. White noise alone would need less, noise after
# JPEG, which is the same in all channels, 1. (docs/developer/decisions.md)
LUMA_STRENGTH = 0.84
# Share of the solves' work that the brightness takes.
LUMA_WORK = 0.65

# Restores one picture (H, W, C), which it may overwrite, and reports the finished fraction.
Solve = Callable[[FloatImage, StageProgress], FloatImage]


def half_chroma(luma: Solve, half: Solve, *, peak: float, threads: int | None = None) -> Solve:
    """Return the solver of RGB pictures that consists of one of the brightness, and one of the picture at half size.

    `luma` takes the shape (H, W, 1) and has the PSFs of the picture; `half` takes that of :func:`half_shape` and has
    those of :func:`halved`. `peak` is the :func:`rsdeblur.deconv.priors.brightness` of the pictures.
    """

    def solve(light: FloatImage, progress: StageProgress) -> FloatImage:
        bright, small = separate(light, threads)
        bright = luma(bright, lambda fraction: progress(LUMA_WORK * fraction))
        small = half(small, lambda fraction: progress(LUMA_WORK + (1.0 - LUMA_WORK) * fraction))
        # New memory of that size would take the system as long as the work itself.
        join(bright, small, max(peak, LEAST_PEAK), light, threads)
        return light

    return solve


def luma_share(prior: Prior | Denoiser, exponent: float) -> float:
    """Return the share of a picture's strength with which its brightness is restored as the picture would be.

    The strength is the noise-to-signal ratio of the Wiener filter, or the weight of a prior on derivatives. A grey
    picture of three channels has three times the data term of its brightness, and derivatives `sqrt(3)` times as long.
    And the brightness has less noise than the channels.
    """
    power = KINDS[prior].power(exponent) if isinstance(prior, str) and prior in KINDS else 2.0
    return LUMA_STRENGTH * math.pow(3.0, power / 2.0 - 1.0)


def suits_half(size: tuple[int, int], shape: tuple[int, int, int]) -> bool:
    """Return whether pictures (H, W, C) have colours, and kernels (px) that take more detail than half the size."""
    rows, cols, channels = half_shape(shape)
    tall, wide = _half_size(size)
    return channels == 3 and max(size) >= LEAST_SIZE and tall <= rows and wide <= cols


def half_shape(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the shape of a picture (H, W, C) at half size."""
    height, width, channels = shape
    return -(-height // 2), -(-width // 2), channels


def halved(bank: PsfBank, *, threads: int | None) -> PsfBank:
    """Return the PSFs of a picture at half its size, at half as many places in each direction.

    Paths that are half as long may differ by twice as much of their length from tile to tile.
    """
    assert bank.displacements is not None
    (rows, down), (cols, across) = (_merged(places) for places in (bank.rows, bank.cols))
    # Not optimized, which would call BLAS: its threads wait busily for more work, for 0.1 s of processor time.
    paths = np.einsum("sj,bjtk->bstk", across, np.einsum("bi,ijtk->bjtk", down, bank.displacements))
    half = BlurPaths(paths / 2, (rows - 0.5) / 2, (cols - 0.5) / 2, bank.softness / 2)
    # A bank that is padded, to plan for larger PSFs, stays so.
    return PsfBank.from_paths(half, threads=threads).padded(_half_size(bank.size))


def halved_rows(paths: BlurPaths) -> BlurPaths:
    """Return the paths of every row of a picture at half its size, in half as many strips."""
    cols, across = _merged(paths.cols)
    first, second = paths.displacements[::2], paths.displacements[1::2]
    if len(second) < len(first):
        second = np.concatenate([second, first[-1:]])
    pairs = np.einsum("sj,bjtk->bstk", across, first + second)
    return BlurPaths(pairs / 4, np.arange(float(len(pairs))), (cols - 0.5) / 2, paths.softness / 2)


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
