"""Power spectra of PSFs as a windowed periodogram sees them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import ComplexArray

# Power of the Hann window's transform at a frequency and at either neighbour.
HERE, ASIDE = np.float32(2 / 3), np.float32(1 / 6)


@njit(nogil=True)
def _smoothed_power(spectra, out):
    count, height, width = spectra.shape
    # A column before the first one and after the last one, for each row and its neighbours.
    power, smooth = np.empty((height, width + 2), np.float32), np.empty(width + 2, np.float32)
    for n in range(count):
        for y in range(height):
            for x in range(width):
                value = spectra[n, y, x]
                power[y, x + 1] = value.real * value.real + value.imag * value.imag
        # Opposite frequencies have the same power, so the columns beyond either end are columns upside down.
        for y in range(height):
            opposite = (height - y) % height
            power[y, 0], power[y, width + 1] = power[opposite, 2], power[opposite, width - 1]
        for y in range(height):
            above, below = power[y - 1 if y > 0 else height - 1], power[y + 1 if y < height - 1 else 0]
            here = power[y]
            for x in range(width + 2):
                smooth[x] = HERE * here[x] + ASIDE * (above[x] + below[x])
            for x in range(width):
                out[n, y, x] = HERE * smooth[x + 1] + ASIDE * (smooth[x] + smooth[x + 2])


def smoothed_power(spectra: ComplexArray) -> NDArray[np.float32]:
    """Return the power of spectra, smoothed by a Hann window.

    Parameters
    ----------
    spectra : ndarray, shape (N, H, W), complex64
        Half spectra of real tiles of H x 2 (W - 1) px, as `scipy.fft.rfft2` returns them; W is at least 3.

    Returns
    -------
    ndarray, shape (N, H, W), float32
    """
    out = np.empty(spectra.shape, np.float32)
    _smoothed_power(read_only(spectra), out)
    return out
