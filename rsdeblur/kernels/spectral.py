"""Filtering, solving and blending in the frequency domain; of C kernels, also the NumPy twins.

Spectra are C-contiguous complex64 arrays. Shapes: slabs or bands B, channels C, columns K, slab or tile length L,
picture rows H.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rsdeblur.kernels import native
from rsdeblur.kernels._jit import njit
from rsdeblur.types import ComplexArray, Float32Array, Int32Array

# Least normal matrix: frequencies that no PSF passes and no prior restores contain no signal.
TINY = np.finfo(np.float32).tiny
# Complex values in a cache line. So many columns are filled together: the same places of more columns, which are often
# a power of two apart, would not stay in the first-level cache.
LINE = 8


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


@njit(nogil=True, error_model="numpy")
def add_normal(spectra, otfs, share, first, signal, power):
    """Add one picture's part to the normal equations: `share conj(H) G` to `signal`, `share |H|^2` to `power`.

    `spectra` (B, C, K, L) are G and `otfs` (B, K, L) are H; `signal` and `power` have the same shapes. With `first`,
    the sums start here, and what they held before is ignored.
    """
    for b in range(spectra.shape[0]):
        for k in range(otfs.shape[1]):
            for j in range(otfs.shape[2]):
                h = otfs[b, k, j]
                here = share * (h.real * h.real + h.imag * h.imag)
                power[b, k, j] = here if first else power[b, k, j] + here
            for c in range(spectra.shape[1]):
                for j in range(otfs.shape[2]):
                    h, g = otfs[b, k, j], spectra[b, c, k, j]
                    real = share * (h.real * g.real + h.imag * g.imag)
                    imag = share * (h.real * g.imag - h.imag * g.real)
                    here = np.complex64(complex(real, imag))
                    signal[b, c, k, j] = here if first else signal[b, c, k, j] + here


@njit(nogil=True, error_model="numpy")
def solve_normal(signal, power, across, down, nsr, coupling, pull, scale, spectra):
    """Solve the normal equations of :func:`add_normal` with a prior that pulls.

    At each frequency, `spectra` (B, C, K, L) has the spectrum V of what the adjoint makes of the prior's target. It is
    replaced by

        scale ((1 + nsr) signal + pull V) / (power + nsr + c0 + c1 d + c2 d^2)

    where c is `coupling` (:class:`rsdeblur.deconv.priors.Coupling`) and d the sum of `across` (K,) and `down` (L,), the
    squared magnitudes of the frequency responses of the horizontal and the vertical difference.
    """
    norm, tiny = np.float32(1.0) + nsr, np.float32(TINY)
    picture, gradient, bend = coupling
    ridge = nsr + picture
    gains = np.empty(spectra.shape[3], np.float32)
    for b in range(spectra.shape[0]):
        for k in range(spectra.shape[2]):
            for j in range(spectra.shape[3]):
                squared = across[k] + down[j]
                normal = power[b, k, j] + ridge + squared * (gradient + squared * bend)
                gains[j] = scale / max(normal, tiny)
            for c in range(spectra.shape[1]):
                for j in range(spectra.shape[3]):
                    gain, s, v = gains[j], signal[b, c, k, j], spectra[b, c, k, j]
                    real = gain * (norm * s.real + pull * v.real)
                    imag = gain * (norm * s.imag + pull * v.imag)
                    spectra[b, c, k, j] = np.complex64(complex(real, imag))


@njit(nogil=True)
def columns_around_origin(spectrum, gains, first, columns):
    """Place columns of row spectra (n, F), times `gains` (F,), in `columns` (K, M) that repeat.

    The columns are the K from `first` on; those beyond F become 0. The middle row of `spectrum` is the origin. M is at
    least n; all other values become 0. Real and imaginary parts alternate, so that loops become SIMD code.
    """
    above = spectrum.shape[0] // 2
    below = spectrum.shape[0] - above
    points = columns.shape[1] // 2
    count = min(columns.shape[0], len(gains) - first)
    columns[count:] = 0
    columns[:count, 2 * below : 2 * (points - above)] = 0
    for begin in range(0, count, LINE):
        for i in range(spectrum.shape[0]):
            place = i - above if i >= above else points - above + i
            for k in range(begin, min(begin + LINE, count)):
                gain = gains[first + k]
                columns[k, 2 * place] = spectrum[i, 2 * (first + k)] * gain
                columns[k, 2 * place + 1] = spectrum[i, 2 * (first + k) + 1] * gain


@njit(nogil=True)
def lowest_frequencies(spectra, gains, out):
    """Fill `out` (K, L) with the lowest frequencies of `spectra` (K, M), in FFT's order, times `gains` (L,); L <= M.

    The highest of an even number of frequencies has either sign: it becomes the mean of both. Real and imaginary parts
    alternate.
    """
    length, half = len(gains), len(gains) // 2
    for k in range(len(spectra)):
        target, start, end = out[k], spectra[k], spectra[k][spectra.shape[1] - 2 * length :]
        for j in range(length - half):
            target[2 * j] = start[2 * j] * gains[j]
            target[2 * j + 1] = start[2 * j + 1] * gains[j]
        for j in range(length - half, length):
            target[2 * j] = end[2 * j] * gains[j]
            target[2 * j + 1] = end[2 * j + 1] * gains[j]
        if length % 2 == 0:
            for n in range(2 * half, 2 * half + 2):
                target[n] = np.float32(0.5) * (end[n] + start[n]) * gains[half]


@njit(nogil=True, error_model="numpy")
def invert(otfs, nsr, scale, block, band, out):
    """Place the Wiener filter `scale conj(H) / (|H|^2 + nsr)` of columns `otfs` (N, L) in `out` (blocks, B, K, L).

    The first column goes to `block`; those beyond the last block are ignored. `nsr` and `scale` are float32; `nsr` is
    positive. Last axes are real and imaginary parts, which alternate.
    """
    columns = out.shape[2]
    for n in range(min(len(otfs), columns * (len(out) - block))):
        otf, line = otfs[n], out[block + n // columns, band, n % columns]
        for i in range(len(otf) // 2):
            real, imag = otf[2 * i], otf[2 * i + 1]
            gain = scale / (real * real + imag * imag + nsr)
            line[2 * i], line[2 * i + 1] = real * gain, -imag * gain
