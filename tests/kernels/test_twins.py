"""Laws of every kernel: it equals its NumPy twin, and no float leads it out of its arrays, not even NaN.

Reads out of bounds are found by compiling with checks:
``NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(mktemp -d) pytest tests/kernels/test_twins.py``
"""

import importlib
import pkgutil
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

from rsdeblur import kernels
from rsdeblur.kernels import native, why_pure
from rsdeblur.kernels.rowwise import LANES, RowModel
from rsdeblur.kernels.whittle import Tiles
from tests import oracles

Array = np.ndarray[Any, Any]

MODULES, ORACLES = (
    [importlib.import_module(f"{package.__name__}.{m.name}") for m in pkgutil.iter_modules(package.__path__)]
    for package in (kernels, oracles)
)
# Kernels, and what they are compared with: fallbacks of C in the package, or oracles of the tests.
TWINS = {
    name.removesuffix("_numpy"): value
    for module in (*MODULES, *ORACLES)
    for name, value in vars(module).items()
    if name.endswith("_numpy") and name[0] != "_" and value.__module__ == module.__name__
}

FLOATS = (np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45, -1e-45, -0.0, 1.0)
# For arguments in float64, also what overflows or vanishes in float32.
DOUBLES = (*FLOATS, 1e300, -1e300, 5e-324, 2.0**31, 2.0**63, -(2.0**63))
# Values on either side of every array, which no kernel may change.
GUARD, SENTINEL = 64, 7.0


class Arrays:
    """Arrays of one value, for None of all hostile ones at random, for "ordinary" of 0.1 to 1; each between guards."""

    def __init__(self, value: float | str | None) -> None:
        self._value, self._rng = value, np.random.default_rng(0)
        self._memory: list[Array] = []
        self.filled: list[Array] = []

    def _draw(self, values: tuple[float, ...], count: int | None = None) -> Any:
        if self._value == "ordinary":
            return self._rng.uniform(0.1, 1.0, count)
        return self._rng.choice(values, count) if self._value is None else np.full(count or (), self._value)[()]

    def scratch(self, *shape: int) -> Array:
        """Return memory in which a kernel and its twin leave different values."""
        array = self(*shape)
        self.filled.pop()
        return array

    def __call__(self, *shape: int, dtype: type = np.float32) -> Array:
        count = int(np.prod(shape))
        memory = np.full(count + 2 * GUARD, SENTINEL, dtype)
        values = DOUBLES if dtype is np.float64 else FLOATS
        array = memory[GUARD : GUARD + count]
        array[:] = self._draw(values, count)
        if dtype is np.complex64:
            array.imag = self._draw(values, count)
        self._memory.append(memory)
        self.filled.append(array)
        return array.reshape(shape)

    def pairs(self, *shape: int) -> Array:
        return self(*shape, dtype=np.complex64)

    def levels(self, *shape: int) -> Array:
        """Return integers, which frames of videos have."""
        array = self(*shape, dtype=np.uint16)
        array[...] = self._rng.integers(0, 2**16, shape)
        return array

    def number(self) -> np.float32:
        return np.float32(self._draw(FLOATS))

    def check(self) -> None:
        for memory in self._memory:
            assert (memory[:GUARD] == SENTINEL).all()
            assert (memory[-GUARD:] == SENTINEL).all()


def model(arrays: Arrays) -> RowModel:
    """Return a model of six rows, each of which sees the latent row of the same number."""
    index = [np.array(values, np.int32) for values in ([0, 3], [3, 6], [0, 0])]
    start = np.cumsum([0, *[int(row == latent) for latent in range(3) for row in range(3)] * 2]).astype(np.int32)
    return RowModel._make([*index, start, np.zeros(6, np.int32), arrays(6)])


def lanes(arrays: Arrays) -> list[Any]:
    """Return the arguments that the rowwise kernels share."""
    planes = arrays(2, 6, 2, LANES), arrays(2, 6, 2, LANES)
    return [model(arrays), arrays(1, 2, LANES), *planes, arrays.scratch(4000)]


# First frequencies of three directions.
SECTORS = np.array([0, 2, 5, 9], np.int32)


def tiles(arrays: Arrays) -> Tiles:
    """Return four tiles, which two places share."""
    return Tiles(arrays(4, 9), arrays(4, 9), arrays(2, 9), np.array([0, 1, 1, 0], np.int32), SECTORS)


ARGUMENTS: dict[str, Callable[[Arrays], list[Any]]] = {
    "multiply": lambda h: [h.pairs(3, 2, 5, 6), h.pairs(3, 5, 6)],
    "unpair": lambda h: [h.pairs(3, 2, 5), h.pairs(5), h.pairs(3, 4, 8), 1],
    "pair": lambda h: [h.pairs(3, 4, 8), 1, h.pairs(5), h.pairs(3, 2, 5)],
    "blend": lambda h: [h.pairs(2, 5, 9), h.pairs(3, 2, 5, 6), h(3, 4), np.array(3 * [[1, 2, 4]], np.int32)],
    "picture_to_lines": lambda h: [h(4, 12, 3), 1, 2, -3, h(4), False, h(3, 4, 20)],
    "lines_to_picture": lambda h: [h(3, 4, 20), 2, 1, h(5), 3, True, h(4, 12, 3), 1],
    "rows_to_columns": lambda h: [h.pairs(3, 9, 30), 2, 5, h.pairs(3, 16, 9)],
    "columns_to_rows": lambda h: [h.pairs(3, 16, 9), h.pairs(3, 9, 30), 2, 5],
    "cut_lines": lambda h: [h.pairs(3, 16, 9), 7, np.array([1, 3], np.int32), h(4), True, h.pairs(2, 3, 16, 12)],
    "rasterize": lambda h: [h(7, 5, 2, dtype=np.float64), 4, 6],
    "spread": lambda h: [h(7, 2, dtype=np.float64), (1.25, 1.5), h(21, 15, dtype=np.float64)],
    "interpolated": lambda h: [h(7, 5, 2, dtype=np.float64), 8, 9],
    "add_normal": lambda h: [h.pairs(2, 3, 5, 6), h.pairs(2, 5, 6), h.number(), False, h.pairs(2, 3, 5, 6), h(2, 5, 6)],
    "solve_normal": lambda h: [
        *(h.pairs(2, 3, 5, 6), h(2, 5, 6), h(5), h(6)),
        *(h.number(), h(3), h.number(), h.number(), h.pairs(2, 3, 5, 6)),
    ],
    "workspace_size": lambda h: [model(h), h(1, 2, LANES), 6, True],
    "forward": lanes,
    "adjoint": lanes,
    "solve": lambda h: [*lanes(h), h(3, LANES)],
    "assembled_size": lambda h: [model(h), h(1, 2, LANES), 6],
    "assemble": lambda h: [model(h), h(1, 2, LANES), h(3 * 9 * 2 * LANES), h.scratch(4000), 6],
    "solve_assembled": lambda h: [
        *(model(h), h(1, 2, LANES), h(3 * 9 * 2 * LANES), h(2, 6, 2, LANES)),
        *(h.scratch(4000), h(3, LANES), 6),
    ],
    **dict.fromkeys(
        ("shrunk_grad_adjoint", "shrunk_derivatives_adjoint"),
        lambda h: [h(5, 6, 3), 1, 3, h.number(), h(9), False, h.scratch(10, 3, 8), h(5, 6, 3)],
    ),
    "fit_tiles": lambda h: [
        *(tiles(h), h(4, 2, 2, dtype=np.float64), h(2, dtype=np.float64), float(h.number())),
        *(*(h(*shape, dtype=np.float64) for shape in ((4,), (4, 3), (4,))), np.empty((3, 3))),
    ],
    "to_srgb": lambda h: [h(5, 7, 3)],
    "look_up": lambda h: [h(256), np.arange(256, dtype=np.uint8).repeat(2).reshape(16, 32), h(16, 32)],
    "separate": lambda h: [h(5, 7, 3)],
    "join": lambda h: [h(5, 7, 1), h(3, 4, 3), float(h.number()), h(5, 7, 3)],
    "fit_cells": lambda h: [
        *(h(*shape, dtype=np.float64) for shape in ((4, 9), (4, 9), (9,))),
        *(SECTORS, h(4, 3, dtype=np.float64), float(h.number()), h(4, 3, dtype=np.float64)),
        h(4, 4, 3, dtype=np.float64),
    ],
    "average_warps": lambda h: [h(6, 7, 3), h(5, 4, 3, 3, dtype=np.float64), 8],
    "sample": lambda h: [h(6, 7, 3), h(5, 8), h(5, 8)],
    "row_directions": lambda h: [h(5, 3, dtype=np.float64), h(5, dtype=np.float64), h(8, 12, dtype=np.float64)],
    "pinhole_paths": lambda h: [
        *(h(2, 5, 3, 3, dtype=np.float64), h(2, 5, 3, dtype=np.float64), h(2, 3, 3, dtype=np.float64)),
        *(h(2, dtype=np.float64), h(3, dtype=np.float64), h(8, 12, dtype=np.float64), (9.0, 8.0, 2.0, 1.0), 3),
    ],
    "integrated": lambda h: [np.arange(4.0), h(4, 3, dtype=np.float64)],
    "orientations": lambda h: [
        *(h(5, dtype=np.float64), np.arange(4.0), h(4, 3, dtype=np.float64), h(4, 3, 3, dtype=np.float64))
    ],
}


KERNELS = {name: value for module in MODULES for name, value in vars(module).items() if name in ARGUMENTS}
BOTH = pytest.mark.parametrize("found", [KERNELS, TWINS], ids=["fast", "numpy"])


def test_every_kernel_is_tried() -> None:
    assert TWINS.keys() <= ARGUMENTS.keys() == KERNELS.keys()
    compiled = {
        name
        for module in MODULES
        for name, value in vars(module).items()
        if isinstance(value, Dispatcher) and not name.startswith("_")
    }
    assert compiled <= ARGUMENTS.keys()
    in_c = {name for name in dir(native) if native is not None and name[0] != "_" and name != "SIMD"}
    assert {name.removeprefix("rowwise_").replace("workspace", "workspace_size") for name in in_c} <= ARGUMENTS.keys()


# What has laws of its own for both: `test_rowwise.py` and `test_lines.py` solve systems and transform lines.
OWN_LAWS = {"workspace_size", "solve", "pair", "unpair"}
# Absolute tolerances of values of about 1 in float32: a few roundings, or
TOLERANCES = {
    "fit_tiles": 1e-6,  # sums of float32 terms
    "join": 1e-4,  # slopes up to 4, divided by variances down to FLAT
    "rasterize": 2e-3,  # Gauss points across the kinks of the bilinear window
    **dict.fromkeys(("sample", "shrunk_grad_adjoint", "shrunk_derivatives_adjoint"), 1e-5),  # sums of 36 values
}


@pytest.mark.parametrize("name", sorted(TWINS.keys() - OWN_LAWS))
def test_a_kernel_equals_its_twin(name: str) -> None:
    results = []
    for kernel in (KERNELS[name], TWINS[name]):
        arrays = Arrays("ordinary")
        with np.errstate(all="ignore"):
            returned = kernel(*ARGUMENTS[name](arrays))
        arrays.check()
        several = returned if isinstance(returned, tuple) else [] if returned is None else [returned]
        results.append([*map(np.asarray, several), *arrays.filled])
    for ours, twin in zip(*results, strict=True):
        assert ours.dtype == twin.dtype
        assert np.isfinite(twin).all()
        exact = ours.dtype.kind in "ui"
        tolerance = 0 if exact else TOLERANCES.get(name, 1e-9 if ours.dtype == np.float64 else 2e-6)
        np.testing.assert_allclose(ours, twin, rtol=tolerance, atol=tolerance)


@BOTH
@pytest.mark.parametrize("name", ARGUMENTS)
def test_no_float_leads_out_of_bounds(name: str, found: dict[str, Any]) -> None:
    kernel = found.get(name, KERNELS[name])
    if native is None and "assemble" in name:
        pytest.skip(f"no C extension: {why_pure}")
    for value in (None, *DOUBLES):
        arrays = Arrays(value)
        with np.errstate(all="ignore"):
            kernel(*ARGUMENTS[name](arrays))
        arrays.check()


@pytest.mark.parametrize("value", DOUBLES)
@BOTH
def test_a_path_beyond_the_kernel_has_no_kernel(found: dict[str, Any], value: float) -> None:
    """A path that is not within the kernel is neither cut off nor followed for ever."""
    path = np.zeros((1, 3, 2))
    path[0, 1, 0] = value
    drawn = found["rasterize"](path, 2, 2)
    assert np.isfinite(drawn).all() == (abs(value) < 2)


@BOTH
def test_a_rowwise_system_without_a_solution_gives_nan(found: dict[str, Any]) -> None:
    arguments = ARGUMENTS["solve"](Arrays(1.0))
    arguments[5][:] = -3.0  # a negative ridge: not positive definite
    found["solve"](*arguments)
    assert np.isnan(arguments[3]).any()
