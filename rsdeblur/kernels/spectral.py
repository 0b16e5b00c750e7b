"""Filtering and blending slabs of columns: the C kernels and their NumPy twins.

Spectra are C-contiguous complex64 arrays. Shapes: slabs B, channels C, columns K, slab length L, picture rows H.
"""

from __future__ import annotations

from collections.abc import Callable

from rsdeblur.kernels import native
from rsdeblur.types import ComplexArray, Float32Array, Int32Array


def multiply_numpy(spectra: ComplexArray, responses: ComplexArray) -> None:
    """Multiply every channel of every slab by the frequency response of the slab's filter, in place.

    Parameters
    ----------
    spectra : ndarray, shape (B, C, K, L), complex64, C-contiguous
        Changed in place; it must not overlap `responses`.
    responses : ndarray, shape (B, K, L), complex64, C-contiguous
        One factor per frequency.
    """
    spectra *= responses[:, None]


def blend_numpy(accumulator: ComplexArray, slabs: ComplexArray, weights: Float32Array, spans: Int32Array) -> None:
    """Add weighted lines of slabs to the columns that they belong to, in place, one slab after the other.

    Parameters
    ----------
    accumulator : ndarray, shape (C, K, H), complex64, C-contiguous
        Changed in place at the positions of the spans; it must not overlap another array.
    slabs : ndarray, shape (B, C, K, L), complex64, C-contiguous
        Lines that are added.
    weights : ndarray, shape (B, W), float32, C-contiguous
        One weight per position of a span, which has at most W.
    spans : ndarray, shape (B, 3), int32, C-contiguous
        First position in `accumulator`, first position in the slab, and number of positions, which must lie within the
        lines.
    """
    for slab, weight, (to, start, n) in zip(slabs, weights, spans.tolist(), strict=True):
        accumulator[..., to : to + n] += weight[:n] * slab[..., start : start + n]


multiply: Callable[[ComplexArray, ComplexArray], None] = native.multiply if native else multiply_numpy
blend: Callable[[ComplexArray, ComplexArray, Float32Array, Int32Array], None] = native.blend if native else blend_numpy
