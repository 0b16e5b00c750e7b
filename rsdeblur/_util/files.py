"""Reading files that are files: a pipe or a device would keep its reader waiting for ever, or never end."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from rsdeblur.errors import FileFormatError


def open_file(path: str | os.PathLike[str], what: str) -> BinaryIO:
    """Open a regular file for reading; `what` says in messages what it should hold.

    Raises
    ------
    FileFormatError
        If there is none, it must not be read, or it is a folder, a pipe or a device.
    """
    try:
        file = open(path, "rb", opener=_open_at_once)  # noqa: SIM115 (the caller closes it)
    except (OSError, ValueError) as error:
        raise _unreadable(path, what, error) from error
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise FileFormatError(f"{path}: cannot read the {what}: it is a pipe or a device; save what it gives first")
    return file


def read_file(path: str | os.PathLike[str], what: str, start: int = 0, size: int = -1) -> bytes:
    """Return `size` bytes of a regular file from `start` on, all by default; `what` and errors as in `open_file`."""
    with open_file(path, what) as file:
        try:
            file.seek(start)
            return file.read(size)
        except OSError as error:
            raise _unreadable(path, what, error) from error


def _open_at_once(path: str, flags: int) -> int:
    # Opening a pipe would wait for its writer.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _unreadable(path: str | os.PathLike[str], what: str, error: OSError | ValueError) -> FileFormatError:
    # Names that no file can have, with NUL or lone surrogates, are no OSError.
    reason = error.strerror if isinstance(error, OSError) else None
    return FileFormatError(f"{Path(path)}: cannot read the {what}: {reason or error}")
