"""What surrounds the transforms of an OTF: agreement with the NumPy twins."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.otf import columns_around_origin, lowest_frequencies, put_columns, rows_around_origin
from tests.oracles.otf import (
    columns_around_origin_numpy,
    lowest_frequencies_numpy,
    put_columns_numpy,
    rows_around_origin_numpy,
)

# Rounding of a few operations in float32.
ROUNDING = 1e-6


def spectra(*shape: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def gains(count: int) -> np.ndarray:
    return np.linspace(1, 2, count, dtype=np.float32)


@pytest.mark.parametrize("shape", [(3, 5), (4, 4), (1, 1)])
def test_rows_of_the_twin_agree(shape: tuple[int, int]) -> None:
    one, other = np.full((2, shape[0], 9), 7, np.float32)
    grid = np.random.default_rng(0).normal(size=shape)
    rows_around_origin(grid, 1.5, one)
    rows_around_origin_numpy(grid, 1.5, other)
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("first", [0, 12])
@pytest.mark.parametrize("rows", [5, 4, 1])
def test_columns_of_the_twin_agree(first: int, rows: int) -> None:
    one, other = np.full((2, 12, 8), 7, np.complex64)
    columns_around_origin(spectra(rows, 17), gains(17), first, one)
    columns_around_origin_numpy(spectra(rows, 17), gains(17), first, other)
    np.testing.assert_allclose(one, other, rtol=ROUNDING)


@pytest.mark.parametrize(("points", "length"), [(12, 8), (12, 7), (8, 8), (9, 9)])
def test_lowest_frequencies_of_the_twin_agree(points: int, length: int) -> None:
    one, other = np.full((2, 3, length), 7, np.complex64)
    lowest_frequencies(spectra(3, points), gains(length), one)
    lowest_frequencies_numpy(spectra(3, points), gains(length), other)
    np.testing.assert_allclose(one, other, rtol=ROUNDING)


def test_the_lowest_frequencies_interpolate() -> None:
    # A signal with few frequencies, sampled more finely, has the same spectrum there.
    turns = np.arange(12) / 12
    fine = (3 + np.cos(2 * np.pi * turns) - np.sin(6 * np.pi * turns)).astype(np.complex64)
    out = np.empty((1, 8), np.complex64)
    lowest_frequencies(np.fft.fft(fine).astype(np.complex64)[None], np.full(8, 8 / 12, np.float32), out)
    turns = np.arange(8) / 8
    expected = np.fft.fft(3 + np.cos(2 * np.pi * turns) - np.sin(6 * np.pi * turns))
    # Rounding in float32 of sums of up to 24.
    np.testing.assert_allclose(out[0], expected, atol=1e-5)


@pytest.mark.parametrize(("block", "count"), [(0, 8), (1, 8), (2, 8), (0, 4)])
def test_places_of_the_twin_agree(block: int, count: int) -> None:
    one, other = np.full((2, 3, 2, 4, 10), 7, np.complex64)
    put_columns(spectra(count, 10), block, 1, one)
    put_columns_numpy(spectra(count, 10), block, 1, other)
    np.testing.assert_array_equal(one, other)
