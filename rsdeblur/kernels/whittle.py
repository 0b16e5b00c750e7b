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


@njit(nogil=True)
def _smoothed_power(spectra, out):
    count, height, width = spectra.shape
    # A column before the first one and after the last one, for each row and its neighbours.
    power, smooth = np.empty((height, width + 2), np.float32), np.empty(width + 2, np.float32)
    for n in range(count):
        for y in range(height):
            for x in range(width):
                value = spectra[n, y, x]
                power[y, x + 1] = value.real * value.real + value.imag * value.imag
        # Opposite frequencies have the same power, so the columns beyond either end are columns upside down.
        for y in range(height):
            opposite = (height - y) % height
            power[y, 0], power[y, width + 1] = power[opposite, 2], power[opposite, width - 1]
        for y in range(height):
            above, below = power[y - 1 if y > 0 else height - 1], power[y + 1 if y < height - 1 else 0]
            here = power[y]
            for x in range(width + 2):
                smooth[x] = HERE * here[x] + ASIDE * (above[x] + below[x])
            for x in range(width):
                out[n, y, x] = HERE * smooth[x + 1] + ASIDE * (smooth[x] + smooth[x + 2])


def smoothed_power(spectra: ComplexArray) -> NDArray[np.float32]:
    """Return the power (N, H, W) of half spectra, smoothed as by a Hann window.

    The spectra (N, H, W), W >= 3, are those of real tiles of H x 2 (W - 1) px, as `scipy.fft.rfft2` returns them.
    """
    out = np.empty(spectra.shape, np.float32)
    _smoothed_power(read_only(spectra), out)
    return out


# Divisions and sums are in loops of their own, which become SIMD code. Arrays are assigned by loops as well: with the
# error message of `out[:] = values`, Numba takes seconds more to compile.


@njit(nogil=True, error_model="numpy")
def _ratios(power, noise, expected, gain, level, ratios):
    """Compute what the nats are the logarithm of, at the frequencies of one direction."""
    gain, level = np.float32(gain), np.float32(level)
    for i in range(len(ratios)):
        variance = gain * expected[i] + level * noise[i]
        doubled = variance + HALF * power[i]
        # Squares of faint light might be too small for float32.
        ratios[i] = doubled / variance * (doubled / noise[i])


@njit(nogil=True, error_model="numpy")
def _derivatives(power, noise, expected, gain, level, firsts, seconds):
    """Compute derivatives of the nats by the logarithm of the gain, at the frequencies of one direction."""
    gain, level = np.float32(gain), np.float32(level)
    for i in range(len(firsts)):
        signal = gain * expected[i]
        variance = signal + level * noise[i]
        doubled = variance + HALF * power[i]
        # Two divisions: the product of both divisors might be too small for float32.
        share = signal / variance
        firsts[i] = share * ((variance - HALF * power[i]) / doubled)
        seconds[i] = HALF * share * share


@njit(nogil=True, fastmath={"reassoc"})  # sums in any order
def _total(values):
    total = 0.0
    for i in range(len(values)):
        total += values[i]
    return total


@njit(nogil=True, error_model="numpy")
def _nats(tile, gains, level, ratios):
    """Return the sum over a tile, without the differences of the gains."""
    power, noise, expected, sectors = tile
    total = 0.0
    for k in range(len(gains)):
        a, b = sectors[k], sectors[k + 1]
        _ratios(power[a:b], noise[a:b], expected[a:b], gains[k], level, ratios[a:b])
        # One logarithm for several factors, which stay within the range of doubles; four are multiplied side by side.
        product = 1.0
        for i in range(a, b - 3, 4):
            product *= (ratios[i] * ratios[i + 1]) * (ratios[i + 2] * ratios[i + 3])
            if not 1e-100 < product < 1e100:
                total += np.log(product)
                product = 1.0
        for i in range(b - (b - a) % 4, b):
            product *= ratios[i]
        total += np.log(product)
    return total


@njit(nogil=True, error_model="numpy")
def _newton(tile, level, stiffness, gains, buffers):
    """Find the gains of a tile; return their differences' share of the nats."""
    power, noise, expected, sectors = tile
    logs, slopes, bends, firsts, seconds = buffers
    count = len(gains)
    inside = slice(sectors[0], sectors[count])
    scene, floor = _total(expected[inside]), level * _total(noise[inside])
    excess = _total(power[inside]) - floor
    faintest = np.log(FAINTEST * floor / scene)
    # Strong edges dominate the mean, so the search begins below it.
    mean = max(np.log(max(excess, FAINTEST * floor) / scene) - 1.0, faintest)
    for k in range(count):
        logs[k] = mean
    for _ in range(STEPS):
        ones, forces = 0.0, 0.0
        for k in range(count):
            a, b = sectors[k], sectors[k + 1]
            _derivatives(power[a:b], noise[a:b], expected[a:b], np.exp(logs[k]), level, firsts[a:b], seconds[a:b])
            slopes[k] = stiffness * (logs[k] - mean) + _total(firsts[a:b])
            bends[k] = stiffness + 1e-6 + _total(seconds[a:b])
            ones += 1.0 / bends[k]
            forces += slopes[k] / bends[k]
        # The Hessian is diag(bends) - stiffness / count, which the Sherman-Morrison formula inverts.
        common = stiffness / count * forces / max(1.0 - stiffness / count * ones, 1e-9)
        longest = 0.0
        for k in range(count):
            step = -(slopes[k] + common) / bends[k]
            moved = max(logs[k] + min(max(step, -LONGEST), LONGEST), faintest)
            longest = max(longest, abs(moved - logs[k]))
            logs[k] = moved
        mean = _total(logs) / count
        if longest < SETTLED:
            break
    apart = 0.0
    for k in range(count):
        gains[k] = np.exp(logs[k])
        apart += (logs[k] - mean) ** 2
    return 0.5 * stiffness * apart


@njit(nogil=True, error_model="numpy")
def _fit(first, stop, tiles, levels, stiffness, nats, gains, chosen):
    count, frequencies = len(tiles.sectors) - 1, tiles.power.shape[1]
    # Terms are float32, of which twice as many fit into a vector; products of ratios need the range of float64.
    firsts, seconds = np.empty(frequencies, np.float32), np.empty(frequencies, np.float32)
    trial, ratios = np.empty(count), np.empty(frequencies)
    buffers = np.empty(count), np.empty(count), np.empty(count), firsts, seconds
    for n in range(first, stop):
        tile = tiles.power[n], tiles.noise[n], tiles.expected[tiles.place[n]], tiles.sectors
        nats[n] = np.inf
        for level in levels:
            apart = _newton(tile, level, stiffness, trial, buffers)
            total = apart + _nats(tile, trial, level, ratios)
            if total < nats[n]:
                nats[n], chosen[n] = total, level
                for k in range(count):
                    gains[n, k] = trial[k]


def fit_gains(
    tiles: Tiles, levels: FloatArray, stiffness: float, *, threads: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the nats (N,) of all tiles, the gains (N, D), and the levels (N,) of the noise.

    `levels` are candidates for the level of the noise, positive. `stiffness`, not negative, weighs the differences of
    the gains' logarithms.
    """
    power, noise, expected, place, sectors = tiles
    count = len(power)
    tiles = Tiles(read_only(power), read_only(noise), read_only(expected), read_only(place), read_only(sectors))
    nats, gains, chosen = np.empty(count), np.empty((count, len(tiles.sectors) - 1)), np.empty(count)
    share_range(lambda first, stop: _fit(first, stop, tiles, levels, stiffness, nats, gains, chosen), count, threads)
    return nats, gains, chosen


@njit(nogil=True, error_model="numpy")
def _information(first, stop, tiles, slopes, fitted, stiffness, gradient, fisher):
    power, noise, expected, place, sectors = tiles
    gains, chosen = fitted
    parameters, count = slopes.shape[0], len(sectors) - 1
    mixed, own = np.empty((count, parameters)), np.empty(count)
    change = np.empty(parameters)
    for tile in range(first, stop):
        where = place[tile]
        for p in range(parameters):
            gradient[tile, p] = 0.0
            for q in range(parameters):
                fisher[tile, p, q] = 0.0
        for k in range(count):
            own[k] = stiffness + 1e-6
            for p in range(parameters):
                mixed[k, p] = 0.0
            for i in range(sectors[k], sectors[k + 1]):
                signal = gains[tile, k] * expected[where, i]
                variance = signal + chosen[tile] * noise[tile, i]
                share = signal / variance
                surprise = (variance - 0.5 * power[tile, i]) / (variance + 0.5 * power[tile, i])
                own[k] += 0.5 * share * share
                for p in range(parameters):
                    change[p] = share * slopes[p, where, i]
                    gradient[tile, p] += surprise * change[p]
                    mixed[k, p] += 0.5 * share * change[p]
                    for q in range(p + 1):
                        fisher[tile, p, q] += 0.5 * change[p] * change[q]
        # The gains follow the parameters. Their information is diag(own) - stiffness / count, which the
        # Sherman-Morrison formula inverts.
        ones = 0.0
        for k in range(count):
            ones += 1.0 / own[k]
        spread = 1.0 / max(1.0 - stiffness / count * ones, 1e-9)
        for p in range(parameters):
            for q in range(p + 1):
                taken, left, right = 0.0, 0.0, 0.0
                for k in range(count):
                    taken += mixed[k, p] * mixed[k, q] / own[k]
                    left += mixed[k, p] / own[k]
                    right += mixed[k, q] / own[k]
                fisher[tile, p, q] -= taken + stiffness / count * spread * left * right
                fisher[tile, q, p] = fisher[tile, p, q]


def information(
    tiles: Tiles,
    slopes: NDArray[np.float32],
    fitted: tuple[FloatArray, FloatArray],
    stiffness: float,
    *,
    threads: int | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the gradient (N, Q) of the nats of every tile and their Fisher information (N, Q, Q).

    The information is without what the gains take over. `slopes` (Q, K, F) are the derivatives of the logarithm of
    `tiles.expected` with respect to Q parameters; `fitted` are the gains and levels that :func:`fit_gains` returned.
    """
    count, parameters = len(tiles.power), len(slopes)
    gradient, fisher = np.empty((count, parameters)), np.empty((count, parameters, parameters))
    given = tiles, slopes, fitted, stiffness
    share_range(lambda first, stop: _information(first, stop, *given, gradient, fisher), count, threads)
    return gradient, fisher
