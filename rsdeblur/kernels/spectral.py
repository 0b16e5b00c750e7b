"""Filtering and blending slabs of columns: the C kernels and their NumPy twins.

Spectra are C-contiguous complex64; channels C, columns K, length of a slab L, rows of the picture H.
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
    spectra : ndarray, shape (C, K, L), complex64, C-contiguous
        Changed in place; it must not overlap `transfer`.
    transfer : ndarray, shape (K, L), complex64, C-contiguous
    """
    spectra *= transfer


def blend_numpy(
    accumulator: Spectra, slab: Spectra, weights: NDArray[np.float32], to_position: int, from_position: int
) -> None:
    """Add weighted lines of a slab to the columns they belong to, in place.

    Parameters
    ----------
    accumulator : ndarray, shape (C, K, H), complex64, C-contiguous
        Changed in place: positions `to_position` to `to_position + n` of every line grow by the weighted ones; it must
        not overlap the others.
    slab : ndarray, shape (C, K, L), complex64, C-contiguous
        Its positions `from_position` to `from_position + n` are read.
    weights : ndarray, shape (n,), float32, C-contiguous
        One weight per position.
    to_position, from_position : int
        First position in `accumulator` and in `slab`; both ranges lie within their lines.
    """
    n = len(weights)
    accumulator[..., to_position : to_position + n] += weights * slab[..., from_position : from_position + n]


multiply: Callable[[Spectra, Spectra], None] = native.multiply if native else multiply_numpy
blend: Callable[..., None] = native.blend if native else blend_numpy
