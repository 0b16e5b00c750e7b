"""Memory of large arrays, which a process may use again.

The system clears every page that it hands out, which takes as long as several passes over the array. A process that
does the same work many times, as for the photos of a batch or the frames of a video, saves that by keeping what it
frees.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Alignment of arrays, bytes: a cache line, and the widest value of SIMD.
ALIGNMENT = 64
# Smaller arrays have memory that the C library keeps anyway, bytes.
LEAST_KEPT = 2**20
# How many times as large as an array its memory may be.
LARGER = 4


class _Store:
    """Blocks of memory that no array uses, by their sizes. Single operations on a deque need no lock."""

    def __init__(self) -> None:
        self._idle: defaultdict[int, deque[NDArray[np.uint8]]] = defaultdict(deque)

    def lend(self, size: int) -> NDArray[np.uint8]:
        """Return an array of so many bytes, whose memory comes back when the last view of it is gone."""
        # Sizes vary from frame to frame: four sizes of blocks per power of two, of which larger ones do as well.
        step = 2 ** (size.bit_length() - 3)
        least = -(-size // step) * step + ALIGNMENT
        for room in sorted(room for room in self._idle if least <= room <= LARGER * least):
            with suppress(IndexError):
                return _Loan.of(self._idle[room].pop(), size, self._idle[room])
        self._free(least)
        return _Loan.of(np.empty(least, np.uint8), size, self._idle[least])

    def _free(self, size: int) -> None:
        """Give idle blocks of so many bytes back to the system: no more is kept than was once in use."""
        for room in sorted(self._idle, reverse=True):
            with suppress(IndexError):
                while size > 0:
                    size -= self._idle[room].pop().nbytes


class _Loan:
    """Memory of an array and all its views: a part of `block`, which goes `home` when the last of them is gone."""

    def __init__(self, block: NDArray[np.uint8], size: int, home: deque[NDArray[np.uint8]]) -> None:
        self._block, self._home = block, home
        aligned = block.ctypes.data + -block.ctypes.data % ALIGNMENT
        self.__array_interface__ = {"version": 3, "typestr": "|u1", "shape": (size,), "data": (aligned, False)}

    @classmethod
    def of(cls, block: NDArray[np.uint8], size: int, home: deque[NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """Return an array of `size` bytes that holds the loan."""
        return np.asarray(cls(block, size, home))

    def __del__(self) -> None:
        self._home.append(self._block)


_store: _Store | None = None


@contextmanager
def kept() -> Iterator[None]:
    """Until the end of the block, keep the memory that :func:`empty` gave and use it again, in the whole process."""
    global _store
    before, _store = _store, _store or _Store()
    try:
        yield
    finally:
        _store = before


def empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return an uninitialised array that is aligned for SIMD."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if _store is not None and size >= LEAST_KEPT:
        memory = _store.lend(size)
    else:
        block = np.empty(size + ALIGNMENT, np.uint8)
        first = -block.ctypes.data % ALIGNMENT
        memory = block[first : first + size]
    array: NDArray[Any] = memory.view(dtype).reshape(shape)
    return array
