"""Shrinkage of several pictures in one undecimated Haar frame, and their sum.

The pictures are restorations of one blurred picture, from the least to the most regularised. Level j of the frame takes
means and differences of pixels that are 2^j apart. Each of its coefficients is multiplied by

    c0 + c1 e / (e + t1^2 s^2) + c2 e / (e + t2^2 s^2)

where e is the sum of the squares of the 3 x 3 coefficients around it in the next more regularised picture, and s^2 the
sum that the noise of that picture has there. The frame is tight: with factors of 1 the pictures come back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsdeblur.types import Float32Array

LEVELS = 4
# Pixels around the picture that the result depends on, on each side.
HALO = 1 << LEVELS
# The t of the gates above, squared.
GATES = np.array([1.0, 2.5], dtype=np.float32) ** 2
# Differences across, down and along both axes. The first two share their factors.
ORIENTATIONS = 3
QUARTER, TINY = np.float32(0.25), np.float32(1e-30)


def combine(
    planes: Sequence[Float32Array], variances: Float32Array, low_factors: Float32Array, factors: Float32Array
) -> Float32Array:
    """Return the sum of all planes, shrunk in the frame, without `HALO` px on each side.

    - `planes`: one channel of each of K pictures (h, w), least regularised first.
    - `variances` (K, LEVELS, 3): the s^2, nine times the variance of the noise of a coefficient.
    - `low_factors` (K,): factors of the means that are left at the last level.
    - `factors` (K, LEVELS, 3, 3): c0, c1 and c2 of each level and orientation.
    """
    lows, last, sums = list(planes), len(planes) - 1, []
    for level in range(LEVELS):
        totals = [np.zeros_like(lows[0]) for _ in range(ORIENTATIONS)]
        energies: list[Float32Array] = []
        for k in range(last, -1, -1):
            *bands, lows[k] = _split(lows[k], 1 << level)
            own = [_sums_of_squares(band) for band in bands] if k > 0 or last == 0 else energies
            for o, energy in enumerate(energies or own):
                soft, hard = GATES * variances[min(k + 1, last), level, o] + TINY
                gain = factors[k, level, o, 1] * (energy / (energy + soft))
                gain += factors[k, level, o, 2] * (energy / (energy + hard))
                gain += factors[k, level, o, 0]
                totals[o] += np.multiply(gain, bands[o], out=gain)
            energies = own
        sums.append(totals)
    total: Float32Array = np.einsum("k,kyx->yx", low_factors, lows)
    for level in range(LEVELS - 1, -1, -1):
        total = _join(sums[level], total, 1 << level)
    return total[HALO:-HALO, HALO:-HALO]


def _split(low: Float32Array, step: int) -> tuple[Float32Array, ...]:
    """Return the differences across, down and along both axes, and the means; right from `step` px on."""
    left = np.roll(low, step, 1)
    total, across = low + left, low - left
    above, before = np.roll(total, step, 0), np.roll(across, step, 0)
    return tuple(QUARTER * each for each in (across + before, total - above, across - before, total + above))


def _join(bands: list[Float32Array], means: Float32Array, step: int) -> Float32Array:
    """Return what coefficients give, the adjoint of :func:`_split`."""
    across, down, both = bands
    even = means + across + np.roll(means - across, -step, 1)
    odd = down + both + np.roll(down - both, -step, 1)
    joined: Float32Array = QUARTER * (even + odd + np.roll(even - odd, -step, 0))
    return joined


def _sums_of_squares(band: Float32Array) -> Float32Array:
    """Return sums over 3 x 3 squared values, 0 along the rim."""
    squares, sums = np.square(band), np.zeros_like(band)
    lines = squares[:-2] + squares[1:-1] + squares[2:]
    sums[1:-1, 1:-1] = lines[:, :-2] + lines[:, 1:-1] + lines[:, 2:]
    return sums
