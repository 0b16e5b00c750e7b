"""How likely the periodograms of tiles are under given power spectra, and how periodograms smooth these.

A tile's periodogram P is compared with `V = a_k E + b N`: E the power expected from the scene and the blur, N that of
white noise, b one of a few levels, and a_k the gain of the scene in the direction k. A periodogram is distributed
exponentially about its mean, so that its negative log-likelihood is `log V + P / V` (Whittle 1953). Large values, as
along a strong edge, count by their logarithm instead: `log V + 2 log(1 + P / 2 V)`, which is
`log((V + P / 2)^2 / V)`; the kernels divide by N as well, which adds a constant. The gains minimise the sum of these
over the tile and `stiffness / 2` times the squared differences of their logarithms from the mean of these.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.threads import share_range
from rsdeblur.kernels import native, unpacked
from rsdeblur.types import ComplexArray, FloatArray

# Newton steps for the gains of a tile, and the change of a logarithm that ends them.
STEPS, SETTLED = 12, 0.02
# Largest step of a gain's logarithm.
LONGEST = 1.0
# Tiles that NumPy fits together: fewer take as many calls, more leave the cache.
TOGETHER = 40
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
    place: NDArray[np.integer]  # index of each tile's place (N,)
    sectors: NDArray[np.integer]  # first frequency of each of D directions, and F, (D + 1,)


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


def fit_tiles_numpy(
    tiles: Tiles,
    starts: FloatArray,
    levels: FloatArray,
    stiffness: float,
    nats: FloatArray,
    gains: FloatArray,
    chosen: FloatArray,
    workspace: FloatArray,
) -> None:
    """Find the `nats` (N,) of tiles, the `gains` (N, D) and the `chosen` (N,) levels of noise, from M `levels`.

    `starts` (N, M, 2) are logarithms: of the gain from which the search begins, in all directions, and of the least.
    Indices in `tiles` are int32. `workspace` (3, D) is overwritten.
    """
    for first in range(0, len(nats), TOGETHER):
        some = slice(first, first + TOGETHER)
        part = tiles._replace(power=tiles.power[some], noise=tiles.noise[some], place=tiles.place[some])
        fits = [_fit(part, starts[some, n], np.float32(level), stiffness) for n, level in enumerate(levels)]
        best = np.argmin([each for each, _ in fits], axis=0)
        chosen[some] = levels[best]
        rows = np.arange(len(best))
        nats[some], gains[some] = (np.stack(each)[best, rows] for each in zip(*fits, strict=True))


def _fit(tiles: Tiles, starts: FloatArray, level: np.float32, stiffness: float) -> tuple[FloatArray, FloatArray]:
    """Return the nats and the gains of tiles under one level of the noise."""
    sizes = np.diff(tiles.sectors)
    count, used = len(sizes), np.s_[:, tiles.sectors[0] : tiles.sectors[-1]]
    # Products with a matrix repeat gains, and sum over directions, in less time than `repeat` and `reduceat`.
    members = np.repeat(np.eye(count, dtype=np.float32), sizes, axis=1)
    # Memory that is used again takes half the time of new arrays. All powers are relative to that of the noise.
    floor = level * tiles.noise[used]
    scene, half, share, surprise, variance = np.empty((5, *floor.shape), np.float32)
    np.divide(tiles.expected[used][tiles.place], floor, out=scene)
    np.divide(HALF * tiles.power[used], floor, out=half)
    logs = np.repeat(starts.max(axis=1, keepdims=True), count, axis=1)
    moving, mean = np.ones((len(logs), 1), bool), np.full((count, 1), 1 / count)
    for _ in range(STEPS):
        np.matmul(np.exp(logs).astype(np.float32), members, out=share)
        share *= scene
        np.add(share, 1, out=variance)
        share /= variance
        np.subtract(variance, half, out=surprise)
        variance += half
        surprise /= variance
        surprise *= share
        share *= share
        slopes = stiffness * (logs - logs @ mean) + surprise @ members.T
        bends = stiffness + 1e-6 + HALF * (share @ members.T)
        # The Hessian is diag(bends) - stiffness / count, which the Sherman-Morrison formula inverts.
        common = stiffness * (slopes / bends) @ mean / np.maximum(1 - stiffness * (1 / bends) @ mean, 1e-9)
        steps = np.where(moving, (-(slopes + common) / bends).clip(-LONGEST, LONGEST), 0)
        before, logs = logs, np.maximum(logs + steps, starts[:, 1:])
        moving &= np.abs(logs - before).max(axis=1, keepdims=True) >= SETTLED
        if not moving.any():
            break
    gains = np.exp(logs)
    np.matmul(gains.astype(np.float32), members, out=share)
    share *= scene
    share += 1
    doubled = np.add(share, half, out=half)
    ratios = np.divide(doubled, share, out=share)
    ratios *= doubled
    ratios *= level
    nats = np.log(ratios, out=ratios).sum(axis=1, dtype=np.float64)
    return nats + 0.5 * stiffness * np.square(logs - logs @ mean).sum(axis=1), gains


fit_tiles: Callable[..., None] = unpacked(native.fit_tiles) if native else fit_tiles_numpy


def fit_gains(
    tiles: Tiles, levels: FloatArray, stiffness: float, *, threads: int | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the nats (N,) of all tiles, the gains (N, D), and the levels (N,) of the noise, of positive candidates."""
    power, noise, expected = (np.ascontiguousarray(each) for each in tiles[:3])
    place, sectors = (each.astype(np.int32) for each in tiles[3:])
    inside = np.s_[:, sectors[0] : sectors[-1]]
    light, floor, scene = (each[inside].sum(axis=1, dtype=np.float64) for each in (power, noise, expected))
    floors = np.multiply.outer(floor, levels)
    least = FAINTEST * floors
    excess = np.maximum(light[:, None] - floors, least)
    # Strong edges dominate the mean, so the search begins below it.
    starts = np.log(np.stack([excess / np.e, least], axis=-1) / scene[place, None, None])
    count, directions = len(power), len(sectors) - 1
    nats, gains, chosen = np.empty(count), np.empty((count, directions)), np.empty(count)

    def fit(first: int, stop: int) -> None:
        some = slice(first, stop)
        part = Tiles(power[some], noise[some], expected, place[some], sectors)
        fits = (each[some] for each in (nats, gains, chosen))
        fit_tiles(part, starts[some], levels, stiffness, *fits, np.empty((3, directions)))

    if native:
        share_range(fit, count, threads)
    else:  # NumPy takes longer for many small parts
        fit(0, count)
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
