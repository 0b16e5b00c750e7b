"""Deconvolution that leaves open what the camera would have recorded beyond the frame.

A picture is made periodic first: rows and columns after the last ones lead from its end to its start without a seam,
and are cut off after the solve. Their values are guesses, which other solutions explain like the recorded ones. Here
only the recorded pixels count: the data term is ``|M (A u - g)|^2`` with the mask M of the frame [1]_ [2]_. It is least
where the other pixels z have the values of the blurred solution, so in a solve with the pull v of a prior they satisfy

    z = N A B (A^T (M g + z) + beta v)

where N = I - M, and B is the inverse of the normal equations of the picture without a frame, a factor per frequency.
That is a linear equation with the symmetric matrix ``I - N A B A^T N``. A few conjugate gradients improve z in each
solve, starting from the values of the solve before.

.. [1] S. Reeves, "Fast image restoration without boundary artifacts", IEEE Trans. Image Processing 14, 2005.
.. [2] M. Almeida and M. Figueiredo, "Deconvolving images with unknown boundaries using the alternating direction method
   of multipliers", IEEE Trans. Image Processing 22, 2013.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from rsdeblur._util.one_line import one_line
from rsdeblur.deconv.fft import fast_length
from rsdeblur.deconv.hybrid import COLUMNS
from rsdeblur.deconv.priors import TO_GRADIENT, Coupling
from rsdeblur.deconv.quadratic import NormalSums, TileQuadratic
from rsdeblur.deconv.tiling import WHOLE_EXCESS
from rsdeblur.kernels import spectral
from rsdeblur.kernels.spectral import add_normal
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, FloatImage

# Conjugate gradients of a solve. docs/developer/decisions.md has what fewer and more give.
STEPS = 2


@one_line("shape", "recorded", "nsr", "_kernel_size")
class UnknownBorderQuadratic(TileQuadratic):
    """A solver of pictures that repeat, of which the last rows and columns were not recorded.

    `recorded` are the numbers of rows and columns that were. A picture to be solved holds first guesses in the others
    (:func:`extended`). Other arguments are those of :class:`TileQuadratic`.
    """

    def __init__(
        self,
        bank: PsfBank,
        shape: tuple[int, ...],
        *,
        recorded: tuple[int, int],
        nsr: float = 0.001,
        threads: int | None = None,
    ) -> None:
        super().__init__(bank, shape, nsr=nsr, border="periodic", threads=threads)
        self.recorded = recorded
        # Conjugate gradients blur: they need the OTFs of all tiles.
        self._every_otf = self._new_filters()
        self._fill_otfs(bank, self._every_otf)
        # Each thread's normal equations of a few bands of a block of columns.
        block = self._hybrid.together, COLUMNS, self._bands.length
        slabs = block[0], self._channelled[2], *block[1:]
        self._parts = [
            NormalSums(np.empty(slabs, np.complex64), np.empty(block, np.float32)) for _ in range(self.threads)
        ]
        # The picture with the present values beyond its frame, a direction there that is zero elsewhere, and a blur.
        self._filled, self._direction, self._blurred = (np.zeros(self._channelled, np.float32) for _ in range(3))

    @property
    def _bytes_per_frequency(self) -> int:
        """Bytes that are kept for each frequency of a tile: the sums and the OTF."""
        return super()._bytes_per_frequency + 8

    def prepare(self, image: ArrayLike) -> None:
        """Set the observation; see :meth:`TileQuadratic.prepare`."""
        super().prepare(image)
        self._filled[...] = np.reshape(image, self._channelled)

    def _strip_otfs(self, bank: PsfBank, strip: int) -> ComplexArray:
        otfs: ComplexArray = self._every_otf[strip]
        return otfs

    def solve(
        self,
        beta: float,
        pull: FloatImage | None = None,
        coupling: Coupling = TO_GRADIENT,
        *,
        out: FloatImage | None = None,
    ) -> FloatImage:
        """Return the minimiser after the values beyond the frame were improved; see :meth:`TileQuadratic.solve`."""
        if self._observed is not None:
            self.prepare(self._observed[1].reshape(self.shape))
        if self._sums is not None:
            self._fill(self._sums, pull, beta, coupling)
            super().prepare(self._filled.reshape(self.shape))
        return super().solve(beta, pull, coupling, out=out)

    def _fill(self, sums: NormalSums, pull: FloatImage | None, beta: float, coupling: Coupling) -> None:
        """Improve the values beyond the frame by conjugate gradients."""
        filled, direction, blurred = map(self._beyond, (self._filled, self._direction, self._blurred))
        self._blur_minimiser(pull, beta, coupling, sums)
        error = [new - old for new, old in zip(blurred, filled, strict=True)]
        for part, start in zip(direction, error, strict=True):
            part[...] = start
        power = _dot(error, error)
        for _ in range(STEPS):
            self._blur_minimiser(self._direction, beta, coupling)
            curvature = _dot(direction, direction) - _dot(direction, blurred)
            # Zero where nothing is wrong, and perhaps negative where tiles do not make quite a symmetric matrix.
            if not curvature > 0:
                break
            step, before = np.float32(power / curvature), power
            for value, part, image, left in zip(filled, direction, blurred, error, strict=True):
                value += step * part
                left -= step * (part - image)
            power = _dot(error, error)
            for part, left in zip(direction, error, strict=True):
                part *= np.float32(power / before)
                part += left

    def _blur_minimiser(
        self, source: FloatImage | None, beta: float, coupling: Coupling, sums: NormalSums | None = None
    ) -> None:
        """Write the blur of the minimiser for `sums`, to which `source` pulls, or for the observation `source` alone.

        It goes to `_blurred`.
        """
        minimise = self._minimiser(beta, coupling, pulls=sums is not None and source is not None)

        def blur(strip: int, thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            place, part = (strip, block, bands), self._parts[thread]
            otfs = self._every_otf[place]
            if sums is None:
                signal, power = part.signal[: len(slabs)], part.power[: len(slabs)]
                add_normal(slabs, otfs, np.float32(1.0), True, signal, power)
            else:
                signal, power = sums.signal[place], sums.power[place]
            minimise(block, signal, power, slabs)
            spectral.multiply(slabs, otfs)

        self._pass(source, self._blurred, blur)

    def _beyond(self, picture: FloatImage) -> tuple[FloatImage, FloatImage]:
        """Return views of the rows and of the columns that were not recorded."""
        height, width = self.recorded
        return picture[height:], picture[:height, width:]


def _dot(a: Sequence[FloatImage], b: Sequence[FloatImage]) -> float:
    return sum(float(np.sum(x * y, dtype=np.float64)) for x, y in zip(a, b, strict=True))


def extended(light: FloatImage, bank: PsfBank) -> FloatImage:
    """Return the picture (H, W, C) made periodic; its own rows and columns come first."""
    height, width, _ = extended_shape(light.shape, bank)
    return smooth(light, height, width)


def extended_shape(shape: tuple[int, ...], bank: PsfBank) -> tuple[int, int, int]:
    """Return the shape of :func:`extended`: larger by at least a PSF."""
    height, width, channels = shape
    tall, wide = bank.size
    return fast_length(height + tall, excess=WHOLE_EXCESS), fast_length(width + wide, excess=WHOLE_EXCESS), channels


def smooth(light: FloatImage, height: int, width: int) -> FloatImage:
    """Fill the added pixels with harmonic functions (zero Laplacian), in the manner of Liu and Jia (2008).

    First the rows that join the last row to the first, then the columns that join the last column to the first, then
    the corner between both.
    """
    out = np.empty((height, width, light.shape[2]), dtype=np.float32)
    tall, wide, _ = light.shape
    out[:tall, :wide] = light
    below = _between(light[-1], light[0], height - tall)
    right = _between(light[:, -1], light[:, 0], width - wide)
    out[tall:, :wide] = below
    out[:tall, wide:] = right.swapaxes(0, 1)
    # The corner lies between the last and, as the picture repeats, the first row of `right`, and so it does between
    # the last and the first column of `below`.
    ring = np.zeros((height - tall + 2, width - wide + 2, light.shape[2]))
    ring[0, 1:-1], ring[-1, 1:-1] = right[:, -1], right[:, 0]
    ring[1:-1, 0], ring[1:-1, -1] = below[:, -1], below[:, 0]
    out[tall:, wide:] = _harmonic(ring)
    return out


def _between(start: FloatImage, end: FloatImage, count: int) -> NDArray[np.float64]:
    """Return `count` lines, shape (count, n, C), that lead harmonically from `start` to `end` (n, C)."""
    ring = np.zeros((count + 2, *start.shape))
    ring[0], ring[-1] = start, end
    # The two short sides lead straight from corner to corner.
    step = np.linspace(0, 1, count + 2)[:, None]
    for side in (0, -1):
        ring[:, side] = (1 - step) * start[side] + step * end[side]
    lines = ring[1:-1]
    lines[:, 1:-1] = _harmonic(ring)
    return lines


def _harmonic(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the harmonic function inside the border of `ring` (h + 2, w + 2, C); only that border is read."""
    inner = tuple(max(n - 2, 0) for n in ring.shape[:2])
    known = np.zeros((*inner, ring.shape[2]))
    if not known.size:
        return known
    known[0] -= ring[0, 1:-1]
    known[-1] -= ring[-1, 1:-1]
    known[:, 0] -= ring[1:-1, 0]
    known[:, -1] -= ring[1:-1, -1]
    down, across = (2 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)) - 2 for n in inner)
    sines = fft.dstn(known, type=1, axes=(0, 1)) / (down[:, None] + across)[..., None]
    solved: NDArray[np.float64] = fft.idstn(sines, type=1, axes=(0, 1))
    return solved
