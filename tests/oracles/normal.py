"""Readable NumPy oracles of `rsdeblur.kernels.normal`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.normal import TINY


def add_normal_numpy(
    spectra: NDArray[np.complex64],
    otfs: NDArray[np.complex64],
    share: float,
    first: bool,
    signal: NDArray[np.complex64],
    power: NDArray[np.float32],
) -> None:
    """Readable twin of :func:`add_normal`."""
    signal[...] = share * otfs.conj()[:, None] * spectra + (0 if first else signal)
    power[...] = share * np.abs(otfs) ** 2 + (0 if first else power)


def solve_normal_numpy(
    signal: NDArray[np.complex64],
    power: NDArray[np.float32],
    across: NDArray[np.float32],
    down: NDArray[np.float32],
    nsr: float,
    coupling: tuple[float, float, float],
    pull: float,
    scale: float,
    spectra: NDArray[np.complex64],
) -> None:
    """Readable twin of :func:`solve_normal`."""
    picture, gradient, bend = coupling
    squared = across[:, None] + down
    gains = scale / np.maximum(power + nsr + picture + gradient * squared + bend * squared**2, TINY)
    spectra[...] = gains[:, None] * ((1 + nsr) * signal + pull * spectra)
