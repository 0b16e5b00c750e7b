"""PyAV, or the advice to install it."""

from __future__ import annotations

from rsdeblur._util.extras import missing
from rsdeblur.errors import InputError

try:
    import av
except ModuleNotFoundError:
    raise InputError(missing("videos need PyAV", "video")) from None

__all__ = ["av"]
