"""Readable NumPy oracles of kernels: spectra."""

import numpy as np
from numpy.typing import NDArray

from rsdeblur.types import FloatArray


def fit_cells_numpy(
    measured: FloatArray,
    blurred: FloatArray,
    error: FloatArray,
    cells: NDArray[np.intp],
    floors: FloatArray,
    squared: float,
    gains: FloatArray,
    sums: FloatArray,
) -> None:
    def total(power: FloatArray) -> FloatArray:
        return np.add.reduceat(power, cells[:-1], axis=1)

    def known() -> FloatArray:
        return 1 / (np.repeat(gains, sizes, axis=1) * scene + np.repeat(floors, sizes, axis=1))

    scene, sizes = blurred + squared * error, np.diff(cells)
    gains *= total(measured * known() ** 2 * scene) / total(known() * scene)
    surprise = measured * known() ** 2
    sums[:2] = total(surprise), total(known())
    sums[2:] = gains * total(surprise * error), gains * total(known() * error)
