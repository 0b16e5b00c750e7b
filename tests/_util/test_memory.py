"""Memory of large arrays: aligned, used again within `kept` only when no view of it is left."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur._util.memory import ALIGNMENT, LEAST_KEPT, empty, kept

FLOATS = LEAST_KEPT // 4


def address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


@pytest.mark.parametrize("shape", [(), (0,), (3, 5), (FLOATS,), (3, FLOATS - 1)])
def test_arrays_are_aligned_and_writable(shape):
    for array in [empty(shape, np.float32), *within_kept(shape)]:
        assert (array.shape, array.dtype) == (shape, np.float32)
        assert array.size == 0 or address(array) % ALIGNMENT == 0
        array[...] = 1.0
        assert np.all(array == 1.0)


def within_kept(shape):
    with kept():
        # The second one has the memory of the first, if that was large.
        for _ in range(2):
            yield empty(shape, np.float32)


def test_memory_is_used_again_after_its_last_view():
    with kept():
        first = empty((2 * FLOATS,), np.float32)
        place, part = address(first), first.reshape(2, -1)[1, ::2]
        del first
        second = empty((2 * FLOATS,), np.float32)
        assert address(second) != place
        del part
        # A little smaller is near enough, and of another type.
        third = empty((FLOATS - 1,), np.complex64)
        assert address(third) == place


def test_arrays_in_use_do_not_share_memory():
    with kept():
        arrays = [empty((FLOATS + n,), np.float32) for n in range(8)]
        for n, array in enumerate(arrays):
            array.fill(n)
        assert all(np.all(array == n) for n, array in enumerate(arrays))


def test_arrays_outlive_the_block():
    with kept():
        array = empty((FLOATS,), np.float32)
        array.fill(1.0)
    others = [empty((FLOATS,), np.float32) for _ in range(8)]
    for other in others:
        other.fill(2.0)
    assert np.all(array == 1.0)


def test_a_block_within_a_block_uses_its_memory():
    with kept():
        array = empty((FLOATS,), np.float32)
        place = address(array)
        del array
        with kept():
            again = empty((FLOATS,), np.float32)
            assert address(again) == place


def test_no_more_is_kept_than_was_once_in_use(monkeypatch):
    sizes = []

    def new(size, dtype):
        sizes.append(size)
        return np.zeros(size, dtype)

    monkeypatch.setattr("rsdeblur._util.memory.np.empty", new)
    with kept():
        large = [empty((16 * FLOATS,), np.float32) for _ in range(2)]
        del large
        # A little smaller: the memory of a large one does.
        smaller = empty((15 * FLOATS,), np.float32)
        del smaller
        assert len(sizes) == 2
        # Much smaller: one large block is freed, and the other one is used again.
        small = empty((2 * FLOATS,), np.float32)
        large = [empty((16 * FLOATS,), np.float32) for _ in range(2)]
        assert len(sizes) == 4
        del small, large
