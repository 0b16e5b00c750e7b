"""Laws of the spectral kernels, on the C code and on its NumPy twin."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest

from rsdeblur.kernels import native, spectral, why_pure

# Values are of order 1 and each result is one complex product and one sum: a few roundings of 6e-8.
TOLERANCE = {"rtol": 0, "atol": 1e-6}
NAMES = ("multiply", "blend", "unpair", "pair")

needs_native = pytest.mark.skipif(native is None, reason=f"no C extension: {why_pure}")


@pytest.fixture(params=[pytest.param("native", marks=needs_native), "numpy"])
def kernels(request):
    if request.param == "native":
        return native
    return SimpleNamespace(**{name: getattr(spectral, name + "_numpy") for name in NAMES})


def complex_noise(rng, *shape):
    return (rng.uniform(-1, 1, shape) + 1j * rng.uniform(-1, 1, shape)).astype(np.complex64)


@pytest.mark.skipif(os.environ.get("RSDEBLUR_REQUIRE_CEXT", "0") != "1", reason="RSDEBLUR_REQUIRE_CEXT is not 1")
def test_c_code_is_in_use():
    assert native is not None, why_pure
    assert all(getattr(spectral, name) is getattr(native, name) for name in NAMES)


@pytest.mark.parametrize("n", [0, 1, 6])
def test_blend_adds_weighted_positions_and_touches_no_other(kernels, n):
    rng = np.random.default_rng(2)
    accumulator, slabs = complex_noise(rng, 3, 5, 11), complex_noise(rng, 2, 3, 5, 9)
    weights = rng.uniform(-1, 1, (2, 6)).astype(np.float32)
    spans = np.array([[4, 2, n], [0, 5, 3]], np.int32)
    expected = accumulator.astype(np.complex128)
    for slab, weight, (to, start, count) in zip(slabs, weights, spans, strict=True):
        for i in range(count):
            expected[..., to + i] += float(weight[i]) * slab[..., start + i]
    assert kernels.blend(accumulator, slabs, weights, spans) is None
    np.testing.assert_allclose(accumulator, expected, **TOLERANCE)


@pytest.mark.parametrize("n", [1, 2, 3, 8, 37])
def test_spectra_of_pairs_become_those_of_real_lines_and_back(kernels, n):
    values = np.random.default_rng(5).uniform(-1, 1, (2, 3, 2 * n)).astype(np.float32)
    pairs = np.fft.fft(values.view(np.complex64)).astype(np.complex64)
    spectra = np.full((2, 6, n + 4), 9, np.complex64)
    kernels.unpair(pairs, spectral.turns(n), spectra, 2)
    # Sums of up to 74 values of order 1, rounded to float32 a few times.
    np.testing.assert_allclose(spectra[:, 2:5, : n + 1], np.fft.rfft(values), rtol=0, atol=1e-5)
    assert not spectra[:, 2:5, n + 1 :].any()
    assert (spectra[:, [0, 1, 5]] == 9).all()
    # Like the inverse of any real transform, this one ignores imaginary parts that no real line has.
    spectra[:, 2:5, [0, n]] += 3j
    back = np.empty_like(pairs)
    kernels.pair(spectra, 2, spectral.turns(n), back)
    np.testing.assert_allclose(back, 2 * pairs, rtol=0, atol=1e-5)
