"""Limits of luma and chroma that are known for cells."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.clipping import extremes, limit
from tests.oracles.clipping import extremes_numpy, limit_numpy


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("wide", [1, 4, 7, 19, 40])
def test_twins_agree(wide, channels):
    random = np.random.default_rng(wide)
    rows = random.uniform(-0.1, 1.2, (9, 19, channels)).astype(np.float32)
    one, other = np.empty((2, 2, -(-19 // wide), channels + 1), np.float32)
    for measure, extreme in ((extremes, one), (extremes_numpy, other)):
        measure(np.sqrt(np.abs(rows)), wide, *extreme)
    # Rounding of float32, here and below.
    np.testing.assert_allclose(one, other, atol=1e-6)

    cells = 4, -(-19 // wide)
    weight = np.clip(random.random(cells, dtype=np.float32) * 2 - 1, 0, 1)
    least = random.uniform(-0.2, 0.5, (*cells, channels + 1)).astype(np.float32)
    changed = rows.copy()
    for top in (0, 5):
        limit(changed, top, 5, wide, weight, least, least + np.float32(0.2))
        limit_numpy(rows, top, 5, wide, weight, least, least + np.float32(0.2))
        np.testing.assert_allclose(changed, rows, atol=2e-6)


def test_what_is_within_its_limits_or_has_no_weight_keeps_its_bits():
    rows = np.random.default_rng(0).random((12, 8, 3), dtype=np.float32)
    changed = rows.copy()
    ones, colour = np.ones((3, 2), np.float32), np.array([0.2, -0.2, -0.2, -0.2], np.float32)
    limits = np.broadcast_to(-colour, (3, 2, 4)).copy(), np.broadcast_to(colour, (3, 2, 4)).copy()
    limit(changed, 0, 4, 4, 0 * ones, *limits)
    np.testing.assert_array_equal(changed, rows)
    least = np.full((3, 2, 4), -1, np.float32)
    limit(changed, 0, 4, 4, ones, least, -least)
    np.testing.assert_array_equal(changed, rows)


def test_colours_and_darkness_are_limited_and_brighter_light_than_full_scale_is_not():
    rows = np.array([[[0.81, 0.01, 0.01], [0.0, 0.0, 0.0], [25.0, 4.0, 4.0]]], np.float32)
    least, most = (np.array([[[n, 0, 0, 0]]], np.float32) for n in (0.2, 9))
    changed = rows.copy()
    limit(changed, 0, 1, 3, np.ones((1, 1), np.float32), least, most)
    # The mean of the roots 0.9, 0.1 and 0.1, squared; and the least luma, squared.
    np.testing.assert_allclose(changed[0, 0], (1.1 / 3) ** 2, rtol=1e-5)
    np.testing.assert_allclose(changed[0, 1], 0.04, rtol=1e-5)
    np.testing.assert_array_equal(changed[0, 2], rows[0, 2])
