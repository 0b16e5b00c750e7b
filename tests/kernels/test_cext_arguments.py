"""Arguments of the C extension: what would lead beyond an array is refused by every function; none is changed."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rsdeblur.kernels import native, why_pure
from rsdeblur.kernels.rowwise import LANES, RowModel
from rsdeblur.kernels.whittle import Tiles
from tests.kernels.test_twins import ARGUMENTS, Arrays

pytestmark = pytest.mark.skipif(native is None, reason=f"no C extension: {why_pure}")

Array = np.ndarray[Any, Any]
# Functions, and positions of the arrays that each writes.
CALLS: dict[str, set[int]] = {
    **{"add_normal": {4, 5}, "solve_normal": {8}, "fit_tiles": {8, 9, 10, 11}},
    **{"multiply": {0}, "blend": {0}, "unpair": {2}, "pair": {3}, "picture_to_lines": {6}, "lines_to_picture": {6}},
    **{"rows_to_columns": {3}, "columns_to_rows": {1}, "cut_lines": {5}},
    **{"shrunk_grad_adjoint": {6, 7}, "shrunk_derivatives_adjoint": {6, 7}},
    **{"rowwise_forward": {7, 9}, "rowwise_adjoint": {8, 9}, "rowwise_solve": {8, 9}, "rowwise_assemble": {7, 8}},
    **{"rowwise_solve_assembled": {8, 9}, "rowwise_workspace": set(), "rowwise_assembled_size": set()},
}


def valid(name: str) -> list[Any]:
    """Return the arguments of a valid call."""
    twin = name.removeprefix("rowwise_").replace("workspace", "workspace_size")
    given = ARGUMENTS[twin](Arrays(1.0))
    return [part for each in given for part in (each if isinstance(each, RowModel | Tiles) else [each])]


def floats(*shape: int) -> Array:
    return np.ones(shape, np.float32)


def pairs(*shape: int) -> Array:
    return np.ones(shape, np.complex64)


def integers(values: list[Any]) -> Array:
    return np.array(values, np.int32)


def arrays(name: str) -> list[int]:
    """Return the places of the arrays among the arguments of a call."""
    return [place for place, argument in enumerate(valid(name)) if isinstance(argument, np.ndarray)]


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
    "wider": lambda a: a.astype({"f": "d", "d": "g", "F": "D", "i": "q"}[a.dtype.char]),
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
    assert CALLS.keys() == {name for name in dir(native) if name[0] != "_" and name != "SIMD"}
    for name in CALLS:
        getattr(native, name)(*valid(name))


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
            arguments = valid(name)
            arguments[place] = change(arguments[place])
            refused(name, arguments, f"argument {place} {wrong}")


@pytest.mark.parametrize("name", CALLS)
def test_what_is_written_must_be_writable(name: str) -> None:
    for place in arrays(name):
        given = valid(name)
        given[place] = read_only(given[place])
        if place in CALLS[name]:
            refused(name, given, f"argument {place}")
        else:
            getattr(native, name)(*given)


@pytest.mark.parametrize("name", CALLS)
def test_what_is_written_must_overlap_nothing(name: str) -> None:
    for place in arrays(name):
        for target in CALLS[name] - {place}:
            given = valid(name)
            one, other = given[place], given[target]
            # Both in the same memory, the shorter one at the end of the longer.
            memory = np.ones(max(one.nbytes, other.nbytes), np.uint8)
            for i, array in ((place, one), (target, other)):
                given[i] = memory[len(memory) - array.nbytes :].view(array.dtype).reshape(array.shape)
                given[i][...] = array if i == place else given[i]
            refused(name, given, f"arguments {place} and {target}")


@pytest.mark.parametrize("name", CALLS)
def test_numbers_that_are_none_or_too_large(name: str) -> None:
    for place, argument in enumerate(valid(name)):
        if isinstance(argument, int) and not isinstance(argument, bool):
            for wrong in (2**62, -(2**62), 2**63, 2**200, 1.5, "1", None):
                given = valid(name)
                given[place] = wrong
                if name in ("rowwise_workspace", "rowwise_assembled_size"):
                    # `solve` may be any number, and a larger picture contains all rows of the model.
                    given[place] = {7: -1, 8: None}[place]
                with pytest.raises((TypeError, ValueError, OverflowError)):
                    getattr(native, name)(*given)
    with pytest.raises(TypeError):
        getattr(native, name)(*valid(name)[:-1])


def in_place(first: int) -> dict[int, Any]:
    """Return arguments of `cut_lines` that extend columns where they are."""
    columns = pairs(3, 16, 9)
    return {0: columns, 1: 5, 2: integers([first]), 5: columns[None]}


# What is replaced in a valid call, by another value or by a function of the value.
Change = dict[int, Any]
MODEL: list[tuple[Change, str]] = [
    *(({place: lambda a: a[:-1].copy()}, "same length") for place in (0, 5)),
    ({3: lambda a: a[:-1].copy()}, "tap_start"),
    *(({place: change}, "inconsistent") for place, change in (
        (3, lambda a: a[::-1].copy()), (4, lambda a: a + 1), (4, lambda a: a - 1),
        (2, lambda a: a + 1), (2, lambda a: a - 100))),
    *(({0: change, 1: change}, "inconsistent") for change in (lambda a: a - 1, lambda a: a + 1)),
    *(({9: floats(10)}, "workspace"), ({8: lambda a: a[:, :-1].copy()}, "rows per block")),
    ({6: lambda a: a[:, :, :8].copy()}, "table"),
]  # fmt: skip
MISUSE: list[tuple[str, Change, str]] = [
    *(("multiply", {1: pairs(*shape)}, "responses") for shape in ((3, 4, 6), (2, 5, 6))),
    *(("add_normal", {place: pairs(2, 3, 5, 5)}, "shape") for place in (0, 4)),
    *(("add_normal", change, "shape") for change in ({1: pairs(2, 4, 6)}, {5: floats(1, 5, 6)})),
    *(("solve_normal", change, words) for change, words in (
        *(({place: pairs(2, 2, 5, 6)}, "shape") for place in (0, 8)), ({1: floats(2, 6, 5)}, "shape"),
        *(({place: floats(4)}, "must have a value") for place in (2, 3, 5)))),
    *(("fit_tiles", change, words) for change, words in (
        *(({place: floats(4, 8)}, "same shape") for place in (0, 1)), ({2: floats(2, 8)}, "same shape"),
        *(({3: integers(places)}, "positions outside") for places in ([0, 1, 2, 0], [0, 1, -1, 0])),
        *(({4: integers(sectors)}, "positions outside") for sectors in ([0, 2, 5, 10], [-1, 2, 5, 9], [0, 5, 2, 9])),
        ({3: integers([0])}, "each tile"), ({4: integers([0, 9])}, "each tile"), ({4: integers([])}, "two values"),
        ({5: np.ones((4, 1, 2))}, "each level"), ({6: np.ones(0)}, "two values"), ({11: np.ones((3, 2))}, "workspace"),
        *(({place: np.ones(3)}, "each tile") for place in (8, 10)), ({9: np.ones((4, 2))}, "each tile"))),
    *(("blend", {3: integers([span] * 3)}, "spans") for span in (
        *((-1, 0, 4), (6, 0, 4), (0, -1, 4), (0, 3, 4), (0, 0, 5), (0, 0, -1)), 3 * (2**31 - 1,), 3 * (-(2**31),))),
    *(("blend", {3: integers(spans)}, "spans") for spans in ([(0, 0, 4)] * 2, [(0, 0)] * 3)),
    ("blend", {0: pairs(1, 5, 9)}, "channels"),
    *((name, {place: value}, words) for name, *changes in (("unpair", 1, 2, 3), ("pair", 2, 0, 1))
      for place, value, words in zip((changes[0], changes[1], changes[1], changes[2]),
        (pairs(4), pairs(1, 4, 8), pairs(3, 4, 5), 3), ("turns", "channels", "spectra", "top"), strict=True)),
    *(("picture_to_lines", change, words) for change, words in (
        ({2: 4}, "rows from top"), ({1: -1}, "rows from top"), ({0: floats(3, 4, 20)}, "channels"),
        ({3: 2**62}, "overflows"), ({4: floats(21)}, "overflows"))),
    *(("lines_to_picture", change, words) for change, words in (
        ({4: 8}, "first on"), ({2: 16}, "offset"), ({7: 3}, "rows from top"))),
    *(("rows_to_columns", change, words) for change, words in (({1: 22}, "columns from first"), ({2: 10}, "height"))),
    ("columns_to_rows", {2: -1}, "columns from first"),
    *(("cut_lines", change, words) for change, words in (
        ({1: 10}, "height"), (in_place(1), "starts at 0"), (in_place(0) | {1: 6}, "fades only"),
        ({2: integers([0])}, "each slab"), ({0: pairs(3, 9, 30)}, "channels and columns"))),
    *((name, *row) for name in ("rowwise_solve", "rowwise_solve_assembled") for row in MODEL),
    ("rowwise_solve", {8: lambda a: a[:1].copy()}, "same channels"),
    ("rowwise_solve", {7: lambda a: a[:, :-3].copy()}, "inconsistent"),
    *(("rowwise_solve_assembled", change, words) for change, words in (
        ({7: floats(32)}, "normal"), ({10: floats(2, LANES)}, "penalty"), ({11: 3}, "incons"), ({11: -1}, "rows"))),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "words"), MISUSE)
def test_what_lies_outside_is_refused(name: str, change: Change, words: str) -> None:
    arguments = valid(name)
    for place, value in change.items():
        arguments[place] = value(arguments[place]) if callable(value) else value
    with pytest.raises(ValueError, match=words):
        getattr(native, name)(*arguments)
