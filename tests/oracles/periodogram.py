"""Readable NumPy oracles of `rsdeblur.kernels.periodogram`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.periodogram import ASIDE, HERE
from rsdeblur.types import ComplexArray


def smoothed_power_numpy(spectra: ComplexArray) -> NDArray[np.float32]:
    """Readable twin of :func:`smoothed_power`."""
    half = np.abs(spectra) ** 2
    before, after = (np.roll(half[..., ::-1, n], 1, axis=-1)[..., None] for n in (1, -2))
    power = np.concatenate([before, half, after], axis=-1)
    power = HERE * power + ASIDE * (np.roll(power, 1, 1) + np.roll(power, -1, 1))
    smoothed: NDArray[np.float32] = HERE * power[..., 1:-1] + ASIDE * (power[..., :-2] + power[..., 2:])
    return smoothed
