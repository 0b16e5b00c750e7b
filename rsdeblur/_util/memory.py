"""Memory of large arrays, which a process may use again.

The system clears every page that it hands out, which takes as long as several passes over the array. A process that
does the same work many times, as for the frames of a video, saves that by keeping what it frees. Telling the C library
to do so (`mallopt`) would hand such memory to encoders as well, some of which then write other bits.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Alignment of arrays, bytes: a cache line, and the widest value of SIMD.
ALIGNMENT = 64
# Smaller arrays have memory that the C library keeps anyway, bytes.
LEAST_KEPT = 2**20
# Blocks that no array uses, by their sizes. Single operations on a deque need no lock.
Blocks = defaultdict[int, deque[NDArray[np.uint8]]]


class _Loan:
    """Memory of an array and all its views, which goes back into `blocks` when the last of them is gone."""

    def __init__(self, size: int, blocks: Blocks) -> None:
        # Sizes vary a little from frame to frame: four sizes of blocks per power of two.
        step = 2 ** (size.bit_length() - 3)
        room = -(-size // step) * step + ALIGNMENT
        self._home = blocks[room]
        try:
            self._block = self._home.pop()
        except IndexError:
            self._block = np.empty(room, np.uint8)
        address = self._block.ctypes.data
        aligned = address + -address % ALIGNMENT
        self.__array_interface__ = {"version": 3, "typestr": "|u1", "shape": (size,), "data": (aligned, False)}

    def __del__(self) -> None:
        self._home.append(self._block)


_kept: Blocks | None = None


@contextmanager
def kept() -> Iterator[None]:
    """Until the end of the block, keep the memory that :func:`empty` gave and use it again, in the whole process."""
    global _kept
    before, _kept = _kept, defaultdict(deque) if _kept is None else _kept
    try:
        yield
    finally:
        _kept = before


def empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return an uninitialised array that is aligned for SIMD."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if _kept is not None and size >= LEAST_KEPT:
        memory = np.asarray(_Loan(size, _kept))
    else:
        block = np.empty(size + ALIGNMENT, np.uint8)
        first = -block.ctypes.data % ALIGNMENT
        memory = block[first : first + size]
    array: NDArray[Any] = memory.view(dtype).reshape(shape)
    return array
