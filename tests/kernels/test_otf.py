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


# Each kernel, its twin, their arguments, and the shape of what they fill.
CALLS = [
    *(
        (rows_around_origin, rows_around_origin_numpy, (spectra(*shape).real.astype(float), 1.5), (shape[0], 9))
        for shape in ((3, 5), (4, 4), (1, 1))
    ),
    *(
        (columns_around_origin, columns_around_origin_numpy, (spectra(rows, 17), gains(17), first), (12, 8))
        for first in (0, 12)
        for rows in (5, 4, 1)
    ),
    *(
        (lowest_frequencies, lowest_frequencies_numpy, (spectra(3, points), gains(length)), (3, length))
        for points, length in ((12, 8), (12, 7), (8, 8), (9, 9))
    ),
    *(
        (put_columns, put_columns_numpy, (spectra(count, 10), block, 1), (3, 2, 4, 10))
        for block, count in ((0, 8), (1, 8), (2, 8), (0, 4))
    ),
]


@pytest.mark.parametrize(("kernel", "twin", "arguments", "shape"), CALLS)
def test_twins_agree(kernel, twin, arguments, shape) -> None:
    one, other = np.full((2, *shape), 7, np.float32 if kernel is rows_around_origin else np.complex64)
    kernel(*arguments, one)
    twin(*arguments, other)
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
