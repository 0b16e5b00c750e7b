"""Memory of large arrays: aligned, and used again by processes that do the same work many times."""

import ctypes
import math
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Alignment of arrays, bytes: a cache line, and the widest value of SIMD.
ALIGNMENT = 64


def keep() -> None:
    """Let the C library keep the memory that this process frees, where that is glibc.

    The system clears every page that it hands out, which takes as long as several passes over an array.
    """
    with suppress(OSError, AttributeError, TypeError):  # TypeError: Windows
        library = ctypes.CDLL(None)
        # M_MMAP_MAX: no blocks are requested separately, which go back when they are freed.
        library.mallopt(-4, 0)
        # M_TRIM_THRESHOLD: bytes at the end of the heap that are kept.
        library.mallopt(-1, 2**31 - 1)


def empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """Return an uninitialised array that is aligned for SIMD."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    block = np.empty(size + ALIGNMENT, np.uint8)
    first = -block.ctypes.data % ALIGNMENT
    array: NDArray[Any] = block[first : first + size].view(dtype).reshape(shape)
    return array
