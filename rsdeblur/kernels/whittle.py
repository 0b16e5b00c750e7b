"""How likely the periodograms of tiles are under given power spectra, and how periodograms smooth these.

A tile's periodogram P is compared with `V = a_k E + b N`: E the power expected from the scene and the blur, N that of
white noise, b one of a few levels, and a_k the gain of the scene in the direction k. A periodogram is distributed
exponentially about its mean, so that its negative log-likelihood is `log V + P / V` (Whittle 1953). Large values, as
along a strong edge, count by their logarithm instead: `log V + 2 log(1 + P / 2 V)`, which is
`log((V + P / 2)^2 / V)`; the kernels divide by N as well, which adds a constant. The gains minimise the sum of these
over the tile and `stiffness / 2` times the squared differences of their logarithms from the mean of these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_range
from rsdeblur.kernels._jit import njit, read_only
from rsdeblur.types import ComplexArray, FloatArray

# Newton steps for the gains of a tile, and the change of a logarithm that ends them.
STEPS, SETTLED = 12, 0.02
# Largest step of a gain's logarithm.
LONGEST = 1.0
# A literal would turn terms of float32 into float64.
HALF = np.float32(0.5)
# Power of the Hann window's transform at a frequency and at either neighbour.
HERE, ASIDE = np.float32(2 / 3), np.float32(1 / 6)
# Least gain, as the power of the scene over that of the noise.
FAINTEST = 3e-3


class Tiles(NamedTuple):
    """Periodograms of N tiles and their expectations, at F frequencies sorted by direction."""

    power: NDArray[np.float32]  # periodograms (N, F)
    noise: NDArray[np.float32]  # power of the noise in them (N, F)
    expected: NDArray[np.float32]  # power of scene and blur at K places (K, F), positive
    place: NDArray[np.intp]  # index of each tile's place (N,)
    sectors: NDArray[np.intp]  # first frequency of each of D directions, and F, (D + 1,)


def smoothed_power(spectra: ComplexArray) -> NDArray[np.float32]:
    """Return the power (N, H, W) of half spectra, smoothed as by a Hann window.

    The spectra (N, H, W), W >= 3, are those of real tiles of H x 2 (W - 1) px, as `scipy.fft.rfft2` returns them.
    """
    power = np.square(spectra.real) + np.square(spectra.imag)
    power = HERE * power + ASIDE * (np.roll(power, 1, axis=1) + np.roll(power, -1, axis=1))
    # Opposite frequencies have the same power, so the columns beyond either end are columns upside down.
    ends = np.roll(power[:, ::-1, [1, -2]], 1, axis=1)
    wide = np.concatenate([ends[..., :1], power, ends[..., 1:]], axis=2)
    smooth: NDArray[np.float32] = HERE * power + ASIDE * (wide[..., :-2] + wide[..., 2:])
    return smooth


# Arrays are assigned by loops: with the error message of `out[:] = values`, Numba takes seconds more to compile.


@njit(nogil=True, error_model="numpy")
def _ratios(power, noise, expected, gain, level, ratios):
    """Compute what the nats are the logarithm of, at the frequencies of one direction."""
    gain, level = np.float32(gain), np.float32(level)
    for i in range(len(ratios)):
        variance = gain * expected[i] + level * noise[i]
        doubled = variance + HALF * power[i]
        # Squares of faint light might be too small for float32.
        ratios[i] = doubled / variance * (doubled / noise[i])


@njit(nogil=True, error_model="numpy", fastmath={"reassoc"})  # sums in any order become SIMD code
def _derivatives(power, noise, expected, gain, level):
    """Return derivatives of the nats by the logarithm of the gain, over the frequencies of one direction."""
    gain, level = np.float32(gain), np.float32(level)
    first = second = np.float32(0.0)
    for i in range(len(power)):
        signal = gain * expected[i]
        variance = signal + level * noise[i]
        doubled = variance + HALF * power[i]
        # Two divisions: the product of both divisors might be too small for float32.
        share = signal / variance
        first += share * ((variance - HALF * power[i]) / doubled)
        second += HALF * share * share
    return first, second


@njit(nogil=True, error_model="numpy")
def _newton(tile, start, faintest, level, stiffness, logs, steps):
    """Find the logarithms of a tile's gains, from one for all of them on; return their differences' share of nats."""
    power, noise, expected, sectors = tile
    slopes, bends = steps
    count, mean = len(logs), max(start, faintest)
    for k in range(count):
        logs[k] = mean
    for _ in range(STEPS):
        ones, forces = 0.0, 0.0
        for k in range(count):
            a, b = sectors[k], sectors[k + 1]
            first, second = _derivatives(power[a:b], noise[a:b], expected[a:b], np.exp(logs[k]), level)
            slopes[k], bends[k] = stiffness * (logs[k] - mean) + first, stiffness + 1e-6 + second
            ones += 1.0 / bends[k]
            forces += slopes[k] / bends[k]
        # The Hessian is diag(bends) - stiffness / count, which the Sherman-Morrison formula inverts.
        common = stiffness / count * forces / max(1.0 - stiffness / count * ones, 1e-9)
        longest, total = 0.0, 0.0
        for k in range(count):
            step = -(slopes[k] + common) / bends[k]
            moved = max(logs[k] + min(max(step, -LONGEST), LONGEST), faintest)
            longest = max(longest, abs(moved - logs[k]))
            logs[k] = moved
            total += moved
        mean = total / count
        if longest < SETTLED:
            break
    apart = 0.0
    for k in range(count):
        apart += (logs[k] - mean) ** 2
    return 0.5 * stiffness * apart


@njit(nogil=True, error_model="numpy")
def _fit(first, stop, tiles, starts, levels, stiffness, nats, gains, chosen):
    count = len(tiles.sectors) - 1
    # Products of ratios need the range of float64.
    logs, ratios, steps = np.empty(count), np.empty(tiles.power.shape[1]), (np.empty(count), np.empty(count))
    for n in range(first, stop):
        tile = tiles.power[n], tiles.noise[n], tiles.expected[tiles.place[n]], tiles.sectors
        nats[n] = np.inf
        for i in range(len(levels)):
            level = levels[i]
            total = _newton(tile, starts[0, i, n], starts[1, i, n], level, stiffness, logs, steps)
            for k in range(count):
                a, b = tiles.sectors[k], tiles.sectors[k + 1]
                _ratios(tile[0][a:b], tile[1][a:b], tile[2][a:b], np.exp(logs[k]), level, ratios[a:b])
                # One logarithm for several factors, which stay within the range of doubles.
                product = 1.0
                for j in range(a, b):
                    product *= ratios[j]
                    if not 1e-100 < product < 1e100:
                        total += np.log(product)
                        product = 1.0
                total += np.log(product)
            if total < nats[n]:
                nats[n], chosen[n] = total, level
                for k in range(count):
                    gains[n, k] = np.exp(logs[k])


def fit_gains(
    tiles: Tiles, levels: FloatArray, stiffness: float, *, threads: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the nats (N,) of all tiles, the gains (N, D), and the levels (N,) of the noise.

    `levels` are candidates for the level of the noise, positive. `stiffness`, not negative, weighs the differences of
    the gains' logarithms.
    """
    count, sectors = len(tiles.power), tiles.sectors
    inside = np.s_[:, sectors[0] : sectors[-1]]
    power, noise, scene = (each[inside].sum(axis=1, dtype=np.float64) for each in tiles[:3])
    least = FAINTEST * np.multiply.outer(levels, noise)
    excess = np.maximum(power - np.multiply.outer(levels, noise), least)
    # Strong edges dominate the mean, so the search begins below it.
    starts = np.log(np.stack([excess / np.e, least]) / scene[tiles.place])
    tiles = Tiles._make(read_only(each) for each in tiles)
    nats, gains, chosen = np.empty(count), np.empty((count, len(sectors) - 1)), np.empty(count)
    given = tiles, starts, levels, stiffness
    share_range(lambda first, stop: _fit(first, stop, *given, nats, gains, chosen), count, threads)
    return nats, gains, chosen


def information(
    tiles: Tiles,
    slopes: NDArray[np.float32],
    fitted: tuple[FloatArray, FloatArray],
    stiffness: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient (N, Q) of the nats of every tile and their Fisher information (N, Q, Q).

    The information is without what the gains take over. `slopes` (Q, K, F) are the derivatives of the logarithm of
    `tiles.expected` with respect to Q parameters; `fitted` are the gains and levels that :func:`fit_gains` returned.
    """
    power, noise, expected, place, sectors = tiles
    gains, levels = (each.astype(np.float32) for each in fitted)
    signal = np.repeat(gains, np.diff(sectors), axis=1) * expected[place]
    variance = signal + levels[:, None] * noise
    share = signal / variance
    surprise = (variance - HALF * power) / (variance + HALF * power)
    change = np.moveaxis((share * slopes[:, place]).astype(np.float64), 0, 1)
    gradient = np.einsum("nf,nqf->nq", surprise, change)
    fisher = 0.5 * change @ np.swapaxes(change, 1, 2)
    # The gains follow the parameters: what they take over is left out.
    mixed = np.swapaxes(np.add.reduceat(0.5 * share[:, None] * change, sectors[:-1], axis=2), 1, 2)
    own = np.add.reduceat(0.5 * np.square(share, dtype=np.float64), sectors[:-1], axis=1) + (stiffness + 1e-6)
    of_gains = own[..., None] * np.eye(own.shape[1]) - stiffness / own.shape[1]
    return gradient, fisher - np.swapaxes(mixed, 1, 2) @ np.linalg.solve(of_gains, mixed)
