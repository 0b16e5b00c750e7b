"""Wiener filters of OTFs."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import ComplexArray


# Real and imaginary parts alternate: such loops become SIMD code.
@njit(nogil=True, error_model="numpy")
def _invert_line(otf, nsr, scale, out):
    for i in range(len(otf) // 2):
        real, imag = otf[2 * i], otf[2 * i + 1]
        gain = scale / (real * real + imag * imag + nsr)
        out[2 * i], out[2 * i + 1] = real * gain, -imag * gain


@njit(nogil=True, error_model="numpy")
def _invert(otfs, nsr, scale, block, band, out):
    columns = out.shape[2]
    for n in range(min(len(otfs), columns * (len(out) - block))):
        line = out[block + n // columns, band, n % columns]
        _invert_line(otfs[n].view(np.float32), nsr, scale, line.view(np.float32))


def invert(otfs: ComplexArray, nsr: np.float32, scale: np.float32, block: int, band: int, out: ComplexArray) -> None:
    """Fill columns of a band's filters with those of the Wiener filter, `scale conj(H) / (|H|^2 + nsr)`.

    Parameters
    ----------
    otfs : ndarray, shape (N, L), complex64
        Columns of the OTF H; those beyond the last block are ignored.
    nsr, scale : float32
        Noise-to-signal ratio, positive, and a factor.
    block, band : int
        Block of columns in `out` that receives the first ones, and the band.
    out : ndarray, shape (blocks, B, K, L), complex64, C-contiguous
        The filters.
    """
    _invert(otfs, nsr, scale, block, band, out)
