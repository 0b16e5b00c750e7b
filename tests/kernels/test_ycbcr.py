"""Laws of the conversion between YCbCr of half-size colours and RGB."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.kernels.ycbcr import FULL, Coding, from_rgb, to_rgb

BT709 = 0.2126, 0.0722
CODINGS = [(bits, full) for bits in (8, 10, 12) for full in (False, True)]


@pytest.fixture(params=CODINGS, ids=str)
def coding(request):
    bits, full_range = request.param
    return Coding.of(*BT709, bits, full_range=full_range)


def planes(coding, size, low=0.0, high=1.0):
    """Return random planes, within a part of the range."""
    dtype = np.uint8 if coding.grey == 128 else np.uint16
    random = np.random.default_rng(0)
    height, width = size
    shapes = size, *2 * ((-(-height // 2), -(-width // 2)),)
    most = 2 * int(coding.grey)
    return [random.integers(int(low * most), int(high * most), shape).astype(dtype) for shape in shapes]


def rgb_of(parts, coding):
    rgb = np.empty((*parts[0].shape, 3), np.uint16)
    to_rgb(*parts, coding, rgb)
    return rgb


@pytest.mark.parametrize("size", [(1, 1), (4, 6), (7, 9)])
def test_there_and_back_changes_nothing(coding, size):
    """Where RGB is not clipped, and colours do not change down the frame, over which they are interpolated."""
    luma, cb, cr = planes(coding, size, low=0.35, high=0.65)
    cb, cr = (((part.astype(np.float32) + 3 * coding.grey) / 4).astype(part.dtype) for part in (cb, cr))
    cb[...], cr[...] = cb[:1], cr[:1]
    back = [np.empty_like(part) for part in (luma, cb, cr)]
    from_rgb(rgb_of((luma, cb, cr), coding), coding, *back)
    for part, again in zip((luma, cb, cr), back, strict=True):
        np.testing.assert_array_equal(part, again)


def test_black_white_and_the_primaries(coding):
    colours = np.array([[0, 0, 0], [1, 1, 1], [1, 0, 0], [0, 0, 1]], np.float32)
    rgb = (FULL * colours).astype(np.uint16)[None].repeat(2, axis=0).repeat(2, axis=1)
    dtype = np.uint8 if coding.grey == 128 else np.uint16
    luma, cb, cr = np.empty((2, 8), dtype), np.empty((1, 4), dtype), np.empty((1, 4), dtype)
    from_rgb(rgb, coding, luma, cb, cr)
    for part, values, span, zero in (
        (luma[0, ::2], (0, 1, BT709[0], BT709[1]), coding.luma_span, coding.black),
        (cb[0], (0, 0, -BT709[0] / (2 - 2 * BT709[1]), 0.5), coding.chroma_span, coding.grey),
        (cr[0], (0, 0, 0.5, -BT709[1] / (2 - 2 * BT709[0])), coding.chroma_span, coding.grey),
    ):
        # Half a stored level for rounding; half a level more where the full range would need a level beyond its end.
        np.testing.assert_allclose(part, span * np.array(values) + zero, atol=1.0)
    levels = rgb_of((luma, cb, cr), coding) / FULL
    # Two roundings of stored values, of which the one of a colour counts nearly twice.
    np.testing.assert_allclose(levels, rgb / FULL, atol=3.0 / coding.luma_span)
