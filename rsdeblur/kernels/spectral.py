"""Filtering, solving and blending in the frequency domain; of C kernels, also the NumPy twins.

Spectra are C-contiguous complex64 arrays. Shapes: slabs or bands B, channels C, columns K, slab or tile length L,
picture rows H.
"""

from collections.abc import Callable

import numpy as np

from rsdeblur.kernels import native
from rsdeblur.types import ComplexArray, Float32Array, Int32Array

# Least normal matrix: frequencies that no PSF passes and no prior restores contain no signal.
TINY = np.finfo(np.float32).tiny


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


def add_normal_numpy(
    spectra: ComplexArray,
    otfs: ComplexArray,
    share: np.float32,
    first: bool,
    signal: ComplexArray,
    power: Float32Array,
) -> None:
    """Add one picture's part to the normal equations: `share conj(H) G` to `signal`, `share |H|^2` to `power`.

    `spectra` (B, C, K, L) are G and `otfs` (B, K, L) are H; `signal` and `power` have the same shapes. With `first`,
    the sums start here, and what they held before is ignored.
    """
    for each, otf, of_signal, of_power in zip(spectra, otfs, signal, power, strict=True):
        if first:
            of_signal[...], of_power[...] = 0, 0
        shared = share * otf.conj()
        of_signal += shared * each
        of_power += (shared * otf).real


def solve_normal_numpy(
    signal: ComplexArray,
    power: Float32Array,
    across: Float32Array,
    down: Float32Array,
    nsr: np.float32,
    coupling: Float32Array,
    pull: np.float32,
    scale: np.float32,
    spectra: ComplexArray,
) -> None:
    """Solve the normal equations of :func:`add_normal_numpy` with a prior that pulls.

    At each frequency, `spectra` (B, C, K, L) has the spectrum V of what the adjoint makes of the prior's target. It is
    replaced by

        scale ((1 + nsr) signal + pull V) / (power + nsr + c0 + c1 d + c2 d^2)

    where c is `coupling` (3,), see :class:`rsdeblur.deconv.priors.Coupling`, and d the sum of `across` (K,) and `down`
    (L,), the squared magnitudes of the frequency responses of the horizontal and the vertical difference.
    """
    squared = np.add.outer(across, down)
    ridge = nsr + coupling[0] + squared * (coupling[1] + squared * coupling[2])
    for of_signal, of_power, each in zip(signal, power, spectra, strict=True):
        gains = scale / np.maximum(of_power + ridge, TINY)
        each *= pull
        each += (1 + nsr) * of_signal
        each *= gains


multiply: Callable[[ComplexArray, ComplexArray], None] = native.multiply if native else multiply_numpy
add_normal: Callable[..., None] = native.add_normal if native else add_normal_numpy
solve_normal: Callable[..., None] = native.solve_normal if native else solve_normal_numpy
blend: Callable[[ComplexArray, ComplexArray, Float32Array, Int32Array], None] = native.blend if native else blend_numpy
unpair: Callable[[ComplexArray, ComplexArray, ComplexArray, int], None] = native.unpair if native else unpair_numpy
pair: Callable[[ComplexArray, int, ComplexArray, ComplexArray], None] = native.pair if native else pair_numpy
