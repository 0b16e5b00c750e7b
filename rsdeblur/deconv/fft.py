"""The only module that calls FFTW: planned transforms of lines, in buffers that belong to the transforms.

A transform runs in the thread that calls it; threads share blocks of work (`rsdeblur.deconv.hybrid`), not transforms.
"""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pyfftw
from numpy.typing import NDArray

from rsdeblur._util.memory import empty
from rsdeblur.kernels import spectral
from rsdeblur.types import ComplexArray, Float32Array

# What each odd factor of a length adds to the time per point of a transform, relative to that of a power of two. Fitted
# to measured plans of lengths 96 to 2310 (float32, AVX-512).
FACTOR_COST = {3: 0.15, 5: 0.15, 7: 0.4, 11: 1.0, 13: 1.3}


def fast_length(minimum: int, *, excess: float) -> int:
    """Return the even length from `minimum` to about `minimum * (1 + excess)` that FFTW transforms fastest."""
    lengths = range(minimum + minimum % 2, max(int(minimum * (1 + excess)), minimum + 2) + 1, 2)
    return min(lengths, key=_cost)


def _cost(length: int) -> float:
    """Return the predicted time of a transform; a prime above 13 costs as much as a direct sum over it."""
    rest, powers = length, dict.fromkeys((2, *FACTOR_COST), 0)
    for factor in powers:
        while rest % factor == 0:
            rest //= factor
            powers[factor] += 1
    odd = sum(cost * powers[factor] for factor, cost in FACTOR_COST.items())
    # FFTW is fast for multiples of 16. Fitted as above.
    further = 0.35 * max(powers[3] - 1, 0) + 0.25 * max(4 - powers[2], 0)
    return length * (1.0 + odd + further + (rest - 1))


class RowTransform:
    """Real transform along the last axis: `real` (C, R, n) <-> R rows of `spectra` (C, H, K), K > n // 2.

    Both buffers are created here, unless `spectra` are passed. The inverse is not scaled. Lines of even length are
    transformed as half as many complex values (:func:`rsdeblur.kernels.spectral.unpair_numpy`).
    """

    def __init__(self, shape: tuple[int, int, int], spectra: ComplexArray | None = None) -> None:
        *lines, n = shape
        self.real: Float32Array = empty(shape, np.float32)
        self.spectra: ComplexArray = empty((*lines, n // 2 + 1), np.complex64) if spectra is None else spectra
        self._paired = n % 2 == 0
        self._packed: ComplexArray = empty((*lines, n // 2 if self._paired else n // 2 + 1), np.complex64)
        self._turns = spectral.turns(n // 2)
        values = self.real.view(np.complex64) if self._paired else self.real
        self._forward: Callable[[], None] = _plan(values, self._packed, "FFTW_FORWARD").execute
        self._inverse: Callable[[], None] = _plan(self._packed, values, "FFTW_BACKWARD").execute
        # A caller may fill the buffer in part, but the transform reads all of it.
        self.real[...] = 0

    def forward(self, top: int = 0) -> None:
        """Transform into the rows of `spectra` from `top` on; the frequencies beyond the highest become zero."""
        self._forward()
        if self._paired:
            spectral.unpair(self._packed, self._turns, self.spectra, top)
            return
        rows, frequencies = self._packed.shape[1:]
        self.spectra[:, top : top + rows, :frequencies] = self._packed
        self.spectra[:, top : top + rows, frequencies:] = 0

    def inverse(self, top: int = 0) -> None:
        """Transform the rows of `spectra` from `top` on back."""
        if self._paired:
            spectral.pair(self.spectra, top, self._turns, self._packed)
        else:
            rows, frequencies = self._packed.shape[1:]
            self._packed[...] = self.spectra[:, top : top + rows, :frequencies]
        self._inverse()


class LineTransform:
    """Complex transform along the last axis: `lines` (..., n) <-> `spectra` (..., n).

    Both buffers are created here. The inverse is not scaled. Transforms in place would take FFTW more than twice the
    time. Each direction may destroy what it reads.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.lines: ComplexArray = empty(shape, np.complex64)
        self.spectra: ComplexArray = empty(shape, np.complex64)
        self.forward: Callable[[], None] = _plan(self.lines, self.spectra, "FFTW_FORWARD").execute
        self.inverse: Callable[[], None] = _plan(self.spectra, self.lines, "FFTW_BACKWARD").execute
        self.lines[...] = 0
        self.spectra[...] = 0


def _plan(source: NDArray[Any], target: NDArray[Any], direction: str) -> Any:
    """Return the transform of lines from `source` to `target`, unscaled; it may destroy `source`."""
    flags = ("FFTW_ESTIMATE", "FFTW_DESTROY_INPUT")
    with _planner:
        return pyfftw.FFTW(source, target, axes=(-1,), direction=direction, flags=flags)


# FFTW has one planner per process.
_planner = threading.Lock()
