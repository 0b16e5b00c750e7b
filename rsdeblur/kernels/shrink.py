"""Shrinkage of a picture's derivatives: the Numba kernels and their NumPy twins.

D takes forward differences. Beyond the last row and column they are zero or, if `periodic`, wrap around. All channels
of a pixel are one vector, which is shortened as a whole. Rows are split into planes, one per channel, and loops run
over whole planes, without branches or computed indices, so that they become SIMD code.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit
from rsdeblur.types import Float32Array

# Divisors of the second derivatives, and factors of what shrinking leaves of the first ones, of the second ones and of
# the mixed one: half of the divisors' inverse squares (:func:`shrunk_derivatives_adjoint`).
BENDING, MIXED = np.float32(2.0), np.float32(np.sqrt(2.0))
FIRST, SECOND, TWIST = np.float32(0.5), np.float32(0.125), np.float32(0.25)


@njit(nogil=True, inline="always")
def _read(row, planes):
    """Copy a row (W, C) to one plane per channel (C, W)."""
    for c in range(len(planes)):
        plane = planes[c]
        for x in range(len(plane)):
            plane[x] = row[x, c]


@njit(nogil=True, inline="always")
def _differ(minuends, subtrahends, out):
    for c in range(len(out)):
        minuend, subtrahend, difference = minuends[c], subtrahends[c], out[c]
        for x in range(len(difference)):
            difference[x] = minuend[x] - subtrahend[x]


@njit(nogil=True, inline="always")
def _differ_across(values, periodic, out):
    """Compute horizontal differences from the second place of `out` on; its first one receives the last of them."""
    width = values.shape[1]
    _differ(values[:, 1:], values[:, : width - 1], out[:, 1:width])
    for c in range(len(out)):
        out[c, width] = values[c, 0] - values[c, width - 1] if periodic else np.float32(0.0)
    _repeat_last(out)


@njit(nogil=True, inline="always")
def _repeat_last(values):
    # A loop: an assignment of arrays, with its error message, takes Numba seconds more to compile.
    for c in range(len(values)):
        values[c, 0] = values[c, values.shape[1] - 1]


@njit(nogil=True)
def _square(values, add, squares):
    """Compute the squared magnitudes (W) of vectors (C, W), or add them."""
    for c in range(len(values)):
        plane = values[c]
        for x in range(len(squares)):
            before = squares[x] if c > 0 or add else np.float32(0.0)
            squares[x] = before + plane[x] * plane[x]


@njit(nogil=True, error_model="numpy")  # a check for division by zero would prevent SIMD code
def _fill_factors(squares, threshold, table):
    """Replace squared magnitudes by the factors by which such vectors are shortened."""
    least, last = threshold * threshold, np.float32(len(table) - 1)
    following = table[1:]
    for x in range(len(squares)):
        place = last * (threshold / np.sqrt(max(squares[x], least)))
        # A comparison with NaN is false, so that NaN is read at 0; of NaN or infinity no integer would be in the table.
        place = place if np.float32(0.0) <= place <= last else np.float32(0.0)
        i = min(np.int32(place), np.int32(len(following) - 1))
        share = table[i] + (place - np.float32(i)) * (following[i] - table[i])
        squares[x] = share if squares[x] > least else np.float32(0.0)


@njit(nogil=True)
def _scale(values, factors):
    for c in range(len(values)):
        plane = values[c]
        for x in range(len(plane)):
            plane[x] *= factors[x]


@njit(nogil=True)
def _shrink(values, threshold, table, factors):
    """Shorten vectors (C, W)."""
    _square(values, False, factors)
    _fill_factors(factors, threshold, table)
    _scale(values, factors)


@njit(nogil=True)
def _write_adjoint(across, above, down, row):
    """Write `D^T` times the parts (C, W) of a row to the picture's row (W, C); `across` begins with a pixel more."""
    for c in range(len(down)):
        horizontal, before, here = across[c], above[c], down[c]
        for x in range(len(here)):
            row[x, c] = horizontal[x] - horizontal[x + 1] + before[x] - here[x]


@njit(nogil=True)
def shrunk_grad_adjoint(picture, top, rows, threshold, table, periodic, out):
    """Compute `D^T w`, where w is the shrunk gradient of `picture`; both directions of a pixel are one vector.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32, C-contiguous
        Values whose gradient is shrunk.
    top, rows : int
        First row to compute, and number of rows.
    threshold : float32
        Gradients up to this magnitude become 0.
    table : ndarray, shape (n,), float32
        Factors by which gradients are shortened, at n evenly spaced values of threshold / magnitude from 0 to 1.
    periodic : bool
        Whether differences wrap around.
    out : ndarray, shape (H, W, C), float32, C-contiguous
        Output; only these rows are written.
    """
    height, width, channels = picture.shape
    # Vertical part of w, in the previous and in the current row; horizontal part.
    above, down = np.zeros((channels, width), np.float32), np.empty((channels, width), np.float32)
    across, factors = np.zeros((channels, width + 1), np.float32), np.empty(width, np.float32)
    here, below = np.empty((channels, width), np.float32), np.empty((channels, width), np.float32)
    first = top - 1 if top > 0 or periodic else 0
    _read(picture[first % height], here)
    for y in range(first, top + rows):
        _read(picture[(y + 1) % height if periodic else min(y + 1, height - 1)], below)
        _differ_across(here, periodic, across)
        _differ(below, here, down)
        _square(across[:, 1:], False, factors)
        _square(down, True, factors)
        _fill_factors(factors, threshold, table)
        _scale(across[:, 1:], factors)
        _scale(down, factors)
        if y >= top:
            _repeat_last(across)
            _write_adjoint(across, above, down, out[y])
        above, down = down, above
        here, below = below, here


@njit(nogil=True, inline="always")
def _bend(above, here, below, out):
    """Compute the second difference, -1, 2, -1."""
    for c in range(len(out)):
        before, middle, after, bend = above[c], here[c], below[c], out[c]
        for x in range(len(bend)):
            bend[x] = (middle[x] - before[x]) - (after[x] - middle[x])


@njit(nogil=True, inline="always")
def _add_flux(before, after, twist, slope):
    """Make `FIRST slope + SECOND (after - before) + TWIST D_x^T twist` of `slope`; `twist` begins with a pixel more."""
    for c in range(len(slope)):
        flux, start, end, mixed = slope[c], before[c], after[c], twist[c]
        for x in range(len(flux)):
            flux[x] = FIRST * flux[x] + SECOND * (end[x] - start[x]) + TWIST * (mixed[x] - mixed[x + 1])


@njit(nogil=True, inline="always")
def _add_flux_across(bend, slope):
    """Make `FIRST slope + SECOND D_x bend` of `slope`; `bend` ends with a pixel more."""
    for c in range(len(slope)):
        flux, values = slope[c], bend[c]
        for x in range(len(flux)):
            flux[x] = FIRST * flux[x] + SECOND * (values[x + 1] - values[x])


@njit(nogil=True)
def shrunk_derivatives_adjoint(picture, top, rows, threshold, table, periodic, out):
    """Compute `sum_k D_k^T w_k / 2` over five derivatives D_k, where w_k is the shrunk derivative of `picture`.

    The derivatives are `D_x u`, `D_y u`, `D_x^T D_x u / 2`, `D_y^T D_y u / 2` and `D_x D_y u / sqrt(2)`, and each of
    them is shortened alone. They have about equal noise. `sum_k D_k^T D_k` is `D^T D + (D^T D)^2 / 4`.

    Parameters
    ----------
    picture, top, rows, threshold, table, periodic, out
        See :func:`shrunk_grad_adjoint`.
    """
    height, width, channels = picture.shape
    shape, longer = (channels, width), (channels, width + 1)
    # Three rows of the picture; D_y^T D_y u in this row and the next one; fluxes, whose differences are the output.
    here, below, beyond = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.float32)
    bend, next_bend = np.empty(shape, np.float32), np.empty(shape, np.float32)
    above, flux, factors = np.zeros(shape, np.float32), np.empty(shape, np.float32), np.empty(width, np.float32)
    across, twist, bow = np.zeros(longer, np.float32), np.zeros(longer, np.float32), np.zeros(longer, np.float32)
    bending, mixed = BENDING * threshold, MIXED * threshold
    first, end = (top - 1, height + rows) if periodic else (max(top - 1, 0), height - 1)
    _read(picture[first % height], here)
    _read(picture[min(first + 1, end) % height], below)
    _read(picture[(first - 1) % height if first > 0 or periodic else 0], beyond)
    _bend(beyond, here, below, bend)
    _shrink(bend, bending, table, factors)
    for y in range(first, top + rows):
        _read(picture[min(y + 2, end) % height], beyond)
        _bend(here, below, beyond, next_bend)
        _shrink(next_bend, bending, table, factors)
        _differ(below, here, flux)
        _differ_across(flux, periodic, twist)
        _shrink(twist[:, 1:], mixed, table, factors)
        _repeat_last(twist)
        _shrink(flux, threshold, table, factors)
        _add_flux(bend, next_bend, twist, flux)
        if y == end:
            _clear(flux)
        if y >= top:
            _differ_across(here, periodic, across)
            _differ(across[:, :width], across[:, 1:], bow[:, :width])
            _shrink(bow[:, :width], bending, table, factors)
            for c in range(channels):
                bow[c, width] = bow[c, 0] if periodic else bow[c, width - 1]
            _shrink(across[:, 1:], threshold, table, factors)
            _add_flux_across(bow, across[:, 1:])
            _repeat_last(across)
            _write_adjoint(across, above, flux, out[y])
        above, flux = flux, above
        bend, next_bend = next_bend, bend
        here, below, beyond = below, beyond, here


@njit(nogil=True)
def _clear(values):
    for c in range(len(values)):
        for x in range(values.shape[1]):
            values[c, x] = np.float32(0.0)


def gradient(picture: Float32Array, *, periodic: bool) -> tuple[Float32Array, Float32Array]:
    """Return the forward differences across and down, both shaped like `picture` (H, W, C)."""
    across, down = (np.roll(picture, -1, axis) - picture for axis in (1, 0))
    if not periodic:
        across[:, -1] = 0
        down[-1] = 0
    return across, down


def _adjoint(differences: Float32Array, axis: int) -> Float32Array:
    """Return D^T times the differences along an axis; without wrapping around, the last ones are zero."""
    result: Float32Array = np.roll(differences, 1, axis) - differences
    return result


def _shrunk(threshold: np.float32, table: Float32Array, *parts: Float32Array) -> list[Float32Array]:
    """Return the parts of vectors, over all channels, shortened."""
    magnitude = np.sqrt(sum((part**2).sum(axis=2, keepdims=True) for part in parts))
    places = threshold / np.maximum(magnitude, threshold)
    factors = np.where(magnitude > threshold, np.interp(places, np.linspace(0, 1, len(table)), table), 0.0)
    return [factors * part for part in parts]


def shrunk_grad_adjoint_numpy(
    picture: Float32Array,
    top: int,
    rows: int,
    threshold: np.float32,
    table: Float32Array,
    periodic: bool,
    out: Float32Array,
) -> None:
    """Readable twin of :func:`shrunk_grad_adjoint`."""
    across, down = _shrunk(threshold, table, *gradient(picture, periodic=periodic))
    out[top : top + rows] = (_adjoint(across, 1) + _adjoint(down, 0))[top : top + rows]


def shrunk_derivatives_adjoint_numpy(
    picture: Float32Array,
    top: int,
    rows: int,
    threshold: np.float32,
    table: Float32Array,
    periodic: bool,
    out: Float32Array,
) -> None:
    """Readable twin of :func:`shrunk_derivatives_adjoint`."""

    def shrunk(derivative: Float32Array, limit: np.float32) -> Float32Array:
        return _shrunk(limit, table, derivative)[0]

    across, down = gradient(picture, periodic=periodic)
    twist = gradient(down, periodic=periodic)[0]
    pull = TWIST * _adjoint(_adjoint(shrunk(twist, MIXED * threshold), 1), 0)
    for axis, slope in ((1, across), (0, down)):
        pull += FIRST * _adjoint(shrunk(slope, threshold), axis)
        # D^T D is symmetric, so it is its own adjoint.
        bend = shrunk(_adjoint(slope, axis), BENDING * threshold)
        pull += SECOND * _adjoint(gradient(bend, periodic=periodic)[1 - axis], axis)
    out[top : top + rows] = pull[top : top + rows]
