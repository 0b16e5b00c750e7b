"""Decoders of strangers' files that no public fuzzing covers, and the environment variable that switches them off."""

from __future__ import annotations

import os

VARIABLE = "RSDEBLUR_BLOCK_UNTRUSTED"


class Blocked(ValueError):
    """A file that only a decoder that is switched off can read; users see the message unchanged."""


def blocked() -> bool:
    """Whether decoders that no public fuzzing covers are switched off."""
    return os.environ.get(VARIABLE, "") not in ("", "0")


def check(content: str, library: str) -> None:
    """Raise `Blocked` if `library`, which no public fuzzing covers and which decodes `content`, is switched off."""
    if blocked():
        raise Blocked(
            f"{content} would be decoded by {library}, which no public fuzzing covers, and the environment variable "
            f"{VARIABLE} forbids that: convert the file where it may be trusted, or unset the variable"
        )
