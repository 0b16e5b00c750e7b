"""PyAV, or the advice to install it."""

from __future__ import annotations

from rsdeblur.errors import InputError

try:
    import av
except ModuleNotFoundError:
    raise InputError("videos need PyAV; install it with: pip install 'rsdeblur[video]'") from None

__all__ = ["av"]
