"""Light below black in cells."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.undershoot import depths, fade_to
from tests.oracles.undershoot import depths_numpy, fade_to_numpy


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("step", [1, 3, 8, 20])
def test_twins_agree(step: int, channels: int) -> None:
    random = np.random.default_rng(step)
    sharp, blurred = random.uniform(-1, 1, (2, 11, 17, channels)).astype(np.float32)
    one, other = np.empty((2, -(-11 // step), -(-17 // step)), np.float32)
    depths(sharp, step, one)
    depths_numpy(sharp, step, other)
    # Rounding of float32, in sums of up to 187 values.
    np.testing.assert_allclose(one, other, rtol=1e-5)

    cells = (5, 4)
    down, across = (
        (before, np.minimum(before + 1, n - 1), random.random(length, dtype=np.float32))
        for n, length in zip(cells, sharp.shape, strict=False)
        for before in [random.integers(0, n, length)]
    )
    weight = np.clip(random.uniform(-1, 1, cells), 0, 1).astype(np.float32)
    faded = sharp.copy()
    fade_to(faded, blurred, weight, down, across)
    fade_to_numpy(sharp, blurred, weight, down, across)
    # Both round each operation alike.
    np.testing.assert_array_equal(faded, sharp)


def test_the_darkest_channel_counts_and_light_above_black_does_not() -> None:
    light = np.array([[[0.5, -0.2, 1.0], [0.3, 0.1, 0.0]]], np.float32)
    below = np.empty((1, 1), np.float32)
    depths(light, 2, below)
    np.testing.assert_allclose(below, 0.1, rtol=1e-6)
