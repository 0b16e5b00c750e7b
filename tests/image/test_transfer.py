"""Laws of the transfer curves."""

import numpy as np
import pytest

from rsdeblur.image.transfer import from_linear, normalized, to_linear

CURVES = ["linear", "srgb", 2.2, 0.5, 1.0]


@pytest.fixture
def values():
    return np.linspace(-1.0, 2.0, 3001, dtype=np.float32).reshape(1, -1)


@pytest.mark.parametrize("transfer", CURVES)
def test_there_and_back(values, transfer):
    # Powers of float32 values: relative roundings of 6e-8 times exponents up to 2.4, twice.
    np.testing.assert_allclose(from_linear(to_linear(values, transfer), transfer), values, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(to_linear(from_linear(values, transfer), transfer), values, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("transfer", CURVES)
def test_increasing_odd_and_fixed_at_zero_and_one(values, transfer):
    for curve in (to_linear, from_linear):
        coded = curve(values, transfer)
        assert coded.dtype == np.float32
        assert coded.shape == values.shape
        assert np.all(np.diff(coded) > 0)
        np.testing.assert_array_equal(curve(-values, transfer), -coded)
        np.testing.assert_allclose(curve(np.array([0, 1], np.float32), transfer), [0, 1], atol=1e-7)


@pytest.mark.parametrize(
    ("stored", "light"), [(0.5, 0.21404114), (10 / 255, 0.0030352698), (11 / 255, 0.0033465358), (0.735357, 0.5)]
)
def test_known_values_of_srgb(stored, light):
    assert to_linear(np.float32([stored]), "srgb")[0] == pytest.approx(light, rel=3e-6)
    assert from_linear(np.float32([light]), "srgb")[0] == pytest.approx(stored, rel=3e-6)


def test_normalized_light_fills_the_range_only_if_it_overshoots():
    light = np.linspace(-0.5, 2.0, 10001, dtype=np.float32)
    squeezed = normalized(light)
    assert (squeezed.min(), squeezed.max()) == (0.0, 1.0)
    # All but the outliers are scaled alike: 0.1 % at either end are clipped.
    inside = (squeezed > 0) & (squeezed < 1)
    assert np.count_nonzero(~inside) == pytest.approx(20, abs=4)
    assert np.ptp(np.diff(squeezed[inside])) < 1e-5
    tame = light[(light > 0.1) & (light < 0.9)]
    np.testing.assert_array_equal(normalized(tame), tame)
