"""Inner loops in C, with NumPy functions `name_numpy` where it is missing, or in Numba.

The functions do not check their arguments. `native` is the C extension, or None; then `why_pure` says why. The
environment variable ``RSDEBLUR_PURE=1``, read when this package is imported, turns the extension off.
"""

import os
from collections.abc import Callable
from types import ModuleType
from typing import Any

from rsdeblur._config import CEXT_ABSENT


def _load_native() -> tuple[ModuleType | None, str]:
    if os.environ.get("RSDEBLUR_PURE", "") not in ("", "0"):
        return None, "the environment variable RSDEBLUR_PURE is set"
    if CEXT_ABSENT:
        return None, f"not built: {CEXT_ABSENT}"
    try:
        from rsdeblur import _cext
    except ImportError as error:
        return None, f"built, but it cannot be loaded: {error}"
    return _cext, ""


def unpacked(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return a kernel of the C extension that takes a named tuple, instead of its arrays, and other arguments."""
    return lambda arrays, *arguments: kernel(*arrays, *arguments)


native, why_pure = _load_native()
