"""Locks on open files, which the system releases when their process ends.

Windows and some network file systems have none: there, nothing keeps two runs apart.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from rsdeblur.errors import OutputError

try:
    import fcntl
except ImportError:  # Windows
    HAS_LOCKS = False
else:
    HAS_LOCKS = True


def open_itself(path: str, flags: int) -> int:
    """Open a file, for `open`, but neither wait for the other end of a pipe nor follow a link."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0), 0o666)


def lock(file: BinaryIO) -> None:
    """Lock an open file until it is closed.

    Raises
    ------
    BlockingIOError
        If it is locked through another opening, by this process or another one.
    OSError
        If the system or the file system has no locks.
    """
    if not HAS_LOCKS:
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))
    fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def locked(path: Path, busy: str) -> Iterator[None]:
    """Make a file if needed and lock it while the block runs, where that is possible.

    Raises
    ------
    OutputError
        With the message `busy`, if it is locked.
    OSError
        If it cannot be made.
    """
    with open(path, "ab", opener=open_itself) as file:
        try:
            lock(file)
        except BlockingIOError:
            raise OutputError(busy) from None
        except OSError:
            pass
        yield
