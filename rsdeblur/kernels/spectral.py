"""Filtering and blending slabs of columns: the C kernels and their NumPy twins.

Spectra are C-contiguous complex64 arrays. Shapes: channels C, columns K, slab length L, picture rows H.
"""

from __future__ import annotations

from collections.abc import Callable

from rsdeblur.kernels import native
from rsdeblur.types import ComplexArray, Float32Array


def multiply_numpy(spectra: ComplexArray, response: ComplexArray) -> None:
    """Multiply every channel by the frequency response of a filter, in place.

    Parameters
    ----------
    spectra : ndarray, shape (C, K, L), complex64, C-contiguous
        Changed in place; it must not overlap `response`.
    response : ndarray, shape (K, L), complex64, C-contiguous
        One factor per frequency.
    """
    spectra *= response


def blend_numpy(
    accumulator: ComplexArray, slab: ComplexArray, weights: Float32Array, to_position: int, from_position: int
) -> None:
    """Add weighted lines of a slab to the columns that they belong to, in place.

    Parameters
    ----------
    accumulator : ndarray, shape (C, K, H), complex64, C-contiguous
        Changed in place at n positions of every line; it must not overlap `slab` or `weights`.
    slab : ndarray, shape (C, K, L), complex64, C-contiguous
        Read at n positions of every line.
    weights : ndarray, shape (n,), float32, C-contiguous
        One weight per position.
    to_position, from_position : int
        First position in `accumulator` and in `slab`; the n positions from there on must lie within the lines.
    """
    n = len(weights)
    accumulator[..., to_position : to_position + n] += weights * slab[..., from_position : from_position + n]


multiply: Callable[[ComplexArray, ComplexArray], None] = native.multiply if native else multiply_numpy
blend: Callable[..., None] = native.blend if native else blend_numpy
