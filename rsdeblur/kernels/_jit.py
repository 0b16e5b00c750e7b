"""Numba's compiler with a cache that never fails: where it cannot be read or written, functions are compiled again."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    """Cache that ignores damaged files and a full disk; with Numba's own, they are errors at every start."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a compiled function, or None if the cache has none that can be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling damaged data may raise anything
            # A damaged index would prevent a new one.
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled function, unless the cache cannot be written."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator `numba.njit(**options)`, with a cache on disk if a folder for it is writable."""

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        # Raised where no folder is writable, neither the package's nor the user's.
        with contextlib.suppress(RuntimeError):
            dispatcher._cache = _Cache(function)
        return dispatcher

    return compiled
