"""Laws of moving lines, on the C kernels and on their NumPy twins.

The picture is unchanged, and its continuation joins smoothly.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rsdeblur.deconv.tiling import fade
from rsdeblur.kernels import lines, native, why_pure

N = 40


NAMES = ("picture_to_lines", "lines_to_picture", "rows_to_columns", "columns_to_rows", "cut_lines")

needs_native = pytest.mark.skipif(native is None, reason=f"no C extension: {why_pure}")


@pytest.fixture(params=[pytest.param("native", marks=needs_native), "numpy"])
def kernels(request):
    if request.param == "native":
        return native
    return SimpleNamespace(**{name: getattr(lines, name + "_numpy") for name in NAMES})


def complex_noise(*shape):
    rng = np.random.default_rng(0)
    return (rng.random(shape) + 1j * rng.random(shape)).astype(np.complex64)


@pytest.fixture
def extended(kernels):
    """Function that returns a tile of `length` at `start` of the rows of `source` (N, C)."""

    def cut(source, length, start, *, taper=0, border="blend"):
        out = np.full((source.shape[1], 1, length), np.nan, dtype=np.float32)
        assert kernels.picture_to_lines(source[None].copy(), 0, 1, start, fade(taper), border == "periodic", out)
        return out[:, 0].T

    return cut


@pytest.fixture
def noise():
    return np.random.default_rng(0).random((N, 3)).astype(np.float32)


@pytest.mark.parametrize(("length", "start"), [(40, 0), (60, 0), (60, -13), (25, 7), (25, -9), (25, 30), (200, -70)])
def test_periodic_repeats(extended, noise, length, start):
    expected = np.take(noise, np.arange(start, start + length), axis=0, mode="wrap")
    np.testing.assert_array_equal(extended(noise, length, start, border="periodic"), expected)


@pytest.mark.parametrize(("length", "start"), [(40, 0), (60, 0), (60, -13), (25, 7), (25, -9), (25, 30), (200, -70)])
def test_blend_reflects_and_repeats_the_border_pixel(extended, noise, length, start):
    wide = np.pad(noise, ((300, 300), (0, 0)), mode="symmetric")
    np.testing.assert_array_equal(extended(noise, length, start), wide[300 + start : 300 + start + length])


@pytest.mark.parametrize(("length", "start"), [(30, 4), (30, -5), (60, -8)])
def test_the_taper_ends_where_the_start_begins(extended, noise, length, start):
    taper = 10
    wide = np.pad(noise, ((300, 300), (0, 0)), mode="symmetric")
    after = wide[300 + start + length - taper : 300 + start + length]
    before = wide[300 + start - taper : 300 + start]
    share = (extended(noise, length, start, taper=taper)[-taper:] - after) / (before - after)
    # One increasing weight for all channels; differences of noise are often small, hence the tolerance.
    np.testing.assert_allclose(share, np.repeat(share[:, :1], 3, axis=1), atol=1e-3)
    assert np.all(np.diff(share, axis=0) > 0)


@pytest.mark.parametrize("starts", [[], [11], [-6, 0, 11, 30, 100, -100]])
@pytest.mark.parametrize("border", ["blend", "periodic"])
def test_columns_are_cut_like_rows(kernels, extended, noise, starts, border):
    columns = np.full((2, 3, N + 5), np.nan, np.complex64)
    columns[..., :N] = np.stack([noise.T, 2 * noise.T]) * np.complex64(1 - 2j)
    slabs = np.empty((len(starts), 2, 3, 30), np.complex64)
    kernels.cut_lines(columns, N, np.array(starts, np.int32), fade(8), border == "periodic", slabs)
    for start, slab in zip(starts, slabs, strict=True):
        row = extended(noise, 30, start, taper=8, border=border).T * (1 - 2j)
        # Two roundings of values of order 1.
        np.testing.assert_allclose(slab, [row, 2 * row], atol=1e-6)


@pytest.mark.parametrize("border", ["blend", "periodic"])
def test_columns_are_extended_in_place(kernels, border):
    columns = complex_noise(2, 3, N + 20)
    elsewhere = np.empty_like(columns)
    start = np.zeros(1, np.int32)
    kernels.cut_lines(columns, N, start, fade(20), border == "periodic", elsewhere[None])
    kernels.cut_lines(columns, N, start, fade(20), border == "periodic", columns[None])
    np.testing.assert_array_equal(columns, elsewhere)


@pytest.mark.parametrize(("height", "count"), [(1, 1), (7, 3), (16, 16), (33, 24), (100, 13)])
def test_rows_become_columns_and_come_back(kernels, height, count):
    rows = complex_noise(3, height + 2, count + 9)
    columns = np.full((3, count, height + 3), 7, np.complex64)
    kernels.rows_to_columns(rows, 5, height, columns)
    np.testing.assert_array_equal(columns[..., :height], rows[:, :height, 5 : 5 + count].swapaxes(1, 2))
    np.testing.assert_array_equal(columns[..., height:], 7)
    back = np.full_like(rows, 7)
    kernels.columns_to_rows(columns, back, 5, height)
    place = np.s_[:, :height, 5 : 5 + count]
    np.testing.assert_array_equal(back[place], rows[place])
    back[place] = 7
    np.testing.assert_array_equal(back, 7)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_not_finite_is_reported_where_it_is_read(kernels, bad, channels):
    picture = np.zeros((3, 50, channels), np.float32)
    picture[1, 20, -1] = bad
    line = np.empty((channels, 1, 10), np.float32)
    seen = [kernels.picture_to_lines(picture, 1, 1, start, fade(0), False, line) for start in (0, 10, 11, 20, 21)]
    assert seen == [True, True, False, False, True]
    assert kernels.picture_to_lines(picture, 0, 1, 15, fade(0), False, line)
    # Values that are huge but finite, and the smallest ones.
    picture[1, 20] = [[3e38], [1e-45]][channels == 1]
    assert kernels.picture_to_lines(picture, 1, 1, 15, fade(0), False, line)
