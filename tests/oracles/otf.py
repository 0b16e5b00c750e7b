"""Readable NumPy oracles of `rsdeblur.kernels.otf`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.types import ComplexArray, Float32Array


def rows_around_origin_numpy(grid: NDArray[np.floating], factor: float, rows: Float32Array) -> None:
    """Readable twin of :func:`rows_around_origin`."""
    padded = np.zeros(rows.shape)
    padded[:, : grid.shape[1]] = grid * factor
    rows[...] = np.roll(padded, -(grid.shape[1] // 2), axis=1)


def columns_around_origin_numpy(spectrum: ComplexArray, gains: Float32Array, first: int, columns: ComplexArray) -> None:
    """Readable twin of :func:`columns_around_origin`."""
    part = (spectrum * gains)[:, first : first + len(columns)].T
    columns[...] = 0
    columns[: len(part), : part.shape[1]] = part
    columns[...] = np.roll(columns, -(len(spectrum) // 2), axis=1)


def lowest_frequencies_numpy(spectra: ComplexArray, gains: Float32Array, out: ComplexArray) -> None:
    """Readable twin of :func:`lowest_frequencies`."""
    length, half = len(gains), len(gains) // 2
    out[:, : length - half], out[:, length - half :] = spectra[:, : length - half], spectra[:, -half:]
    if length % 2 == 0:
        out[:, half] = (spectra[:, -half] + spectra[:, half]) / 2
    out *= gains


def put_columns_numpy(columns: ComplexArray, block: int, band: int, out: ComplexArray) -> None:
    """Readable twin of :func:`put_columns`."""
    target = out[block:, band]
    blocks = columns.reshape(-1, *target.shape[1:])[: len(target)]
    target[: len(blocks)] = blocks
