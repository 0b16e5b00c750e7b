"""Memory of processes that do the same work again and again."""

from __future__ import annotations

import ctypes
from contextlib import suppress

# Parameters of glibc's mallopt (malloc.h), and a value beyond the size of all arrays.
TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
MOST = 2**31 - 1


def keep_freed_memory() -> None:
    """Let this process keep memory that it frees, for its next arrays of that size; only glibc can.

    Otherwise the system takes large arrays back, and clears all of their pages when the next ones are filled.
    """
    with suppress(AttributeError, OSError, TypeError):  # another C library, or Windows
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(MMAP_THRESHOLD, MOST)
        mallopt(TRIM_THRESHOLD, MOST)
