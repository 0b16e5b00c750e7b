"""Filtering and blending slabs of row spectra: the C kernels and their NumPy twins.

Spectra are C-contiguous complex64; channels C, rows of a slab L, rows of the picture H, column frequencies K.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels import native

Spectra = NDArray[np.complex64]


def multiply_numpy(spectra: Spectra, transfer: Spectra) -> None:
    """Multiply every channel by one transfer function, in place.

    Parameters
    ----------
    spectra : ndarray, shape (C, L, K), complex64, C-contiguous
        Changed in place; it must not overlap `transfer`.
    transfer : ndarray, shape (L, K), complex64, C-contiguous
    """
    spectra *= transfer


def blend_numpy(
    accumulator: Spectra, slab: Spectra, weights: NDArray[np.float32], *, to_row: int, from_row: int
) -> None:
    """Add weighted rows of a slab to the rows of the picture they belong to, in place.

    Parameters
    ----------
    accumulator : ndarray, shape (C, H, K), complex64, C-contiguous
        Changed in place: its rows `to_row` to `to_row + n` grow by the weighted rows; it must not overlap the others.
    slab : ndarray, shape (C, L, K), complex64, C-contiguous
        Its rows `from_row` to `from_row + n` are read.
    weights : ndarray, shape (n,), float32, C-contiguous
        One weight per row.
    to_row, from_row : int
        First row in `accumulator` and in `slab`; both ranges lie within their arrays.
    """
    n = len(weights)
    accumulator[:, to_row : to_row + n] += weights[:, None] * slab[:, from_row : from_row + n]


multiply: Callable[[Spectra, Spectra], None] = native.multiply if native else multiply_numpy
blend: Callable[..., None] = native.blend if native else blend_numpy
