"""Readable NumPy oracles of `rsdeblur.kernels.floors`."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.floors import TilePowers, _first_gains, _first_noises
from rsdeblur.types import FloatArray


def fit_floors_numpy(
    tiles: TilePowers, start: tuple[float, float], steps: int, weight: float
) -> tuple[FloatArray, float]:
    """Readable twin of :func:`fit_floors`."""
    starts, sizes = tiles.cells[:-1], np.diff(tiles.cells)
    gains, (squared, prior), bright = _first_gains(tiles), 2 * start[1:], tiles.brightness[:, None]
    even, brighter = _first_noises(tiles, start[0])
    octave = np.repeat(tiles.octaves, sizes)
    members = np.equal.outer(octave, np.arange(len(even)))
    for _ in range(steps):
        scene, floor = tiles.blurred + squared * tiles.error, even[octave] + brighter[octave] * bright
        known = 1 / (np.repeat(gains, sizes, axis=1) * scene + floor * tiles.noise)
        surprise = tiles.measured * known**2
        gains = gains * np.add.reduceat(surprise * scene, starts, 1) / np.add.reduceat(known * scene, starts, 1)
        each = np.repeat(gains, sizes, axis=1)
        known = 1 / (each * scene + floor * tiles.noise)
        surprise = tiles.measured * known**2
        ups, downs = surprise * tiles.noise @ members, known * tiles.noise @ members
        even = even * ups.sum(axis=0) / downs.sum(axis=0)
        brighter = brighter * (ups * bright).sum(axis=0) / (downs * bright).sum(axis=0)
        up, down = weight * prior / squared**2, weight / squared
        squared *= (up + (each * surprise * tiles.error).sum()) / (down + (each * known * tiles.error).sum())
    return even + brighter * bright.mean(), float(squared)
