"""The recorded bits of three results: sums on every machine, digests on the one that recorded them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks import bits
from rsdeblur.kernels import native

PAGE = Path(__file__).resolve().parents[2] / "docs" / "developer" / "reliability.md"


def recorded(path: str) -> list[bits.Result]:
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in PAGE.read_text().splitlines()]
    return [
        bits.Result(name, digest.strip("`"), tuple(map(float, sums)))
        for name, kernels, digest, *sums in (row for row in cells if len(row) == 3 + bits.SUMS)
        if kernels == path
    ]


# One process for each path serves both tests.
of_path = cache(bits.of_path)


@pytest.mark.parametrize("path", bits.PATHS)
def test_results_are_as_recorded(path: str) -> None:
    if path == "C" and native is None:
        pytest.skip("no C extension")
    found, expected = of_path(path), recorded(path)
    assert [result.name for result in found] == [result.name for result in expected]
    np.testing.assert_allclose([r.sums for r in found], [r.sums for r in expected], atol=bits.TOLERANCE)
    if " ".join(bits.recorded_on().split()) in " ".join(PAGE.read_text().split()):
        assert [result.digest for result in found] == [result.digest for result in expected]


def test_threads_and_processes_give_the_same_bits() -> None:
    here = bits.results(threads=1)
    assert here == bits.results(threads=3)
    assert here == of_path("C" if native else "NumPy")
