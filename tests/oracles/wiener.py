"""Readable NumPy oracles of `rsdeblur.kernels.wiener`."""

from __future__ import annotations

import numpy as np

from rsdeblur.types import ComplexArray


def invert_numpy(
    otfs: ComplexArray, nsr: np.float32, scale: np.float32, block: int, band: int, out: ComplexArray
) -> None:
    """Readable twin of :func:`invert`."""
    target = out[block:, band]
    columns = otfs.reshape(-1, *target.shape[1:])[: len(target)]
    target[: len(columns)] = columns.conj() * (scale / (np.square(columns.real) + np.square(columns.imag) + nsr))
