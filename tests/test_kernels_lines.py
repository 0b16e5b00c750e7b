"""Laws of cutting lines, on the Numba kernels and on their NumPy twins.

The picture is left alone, and what goes on beyond it meets itself smoothly.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rsdeblur.border import fade
from rsdeblur.kernels import lines

N = 40


@pytest.fixture(params=["numba", "numpy"])
def kernels(request):
    names = ("picture_to_lines", "cut_slabs", "rows_to_columns", "columns_to_rows", "lines_to_picture")
    end = "" if request.param == "numba" else "_numpy"
    return SimpleNamespace(**{name: getattr(lines, name + end) for name in names})


@pytest.fixture
def extended(kernels):
    """Cut a tile of `length` at `start` out of the rows of `source` (N, C)."""

    def cut(source, length, start, *, taper=0, border="blend"):
        out = np.full((source.shape[1], 1, length), np.nan, dtype=np.float32)
        kernels.picture_to_lines(source[None].copy(), 0, 1, start, fade(taper), border == "periodic", out)
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


@pytest.mark.parametrize("border", ["blend", "periodic"])
@pytest.mark.parametrize(("length", "start", "taper"), [(60, -8, 12), (52, 0, 12), (30, 5, 8), (30, -10, 8)])
def test_inside_is_untouched(extended, noise, border, length, start, taper):
    out = extended(noise, length, start, taper=taper, border=border)
    inside = [k for k in range(length - taper) if 0 <= start + k < N]
    np.testing.assert_array_equal(out[inside], noise[start + np.array(inside)])


@pytest.mark.parametrize(("length", "start", "taper"), [(64, -6, 16), (56, 0, 16), (36, 10, 16)])
def test_ends_of_a_smooth_picture_meet_smoothly(extended, length, start, taper):
    x = np.linspace(0.0, 1.0, N)
    # A ramp and a curve: as they are, their ends are 0.9 apart.
    picture = (0.9 * x + 0.1 * np.sin(7 * x)).astype(np.float32)[:, None]
    out = extended(picture, length, start, taper=taper)[:, 0]
    steps = np.abs(np.diff(np.append(out, out[0])))
    # The fade crosses at most the whole range with the slope of half a cosine period over `taper`, and comes on top of
    # the picture's own steps on both sides.
    allowed = 0.9 * np.pi / 2 / taper + 2 * np.abs(np.diff(picture[:, 0])).max()
    assert steps[-1] <= 2 * np.abs(np.diff(picture[:, 0])).max()
    assert steps.max() <= allowed


def test_without_a_taper_the_ends_do_not_meet(extended):
    # The law above can fail.
    picture = np.linspace(0.0, 0.9, N, dtype=np.float32)[:, None]
    out = extended(picture, 36, 0)[:, 0]
    assert abs(out[-1] - out[0]) > 0.7


def test_the_taper_fades_from_one_end_into_the_other(extended):
    low, high = np.zeros((20, 1), np.float32), np.ones((20, 1), np.float32)
    out = extended(np.concatenate([low, high]), 52, 0, taper=12)[:, 0]
    # After the last, bright row the continuation falls to the dark first row.
    end = out[40:]
    assert np.all(np.diff(end) < 0)
    assert 0.95 < end[0] < 1
    assert 0 < end[-1] < 0.05
    np.testing.assert_allclose(end + end[::-1], 1, atol=1e-6)


@pytest.mark.parametrize(("length", "start"), [(30, 4), (30, -5), (60, -8)])
def test_the_taper_ends_where_the_start_begins(extended, noise, length, start):
    taper = 10
    wide = np.pad(noise, ((300, 300), (0, 0)), mode="symmetric")
    after = wide[300 + start + length - taper : 300 + start + length]
    before = wide[300 + start - taper : 300 + start]
    share = (extended(noise, length, start, taper=taper)[-taper:] - after) / (before - after)
    # One rising share for all channels; differences of noise are often small, hence the tolerance.
    np.testing.assert_allclose(share, np.repeat(share[:, :1], 3, axis=1), atol=1e-3)
    assert np.all(np.diff(share, axis=0) > 0)


def test_slabs_are_cut_like_rows(kernels, extended, noise):
    """Columns are complex and many tiles are cut at once; each is what a row would give."""
    columns = np.full((2, 8, N + 5), np.nan, np.complex64)
    columns[:, 4:7, :N] = np.stack([noise.T, 2 * noise.T]) * np.complex64(1 - 2j)
    starts = np.array([-6, 0, 11])
    slabs = np.empty((4, 2, 3, 30), np.complex64)
    kernels.cut_slabs(columns, 4, N, starts, fade(8), False, slabs)
    for slab, start in zip(slabs[:3], starts, strict=True):
        row = extended(noise, 30, start, taper=8).T * (1 - 2j)
        # Two roundings of values of order 1.
        np.testing.assert_allclose(slab, [row, 2 * row], atol=1e-6)


@pytest.mark.parametrize(("shape", "rows"), [((1, 1, 1), 1), ((3, 16, 33), 16), ((2, 16, 8), 7)])
def test_rows_become_columns_and_come_back(kernels, shape, rows):
    rng = np.random.default_rng(0)
    spectra = (rng.random(shape) + 1j * rng.random(shape)).astype(np.complex64)
    columns = np.full((shape[0], shape[2] + 3, 40), 7, np.complex64)
    kernels.rows_to_columns(spectra, rows, columns, 5)
    place = np.s_[:, : shape[2], 5 : 5 + rows]
    np.testing.assert_array_equal(columns[place], spectra[:, :rows].swapaxes(1, 2))
    back = np.zeros_like(spectra)
    kernels.columns_to_rows(columns, 5, back, rows)
    np.testing.assert_array_equal(back[:, :rows], spectra[:, :rows])
    np.testing.assert_array_equal(back[:, rows:], 0)
    columns[place] = 7
    np.testing.assert_array_equal(columns, 7)


@pytest.mark.parametrize("add", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_lines_go_back_to_their_place(kernels, noise, add, channels):
    picture = np.full((4, 12, channels), 0.5, np.float32)
    source = np.stack([noise.T, noise.T[::-1], noise.T], axis=1)[:channels].copy()
    weights = np.linspace(0.1, 1, 7, dtype=np.float32)
    kernels.lines_to_picture(source, 2, 5, weights, 4, add, picture, 1)
    expected = np.full((4, 12, channels), 0.5)
    values = weights[:, None] * np.moveaxis(source, 0, -1)[:2, 5:12]
    expected[1:3, 4:11] = values + 0.5 if add else values
    # One product and one sum of values of order 1.
    np.testing.assert_allclose(picture, expected, atol=1e-6)
