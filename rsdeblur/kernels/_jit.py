"""Numba's compiler, which compiles again where its cache on disk is damaged, full or unwritable."""

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import InputError

try:
    import numba
    from numba.core.event import TimingListener, install_listener
except ValueError as error:
    names = ", ".join(name for name in sorted(os.environ) if name.startswith("NUMBA_")) or "NUMBA_*"
    raise InputError(f"Numba cannot be loaded: {error} Correct or unset the environment variable {names}") from error

Scalar = TypeVar("Scalar", bound=np.generic)


class _ToleratedCache:
    """Numba's cache of a function on disk, whose faults only cost another compilation.

    Numba's own raises at every later call what unpickling a damaged file raises, and fails where a disk is full.
    """

    def __init__(self, cache: Any) -> None:
        self._cache = cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, *arguments: Any) -> Any:
        """Return a compiled function, or None if there is none that can be read."""
        try:
            return self._cache.load_overload(*arguments)
        except Exception:  # unpickling damaged data may raise anything
            # A damaged index would prevent a new one.
            with contextlib.suppress(OSError):
                self._cache.flush()
            return None

    def save_overload(self, *arguments: Any) -> None:
        """Keep a compiled function if that is possible."""
        with contextlib.suppress(OSError):
            self._cache.save_overload(*arguments)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator `numba.njit(**options)`, with a cache on disk if a folder for it is writable."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            dispatcher = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # neither the package's folder nor the user's is writable
            return numba.njit(**options)(function)
        # Private to Numba: a version without it keeps its own cache.
        if hasattr(dispatcher, "_cache"):
            dispatcher._cache = _ToleratedCache(dispatcher._cache)
        return dispatcher

    return compiled


class _Compilation(TimingListener):
    def __init__(self, begin: Callable[[], None]) -> None:
        super().__init__()
        self._begin = begin

    def on_start(self, event: Any) -> None:
        """Call the function that was given, the first time."""
        begin, self._begin = self._begin, lambda: None
        begin()
        super().on_start(event)


@contextlib.contextmanager
def compilation(begin: Callable[[], None] = lambda: None) -> Iterator[Callable[[], float]]:
    """Call `begin` when the first function is compiled in the block; yield a function that returns the time of all, s.

    Numba compiles one function at a time, whatever the thread.
    """
    timer = _Compilation(begin)
    with install_listener("numba:compile", timer):
        yield lambda: timer.duration if timer.done else 0.0


def read_only(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return a read-only view of an array, or a C-contiguous copy of one in another order.

    Numba compiles a kernel anew for arrays that may be written and for those that may not, which takes a second.
    """
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
