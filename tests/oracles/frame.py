"""Readable NumPy oracles of `rsdeblur.kernels.frame`."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels.frame import GATES, HALO, LEVELS, ORIENTATIONS
from rsdeblur.types import Float32Array

# Signs of the differences across, down, along both axes, and of the means: for the pixel, its left neighbour, the one
# above and the one above left.
SIGNS = ((1, -1, 1, -1), (1, 1, -1, -1), (1, -1, -1, 1), (1, 1, 1, 1))


def terms(
    planes: NDArray[np.floating], variances: NDArray[np.floating]
) -> Iterator[tuple[tuple[int, ...], NDArray[np.floating]]]:
    """Yield the pictures that :func:`combine` adds up, without their factors, and the index of the factor of each.

    The index is (k,) for the means and (k, level, orientation, number of the factor) for a difference. Pictures are
    those of the whole `planes`; they are right at least `HALO` px from their ends.
    """
    count = len(planes)
    energies: dict[tuple[int, int], NDArray[np.floating]] = {}
    for k in range(count - 1, -1, -1):
        low = planes[k]
        reference = min(k + 1, count - 1)
        for level in range(LEVELS):
            *bands, following = _split_numpy(low, 1 << level)
            for o, band in enumerate(bands):
                own = _sums_of_squares_numpy(band)
                energy = energies.get((level, o), own)
                energies[level, o] = own
                yield (k, level, o, 0), _back_numpy(band, level, o)
                for n, gate in enumerate(GATES, 1):
                    share = energy / (energy + gate * variances[reference, level, o] + 1e-30)
                    yield (k, level, o, n), _back_numpy(band * share, level, o)
            low = following
        yield (k,), _back_numpy(low, LEVELS - 1, ORIENTATIONS)


def combine_numpy(
    planes: Float32Array, variances: Float32Array, low_factors: Float32Array, factors: Float32Array
) -> Float32Array:
    out: Float32Array = np.zeros_like(planes[0, HALO:-HALO, HALO:-HALO])
    for index, term in terms(planes, variances):
        out += (low_factors if len(index) == 1 else factors)[index] * term[HALO:-HALO, HALO:-HALO]
    return out


def _split_numpy(low: NDArray[np.floating], step: int) -> list[NDArray[np.floating]]:
    parts = [np.roll(low, (down * step, across * step), (0, 1)) for down in (0, 1) for across in (0, 1)]
    return [np.tensordot(np.array(signs, low.dtype) / 4, parts, 1) for signs in SIGNS]


def _back_numpy(band: NDArray[np.floating], level: int, orientation: int) -> NDArray[np.floating]:
    """Return the picture of a band: the adjoint of the splits that lead to it."""
    for step, signs in [(1 << level, SIGNS[orientation])] + [(1 << n, SIGNS[-1]) for n in range(level - 1, -1, -1)]:
        shifts = [(-down * step, -across * step) for down in (0, 1) for across in (0, 1)]
        band = np.tensordot(np.array(signs, band.dtype) / 4, [np.roll(band, shift, (0, 1)) for shift in shifts], 1)
    return band


def _sums_of_squares_numpy(band: NDArray[np.floating]) -> NDArray[np.floating]:
    rows = np.sum([np.roll(band**2, n, 0) for n in (-1, 0, 1)], axis=0)
    sums: NDArray[np.floating] = np.sum([np.roll(rows, n, 1) for n in (-1, 0, 1)], axis=0)
    return sums
