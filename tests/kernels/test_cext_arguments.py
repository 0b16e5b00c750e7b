"""Arguments of the C extension: an array of any wrong form is refused, in every function, and none is changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rsdeblur.kernels import native, rowwise, why_pure
from rsdeblur.kernels.rowwise import LANES

pytestmark = pytest.mark.skipif(native is None, reason=f"no C extension: {why_pure}")

Array = np.ndarray[Any, Any]


def floats(*shape: int) -> Array:
    return np.ones(shape, np.float32)


def pairs(*shape: int) -> Array:
    return np.ones(shape, np.complex64)


def integers(values: list[Any]) -> Array:
    return np.array(values, np.int32)


def model() -> list[Array]:
    """Return the arrays of a rowwise model: six rows, each of which sees the latent row of the same number."""
    index = [integers(values) for values in ([0, 3], [3, 6], [0, 0])]
    start = np.cumsum([0, *[int(row == latent) for latent in range(3) for row in range(3)] * 2]).astype(np.int32)
    return [*index, start, np.zeros(6, np.int32), floats(6), rowwise.phase_table(0, 0, 1, 50)]


# Arguments of a valid call, and positions of the arrays that it writes.
CALLS: dict[str, tuple[Callable[[], list[Any]], set[int]]] = {
    "multiply": (lambda: [pairs(3, 2, 5, 6), pairs(3, 5, 6)], {0}),
    "blend": (lambda: [pairs(2, 5, 9), pairs(3, 2, 5, 6), floats(3, 4), integers(3 * [[1, 2, 4]])], {0}),
    "unpair": (lambda: [pairs(3, 2, 5), pairs(5), pairs(3, 4, 8), 1], {2}),
    "pair": (lambda: [pairs(3, 4, 8), 1, pairs(5), pairs(3, 2, 5)], {3}),
    "picture_to_lines": (lambda: [floats(4, 12, 3), 1, 2, -3, floats(4), False, floats(3, 4, 20)], {6}),
    "lines_to_picture": (lambda: [floats(3, 4, 20), 2, 1, floats(5), 3, True, floats(4, 12, 3), 1], {6}),
    "rows_to_columns": (lambda: [pairs(3, 9, 30), 2, 5, pairs(3, 16, 9)], {3}),
    "columns_to_rows": (lambda: [pairs(3, 16, 9), pairs(3, 9, 30), 2, 5], {1}),
    "cut_lines": (lambda: [pairs(3, 16, 9), 7, integers([1, 3]), floats(4), True, pairs(2, 3, 16, 12)], {5}),
    "shrunk_grad_adjoint": (
        lambda: [floats(6, 5, 3), 1, 4, 0.1, floats(9), False, floats(10, 3, 7), floats(6, 5, 3)],
        {6, 7},
    ),
    "shrunk_derivatives_adjoint": (
        lambda: [floats(6, 5, 3), 1, 4, 0.1, floats(9), False, floats(10, 3, 7), floats(6, 5, 3)],
        {6, 7},
    ),
    "rowwise_forward": (lambda: [*model(), floats(2, 6, 2, LANES), floats(2, 6, 2, LANES), floats(4000)], {7, 9}),
    "rowwise_adjoint": (lambda: [*model(), floats(2, 6, 2, LANES), floats(2, 6, 2, LANES), floats(4000)], {8, 9}),
    "rowwise_solve": (
        lambda: [*model(), floats(2, 6, 2, LANES), floats(2, 6, 2, LANES), floats(4000), floats(3, LANES)],
        {8, 9},
    ),
    "rowwise_assemble": (lambda: [*model(), floats(864), floats(4000), 6], {7, 8}),
    "rowwise_solve_assembled": (
        lambda: [*model(), floats(864), floats(2, 6, 2, LANES), floats(4000), floats(3, LANES), 6],
        {8, 9},
    ),
    "rowwise_workspace": (lambda: [*model(), 6, 1], set()),
    "rowwise_assembled_size": (lambda: [*model(), 6], set()),
}


def arrays(name: str) -> list[int]:
    """Return the places of the arrays among the arguments of a call."""
    return [place for place, argument in enumerate(CALLS[name][0]()) if isinstance(argument, np.ndarray)]


def misaligned(array: Array) -> Array:
    memory = np.zeros(array.nbytes + 1, np.uint8)
    shifted = memory[1:].view(array.dtype).reshape(array.shape)
    shifted[...] = array
    return shifted


def apart(array: Array) -> Array:
    """Return the same values with gaps between them."""
    wide = np.repeat(array[..., None], 2, axis=-1)
    return wide[..., 0]


def read_only(array: Array) -> Array:
    copy = array.copy()
    copy.setflags(write=False)
    return copy


WRONG: dict[str, Callable[[Array], Any]] = {
    "wider": lambda a: a.astype({"f": np.float64, "c": np.complex128, "i": np.int64}[a.dtype.kind]),
    "narrower": lambda a: a.real.copy() if a.dtype.kind == "c" else a.astype(f"{a.dtype.kind}2"),
    "of another kind": lambda a: a.view(np.int32 if a.dtype.kind == "f" else np.float32),
    "unsigned or bytes": lambda a: a.view(np.uint32 if a.dtype.kind == "i" else np.uint8),
    "of other byte order": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "objects": lambda a: a.astype(object),
    "of one dimension more": lambda a: a[None],
    "of one dimension less": lambda a: a[0] if a.ndim > 1 else a[0, ...],
    "with gaps": apart,
    "reversed": lambda a: a[::-1] if len(a) > 1 else apart(a),
    "in Fortran's order": lambda a: np.asfortranarray(a) if a.ndim > 1 and min(a.shape[:2]) > 1 else apart(a),
    "broadcast": lambda a: np.broadcast_to(a.flat[0], a.shape) if a.size > 1 else apart(a),
    "misaligned": misaligned,
    "no array": lambda a: a.tolist(),
    "nothing": lambda a: None,
}


def test_the_calls_are_right() -> None:
    for name, (arguments, _) in CALLS.items():
        getattr(native, name)(*arguments())


def refused(name: str, arguments: list[Any], case: str) -> None:
    before = [argument.copy() if isinstance(argument, np.ndarray) else argument for argument in arguments]
    message = ""
    try:
        getattr(native, name)(*arguments)
    except (TypeError, ValueError) as error:
        message = str(error)
    assert message, f"not refused: {case}"
    for old, new in zip(before, arguments, strict=True):
        np.testing.assert_array_equal(new, old, err_msg=case)


@pytest.mark.parametrize("name", CALLS)
def test_arrays_in_a_wrong_form(name: str) -> None:
    for place in arrays(name):
        for wrong, change in WRONG.items():
            arguments = CALLS[name][0]()
            arguments[place] = change(arguments[place])
            refused(name, arguments, f"argument {place} {wrong}")


@pytest.mark.parametrize("name", CALLS)
def test_what_is_written_must_be_writable(name: str) -> None:
    arguments, written = CALLS[name]
    for place in arrays(name):
        given = arguments()
        given[place] = read_only(given[place])
        if place in written:
            refused(name, given, f"argument {place}")
        else:
            getattr(native, name)(*given)


@pytest.mark.parametrize("name", CALLS)
def test_what_is_written_must_overlap_nothing(name: str) -> None:
    arguments, written = CALLS[name]
    for place in arrays(name):
        for target in written - {place}:
            given = arguments()
            one, other = given[place], given[target]
            # Both in the same memory, the shorter one at the end of the longer.
            memory = np.ones(max(one.nbytes, other.nbytes), np.uint8)
            for i, array in ((place, one), (target, other)):
                given[i] = memory[len(memory) - array.nbytes :].view(array.dtype).reshape(array.shape)
                given[i][...] = array if i == place else given[i]
            refused(name, given, f"arguments {place} and {target}")


@pytest.mark.parametrize("name", CALLS)
def test_numbers_that_are_none_or_too_large(name: str) -> None:
    arguments = CALLS[name][0]
    for place, argument in enumerate(arguments()):
        if isinstance(argument, int) and not isinstance(argument, bool):
            for wrong in (2**62, -(2**62), 2**63, 2**200, 1.5, "1", None):
                given = arguments()
                given[place] = wrong
                if name in ("rowwise_workspace", "rowwise_assembled_size"):
                    # `solve` may be any number, and a larger picture contains all rows of the model.
                    given[place] = {7: -1, 8: None}[place]
                with pytest.raises((TypeError, ValueError, OverflowError)):
                    getattr(native, name)(*given)
    with pytest.raises(TypeError):
        getattr(native, name)(*arguments()[:-1])
