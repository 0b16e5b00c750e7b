"""Shrinkage of several pictures in one undecimated Haar frame, and their sum.

The pictures are restorations of one blurred picture, from the least to the most regularised. Level j of the frame takes
means and differences of pixels that are 2^j apart. Each of its coefficients is multiplied by

    c0 + c1 e / (e + t1^2 s^2) + c2 e / (e + t2^2 s^2)

where e is the sum of the squares of the 3 x 3 coefficients around it in the next more regularised picture, and s^2 the
sum that the noise of that picture has there. The frame is tight: with factors of 1 the pictures come back.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit

LEVELS = 4
# Pixels around the picture that the result depends on, on each side.
HALO = 1 << LEVELS
# The t of the gates above, squared.
GATES = np.array([1.0, 2.5], dtype=np.float32) ** 2
# Differences across, down and along both axes. The first two share their factors.
ORIENTATIONS = 3
# Planes of the workspace, besides one for each picture: sums of all bands, sums of all means, bands and energies of a
# level, four planes of spare rows, two for the way back.
WORK = 3 * LEVELS + 13


# Loops run over parts of rows, without computed indices, so that they become SIMD code.
@njit(nogil=True)
def _square(values, out):
    for i in range(len(out)):
        out[i] = values[i] * values[i]


@njit(nogil=True)
def _add_three(first, second, third, out):
    for i in range(len(out)):
        out[i] = first[i] + second[i] + third[i]


@njit(nogil=True)
def _sums_of_squares(band, first, work, energy):
    """Fill the inside of `energy` with sums over 3 x 3 squared values of `band`, whose values start at `first`."""
    height, width = band.shape
    squares, sums = work[:3], work[3, 0]
    for y in range(first, height):
        _square(band[y, first:], squares[y % 3, 0, first:])
        if y >= first + 2:
            # From the top down in every block, so that blocks that overlap agree in every bit.
            top, middle = squares[(y - 2) % 3, 0, first:], squares[(y - 1) % 3, 0, first:]
            _add_three(top, middle, squares[y % 3, 0, first:], sums[first:])
            _add_three(sums[first:], sums[first + 1 :], sums[first + 2 :], energy[y - 1, first + 1 : width - 1])


@njit(nogil=True)
def _split_row(here, left, above, corner, across, down, both, mean):
    quarter = np.float32(0.25)
    for i in range(len(mean)):
        a, b, c, d = here[i], left[i], above[i], corner[i]
        across[i] = quarter * ((a - b) + (c - d))
        down[i] = quarter * ((a + b) - (c + d))
        both[i] = quarter * ((a - b) - (c - d))
        mean[i] = quarter * ((a + b) + (c + d))


@njit(nogil=True)
def _split(low, first, step, bands, following):
    """Split `low`, whose values start at `first`, into three `bands` of differences and the means `following`."""
    now, before, width = first + step, first, low.shape[1]
    for y in range(now, low.shape[0]):
        here, above = low[y], low[y - step]
        _split_row(
            *(here[now:], here[before : width - step], above[now:], above[before : width - step]),
            *(bands[0, y, now:], bands[1, y, now:], bands[2, y, now:], following[y, now:]),
        )


@njit(nogil=True)
def _join_row(means, across, down, both, sign, out):
    """Add what a row of coefficients gives to a row of the result; `sign` is -1 for the row below."""
    quarter = np.float32(0.25)
    step = len(means) - len(out)
    m, a, d, b = means[step:], across[step:], down[step:], both[step:]
    for i in range(len(out)):
        here = (means[i] + m[i]) + (across[i] - a[i])
        out[i] += quarter * (here + sign * ((down[i] + d[i]) + (both[i] - b[i])))


@njit(nogil=True)
def _join(low, bands, height, width, step, out):
    """Fill the first `height` x `width` values of `out` with the adjoint of :func:`_split`."""
    for y in range(height):
        out[y, :width] = np.float32(0.0)
        for z, sign in ((y, np.float32(1.0)), (y + step, np.float32(-1.0))):
            stop = width + step
            _join_row(
                *(low[z, :stop], bands[0, z, :stop], bands[1, z, :stop], bands[2, z, :stop]),
                *(sign, out[y, :width]),
            )


@njit(nogil=True, error_model="numpy")  # a check for division by zero would prevent SIMD code
def _gate_row(values, energy, soft, hard, factors, out):
    plain, least, most = factors[0], factors[1], factors[2]
    for i in range(len(out)):
        e = energy[i]
        out[i] += values[i] * (plain + least * (e / (e + soft)) + most * (e / (e + hard)))


@njit(nogil=True)
def _gate(band, energy, noise, factors, first, out):
    """Add `band` times its factors to `out`."""
    height, width = band.shape
    tiny = np.float32(1e-30)
    soft, hard = GATES[0] * noise + tiny, GATES[1] * noise + tiny
    for y in range(first, height - 1):
        inside = slice(first, width - 1)
        _gate_row(band[y, inside], energy[y, inside], soft, hard, factors, out[y, inside])


@njit(nogil=True)
def _add_means(means, factor, out):
    for i in range(len(out)):
        out[i] += factor * means[i]


@njit(nogil=True)
def combine(planes, variances, low_factors, factors, work, out):
    """Shrink all planes in the frame and add them up in a block `out` (h - 2 HALO, w - 2 HALO).

    - `planes` (K, h, w): one channel of each picture, least regularised first, with `HALO` px around the block. They
      are overwritten.
    - `variances` (K, LEVELS, 3): the s^2, nine times the variance of the noise of a coefficient.
    - `low_factors` (K,): factors of the means that are left at the last level.
    - `factors` (K, LEVELS, 3, 3): c0, c1 and c2 of each level and orientation.
    - `work` (WORK + K, h, w): workspace.
    """
    count, height, width = planes.shape
    sums, bands, energies, spare = work[: 3 * LEVELS], work[-12:-9], work[-9:-6], work[-6:-2]
    even, odd, total = work[-count - 13 : -13], planes, work[-13]
    sums[:] = np.float32(0.0)
    total[:] = np.float32(0.0)
    for level in range(LEVELS):
        step, first = 1 << level, (1 << level) - 1
        low, following = (odd, even) if level % 2 == 0 else (even, odd)
        for k in range(count - 1, -1, -1):
            _split(low[k], first, step, bands, following[k])
            # Until the energies of this picture replace them, those of the next more regularised one are there.
            reference = min(k + 1, count - 1)
            for o in range(ORIENTATIONS):
                if k == count - 1:
                    _sums_of_squares(bands[o], first + step, spare, energies[o])
                noise = variances[reference, level, o]
                _gate(bands[o], energies[o], noise, factors[k, level, o], first + step + 1, sums[3 * level + o])
                if 0 < k < count - 1:
                    _sums_of_squares(bands[o], first + step, spare, energies[o])
    for k in range(count):
        for y in range(HALO - 1, height):
            _add_means(planes[k, y, HALO - 1 :], low_factors[k], total[y, HALO - 1 :])
    for level in range(LEVELS - 1, -1, -1):
        # Values beyond would need coefficients beyond the block.
        step, target = 1 << level, work[-2 + level % 2]
        rows, columns = height - HALO + step - 1, width - HALO + step - 1
        _join(total, sums[3 * level : 3 * level + 3], rows, columns, step, target)
        total = target
    # Loops: an assignment of arrays, with its error message, takes Numba seconds more to compile.
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            out[y, x] = total[HALO + y, HALO + x]


@njit(nogil=True)
def cut_block(picture, rows, columns, mix, planes):
    """Fill `planes` (C, h, w) with the channels of a block, mixed by the matrix `mix` (C, C).

    The block consists of the `rows` (h,) and `columns` (w,) of `picture` (H, W, C).
    """
    for y in range(len(rows)):
        source = picture[rows[y]]
        for c in range(len(planes)):
            line = planes[c, y]
            for x in range(len(columns)):
                pixel = source[columns[x]]
                value = np.float32(0.0)
                for d in range(len(pixel)):
                    value += mix[c, d] * pixel[d]
                line[x] = value


@njit(nogil=True)
def put_block(planes, mix, out):
    """Fill a block `out` (h, w, C) with the `planes` (C, h, w), mixed back by the transpose of `mix`."""
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            for d in range(len(planes)):
                value = np.float32(0.0)
                for c in range(len(planes)):
                    value += mix[c, d] * planes[c, y, x]
                out[y, x, d] = value
