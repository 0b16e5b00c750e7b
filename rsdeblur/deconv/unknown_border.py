"""Deconvolution that leaves open what the camera would have recorded beyond the frame.

A picture is made periodic first: rows and columns after the last ones lead from its end to its start without a seam,
and are cut off after the solve. Their values are guesses, which other solutions explain like the recorded ones. Here
only the recorded pixels count: the data term is ``|M (A u - g)|^2`` with the mask M of the frame [1]_ [2]_. It is least
where the other pixels z have the values of the blurred solution, so in a solve with the pull v of a prior they satisfy

    z = N A B (A^T (M g + z) + beta v)

where N = I - M, and B is the inverse of the normal equations of the picture without a frame, a factor per frequency.
Each solve takes a few steps from the values of z that the solve before had towards those that the right side has: a
Richardson iteration, with steps of the lengths that Chebyshev polynomials give.

.. [1] S. Reeves, "Fast image restoration without boundary artifacts", IEEE Trans. Image Processing 14, 2005.
.. [2] M. Almeida and M. Figueiredo, "Deconvolving images with unknown boundaries using the alternating direction method
   of multipliers", IEEE Trans. Image Processing 22, 2013.
"""

import numpy as np

from rsdeblur._util.one_line import one_line
from rsdeblur.deconv.fft import fast_length
from rsdeblur.deconv.priors import TO_GRADIENT, Coupling
from rsdeblur.deconv.quadratic import TileQuadratic
from rsdeblur.deconv.tiling import WHOLE_EXCESS
from rsdeblur.kernels import spectral
from rsdeblur.psf import PsfBank
from rsdeblur.types import ComplexArray, FloatImage

# Lengths of the steps of a solve: Chebyshev's for errors of which a step of length 1 leaves 0 to 90 %. Later ones take
# back what earlier ones make grow. (docs/developer/decisions.md)
STEPS = 7.45, 2.65, 1.385, 1.036


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
        # Steps blur: they need the OTFs of all tiles.
        self._every_otf = self._new_filters()
        self._fill_otfs(bank, self._every_otf)
        # The picture with the present values beyond its frame, and a blurred solution.
        self._filled, self._blurred = (np.zeros(self._channelled, np.float32) for _ in range(2))

    @property
    def _bytes_per_frequency(self) -> int:
        """Bytes that are kept for each frequency of a tile: the sums and the OTF."""
        return super()._bytes_per_frequency + 8

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
        if self._waiting is not None:
            self._filled[...] = self._waiting[1]
        self._add()
        (height, width), minimise = self.recorded, self._minimiser(beta, coupling, pulls=pull is not None)

        def blur(strip: int, thread: int, block: int, bands: slice, slabs: ComplexArray) -> None:
            minimise(strip, thread, block, bands, slabs)
            spectral.multiply(slabs, self._every_otf[strip, block, bands])

        for step in STEPS:
            self._pass(pull, self._blurred, blur)
            change = np.float32(step) * (self._blurred - self._filled)
            change[:height, :width] = 0
            self._filled += change
            self._waiting = 0, self._filled
            self._add()
        return super().solve(beta, pull, coupling, out=out)


def extended(light: FloatImage, bank: PsfBank) -> FloatImage:
    """Return the picture (H, W, C) made periodic; its own rows and columns come first.

    The others lead straight from the last to the first of these.
    """
    for axis, length in enumerate(extended_shape(light.shape, bank)[:2]):
        first, last = light.take([0], axis), light.take([-1], axis)
        share = np.linspace(0, 1, length - light.shape[axis] + 2, dtype=np.float32)[1:-1]
        between = last + np.expand_dims(share, (1 - axis, 2)) * (first - last)
        light = np.concatenate([light, between], axis)
    return light


def extended_shape(shape: tuple[int, ...], bank: PsfBank) -> tuple[int, int, int]:
    """Return the shape of :func:`extended`: larger by at least a PSF."""
    height, width, channels = shape
    tall, wide = bank.size
    return fast_length(height + tall, excess=WHOLE_EXCESS), fast_length(width + wide, excess=WHOLE_EXCESS), channels
