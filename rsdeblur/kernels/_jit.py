"""Numba's compiler, for which a damaged, full or unwritable cache is no more than a reason to compile again."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    """Numba's own raises what unpickling a damaged file raises, for ever, and fails where a disk is full."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a compiled function, or None if there is none that can be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling damaged data may raise anything
            # An index that cannot be read is in the way of a new one.
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function if that is possible."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return `numba.njit(**options)` with a cache on disk, if there is a folder for it."""

    def compiled(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        # No folder is writable, neither the package's nor the user's.
        with contextlib.suppress(RuntimeError):
            dispatcher._cache = _Cache(function)
        return dispatcher

    return compiled
