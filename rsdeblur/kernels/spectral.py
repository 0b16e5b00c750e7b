"""Filtering and blending slabs of columns, and spectra of real lines: the C kernels and their NumPy twins.

Spectra are C-contiguous complex64 arrays. Shapes: slabs B, channels C, columns K, slab length L, picture rows H.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsdeblur.kernels import native
from rsdeblur.types import ComplexArray, Float32Array, Int32Array


def multiply_numpy(spectra: ComplexArray, responses: ComplexArray) -> None:
    """Multiply the spectra (B, C, K, L) of slabs by `responses` (B, K, L), in place; they must not overlap."""
    spectra *= responses[:, None]


def blend_numpy(accumulator: ComplexArray, slabs: ComplexArray, weights: Float32Array, spans: Int32Array) -> None:
    """Add weighted lines of slabs to the columns that they belong to, in place, one slab after the other.

    `accumulator` (C, K, H) must overlap neither `slabs` (B, C, K, L) nor `weights` (B, W). A row of `spans` (B, 3) has
    the first position in `accumulator`, the first one in the slab, and the number of positions, at most W.
    """
    for slab, weight, (to, start, n) in zip(slabs, weights, spans.tolist(), strict=True):
        accumulator[..., to : to + n] += weight[:n] * slab[..., start : start + n]


def turns(n: int) -> ComplexArray:
    """Return `exp(-pi i k / n)` for k from 0 to n - 1, with which the spectra of n pairs become those of 2 n values."""
    phases: ComplexArray = np.exp(-1j * np.pi * np.arange(n) / n).astype(np.complex64)
    return phases


def unpair_numpy(pairs: ComplexArray, turns: ComplexArray, spectra: ComplexArray, top: int) -> None:
    """Compute the spectra of real lines from those of their pairs of neighbours, taken as complex numbers.

    A transform of n pairs takes half the time of one of 2 n values, and uses SIMD better than FFTW's real ones. `pairs`
    is (C, R, n), `turns` those of :func:`turns`. In `spectra` (C, H, K), the R rows from `top` on receive n + 1 values
    each, and zeros behind them.
    """
    n = pairs.shape[2]
    mirrored = np.roll(pairs[..., ::-1], 1, axis=2).conj()
    even, odd = (pairs + mirrored) / 2, (pairs - mirrored) / 2j
    out = spectra[:, top : top + pairs.shape[1]]
    out[..., :n] = even + turns * odd
    out[..., n] = (even - odd)[..., 0]
    out[..., n + 1 :] = 0


def pair_numpy(spectra: ComplexArray, top: int, turns: ComplexArray, pairs: ComplexArray) -> None:
    """Compute the spectra of pairs, the inverse of :func:`unpair_numpy`, times 2.

    The inverse transform of the pairs, not scaled, gives 2 n times the real values. Of the first and the last frequency
    only the real parts are used.
    """
    n = pairs.shape[2]
    lines = spectra[:, top : top + pairs.shape[1], : n + 1].copy()
    lines[..., [0, n]] = lines[..., [0, n]].real
    mirrored = lines[..., :0:-1].conj()
    pairs[...] = lines[..., :n] + mirrored + 1j * turns.conj() * (lines[..., :n] - mirrored)


multiply: Callable[[ComplexArray, ComplexArray], None] = native.multiply if native else multiply_numpy
blend: Callable[[ComplexArray, ComplexArray, Float32Array, Int32Array], None] = native.blend if native else blend_numpy
unpair: Callable[[ComplexArray, ComplexArray, ComplexArray, int], None] = native.unpair if native else unpair_numpy
pair: Callable[[ComplexArray, int, ComplexArray, ComplexArray], None] = native.pair if native else pair_numpy
