"""Everything rsdeblur raises or warns with.

A caller who catches :class:`RsdeblurError` catches every refusal of the package; the subclasses say which
door refused. Each message says what was wanted, what came and what to do.
"""

from __future__ import annotations

# Characters. The longest of our own, which lists all formats, has 1000; a path may have 4096.
LONGEST_MESSAGE = 8000


class RsdeblurError(Exception):
    """Base of all errors raised by rsdeblur."""


class InputError(RsdeblurError, ValueError):
    """An argument has a wrong shape, type or value."""


class FileFormatError(RsdeblurError, ValueError):
    """A file is empty, truncated, of another kind, or holds an impossible value; names the file and the line."""

    def __init__(self, message: str) -> None:
        # Part of a message may be what stands in the file.
        super().__init__(message if len(message) <= LONGEST_MESSAGE else message[:LONGEST_MESSAGE] + "...")


class OutputError(RsdeblurError, OSError):
    """An output file cannot be written, or exists and may not be replaced."""


class CoverageError(RsdeblurError, ValueError):
    """The gyro log does not describe the whole exposure."""


class ClockError(CoverageError):
    """The gyro log and the exposure are on unrelated clocks."""


class GapError(CoverageError):
    """The gyro log has a hole inside the exposure."""


class RsdeblurWarning(UserWarning):
    """Input that is accepted although it looks wrong."""
