"""Readable NumPy oracles of kernels: spectra."""

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.whittle import FAINTEST, LONGEST, SETTLED, STEPS, Tiles
from rsdeblur.types import FloatArray


def fit_cells_numpy(
    measured: FloatArray,
    blurred: FloatArray,
    error: FloatArray,
    cells: NDArray[np.intp],
    floors: FloatArray,
    squared: float,
    gains: FloatArray,
    sums: FloatArray,
) -> None:
    def total(power: FloatArray) -> FloatArray:
        return np.add.reduceat(power, cells[:-1], axis=1)

    def known() -> FloatArray:
        return 1 / (np.repeat(gains, sizes, axis=1) * scene + np.repeat(floors, sizes, axis=1))

    scene, sizes = blurred + squared * error, np.diff(cells)
    gains *= total(measured * known() ** 2 * scene) / total(known() * scene)
    surprise = measured * known() ** 2
    sums[:2] = total(surprise), total(known())
    sums[2:] = gains * total(surprise * error), gains * total(known() * error)


def fit_gains_numpy(tiles: Tiles, levels: FloatArray, stiffness: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    power, noise, expected, place, sectors = tiles
    of_direction = np.repeat(np.arange(len(sectors) - 1), np.diff(sectors))
    fits = [
        min(
            (_fit_tile(each, level * white, expected[at], sectors, of_direction, stiffness, white), level)
            for level in levels
        )
        for each, white, at in zip(*(a.astype(np.float64) for a in (power, noise)), place, strict=True)
    ]
    nats, gains = zip(*((nats, gains) for (nats, gains), _ in fits), strict=True)
    return np.array(nats), np.array(gains), np.array([level for _, level in fits])


def _fit_tile(
    power: FloatArray,
    floor: FloatArray,
    expected: NDArray[np.float32],
    sectors: NDArray[np.intp],
    of_direction: NDArray[np.intp],
    stiffness: float,
    unit: FloatArray,
) -> tuple[float, list[float]]:
    """Return the nats and the gains of a tile under the noise `floor`."""
    scene, excess, count = expected.sum(dtype=np.float64), (power - floor).sum(), len(sectors) - 1
    faintest = np.log(FAINTEST * floor.sum() / scene)
    mean = max(np.log(np.maximum(excess, FAINTEST * floor.sum()) / scene) - 1.0, faintest)
    logs = np.full(count, mean)
    for _ in range(STEPS):
        signal = np.exp(logs)[of_direction] * expected
        variance = signal + floor
        share = signal / variance
        surprise = share * (variance - 0.5 * power) / (variance + 0.5 * power)
        slopes = stiffness * (logs - mean) + np.add.reduceat(surprise, sectors[:-1])
        bends = stiffness + 1e-6 + np.add.reduceat(0.5 * share**2, sectors[:-1])
        common = stiffness / count * (slopes / bends).sum() / max(1.0 - stiffness / count * (1 / bends).sum(), 1e-9)
        moved = np.maximum(logs + (-(slopes + common) / bends).clip(-LONGEST, LONGEST), faintest)
        longest, logs = np.abs(moved - logs).max(), moved
        mean = logs.mean()
        if longest < SETTLED:
            break
    variance = np.exp(logs)[of_direction] * expected + floor
    nats = np.log(np.square(variance + 0.5 * power) / (variance * unit)).sum()
    return float(nats + 0.5 * stiffness * np.square(logs - mean).sum()), np.exp(logs).tolist()
