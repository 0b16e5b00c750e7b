"""Advice to install an optional package."""

from __future__ import annotations


def missing(need: str, extra: str) -> str:
    """Return the message that something needs a package, and how to install it with the `extra` of this project."""
    # The package is on no index.
    return f"{need}; run in the folder of rsdeblur's source code: pip install '.[{extra}]'"
