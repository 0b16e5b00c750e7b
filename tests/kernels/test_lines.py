"""Laws of moving lines and of the spectral kernels, on the C code and on its NumPy twins."""

import os
from types import SimpleNamespace

import numpy as np
import pytest

from rsdeblur.deconv.tiling import fade
from rsdeblur.kernels import lines, native, spectral, why_pure

N = 40
MOVING = ("picture_to_lines", "lines_to_picture", "rows_to_columns", "columns_to_rows", "cut_lines")
NAMES = ("multiply", "blend", "unpair", "pair")
# Values are of order 1 and each result is one complex product and one sum: a few roundings of 6e-8.
TOLERANCE = {"rtol": 0, "atol": 1e-6}

needs_native = pytest.mark.skipif(native is None, reason=f"no C extension: {why_pure}")


@pytest.fixture(params=[pytest.param("native", marks=needs_native), "numpy"])
def kernels(request):
    if request.param == "native":
        return native
    places = {**dict.fromkeys(MOVING, lines), **dict.fromkeys(NAMES, spectral)}
    return SimpleNamespace(**{name: getattr(module, name + "_numpy") for name, module in places.items()})


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
@pytest.mark.parametrize(("border", "mode"), [("periodic", "wrap"), ("blend", "symmetric")])
def test_a_picture_repeats_or_is_reflected_with_its_border_pixel(extended, noise, border, mode, length, start):
    wide = np.pad(noise, ((300, 300), (0, 0)), mode=mode)
    np.testing.assert_array_equal(extended(noise, length, start, border=border), wide[300 + start :][:length])


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


@pytest.mark.skipif(os.environ.get("RSDEBLUR_REQUIRE_CEXT", "0") != "1", reason="RSDEBLUR_REQUIRE_CEXT is not 1")
def test_c_code_is_in_use():
    assert native is not None, why_pure
    assert all(getattr(spectral, name) is getattr(native, name) for name in NAMES)


@pytest.mark.parametrize("n", [0, 1, 6])
def test_blend_adds_weighted_positions_and_touches_no_other(kernels, n):
    accumulator, slabs = complex_noise(3, 5, 11), complex_noise(2, 3, 5, 9)
    weights = np.random.default_rng(2).uniform(-1, 1, (2, 6)).astype(np.float32)
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
