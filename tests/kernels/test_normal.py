"""The kernels of the normal equations against their twins."""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels import normal
from tests.oracles.normal import add_normal_numpy, solve_normal_numpy


def test_twins_agree() -> None:
    rng = np.random.default_rng(5)
    shape, f = (2, 3, 4, 10), np.float32

    def spectra(*sizes: int) -> np.ndarray:
        return (rng.normal(size=sizes) + 1j * rng.normal(size=sizes)).astype(np.complex64)

    pictures, pull = [spectra(*shape) for _ in range(2)], spectra(*shape)
    otfs = [spectra(2, 4, 10) for _ in range(2)]
    across, down = rng.random(4, dtype=np.float32), rng.random(10, dtype=np.float32)
    results = []
    for add, solve in (
        (normal.add_normal, normal.solve_normal),
        (add_normal_numpy, solve_normal_numpy),
    ):
        # What the sums held before the first picture does not count.
        signal, power, out = np.full(shape, np.nan, np.complex64), np.full((2, 4, 10), np.nan, f), pull.copy()
        for n, (picture, otf) in enumerate(zip(pictures, otfs, strict=True)):
            add(picture, otf, f(0.5), n == 0, signal, power)
        solve(signal, power, across, down, f(0.01), (f(0.1), f(0.3), f(0.05)), f(0.2), f(0.5), out)
        results.append(out)
    # A handful of float32 roundings.
    np.testing.assert_allclose(*results, rtol=1e-5)
