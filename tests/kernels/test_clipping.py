"""Limits of luma and chroma that are known for cells."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels.clipping import limit


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
