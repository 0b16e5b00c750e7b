"""Exceptions and warnings of rsdeblur.

:class:`RsdeblurError` is the base class of every exception that the package raises on purpose. A message says what is
wrong, what was found and what to do.
"""


class RsdeblurError(Exception):
    """Base of all errors raised by rsdeblur."""


class InputError(RsdeblurError, ValueError):
    """An argument has a wrong shape, type or value.

    Parameters
    ----------
    message : str
        What is wrong, and what to do.
    argument : str, optional
        Name of the argument at fault, where the message does not begin with it.
    """

    def __init__(self, message: str, argument: str | None = None) -> None:
        super().__init__(message)
        self.argument = argument


class FileFormatError(RsdeblurError, ValueError):
    """A file is empty, truncated, of another format, or contains an invalid value.

    Parameters
    ----------
    message : str
        Text that names the file and, in text files, the line; cut off after 8000 characters.
    """

    def __init__(self, message: str) -> None:
        # A message may quote a damaged file, at any length; those of the package have 1000 characters, a path 4096.
        super().__init__(message if len(message) <= 8000 else message[:8000] + "...")


class OutputError(RsdeblurError, OSError):
    """An output file cannot be written, or it exists and replacing it was not allowed."""


class CoverageError(RsdeblurError, ValueError):
    """The gyro log does not describe the whole exposure."""


class ClockError(CoverageError):
    """The gyro log and the exposure are on unrelated clocks."""


class GapError(CoverageError):
    """The gyro log has a gap inside the exposure."""


class RsdeblurWarning(UserWarning):
    """Input that is accepted although it looks wrong."""
