"""The tone curve of sRGB: rounded integers, and tables."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rsdeblur.kernels.tone import END, look_up, to_srgb, to_srgb_levels

# Dark and bright, below black and beyond white, and either side of the end of the straight part.
LIGHT = np.concatenate(
    [
        np.linspace(-2.0, 2.0, 3001, dtype=np.float32),
        np.nextafter(np.repeat(END, 2), np.array([0, 1], np.float32)),
        np.array([END, -END, 0.0, 1e-40, 1e12], np.float32),
    ]
)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_integers_are_the_rounded_clipped_values(dtype: type) -> None:
    most = np.iinfo(dtype).max
    levels, is_finite = to_srgb_levels(LIGHT, np.dtype(dtype))
    assert levels.dtype == dtype
    assert is_finite
    np.testing.assert_array_equal(levels, np.rint(to_srgb(LIGHT).clip(0, 1) * np.float32(most)))
    for value in (np.nan, np.inf, -np.inf):
        assert not to_srgb_levels(np.append(LIGHT, np.float32(value)), np.dtype(dtype))[1]


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_tables_give_the_light_of_each_value(dtype: type) -> None:
    most = int(np.iinfo(dtype).max)
    table = np.linspace(0.0, 1.0, most + 1, dtype=np.float32)
    values: Any = np.random.default_rng(1).integers(0, most, (7, 9, 4), dtype=dtype, endpoint=True)
    values[0, 0], values[0, 1] = 0, most
    # Without alpha, and turned like a picture whose readout runs along x.
    for part in (values, values[..., :3], np.rot90(values)[::-1, :, :3]):
        fast = np.empty(part.shape, np.float32)
        look_up(table, part, fast)
        np.testing.assert_array_equal(fast, table[part])
