"""Atomic writing: a reader sees the old file or the new one, never a part of either."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import BinaryIO

from rsdeblur._util.files import checked_path
from rsdeblur.errors import OutputError

# Characters of the file's name that begin the name of the temporary file, which must not exceed 255 bytes; a character
# has up to 4.
PREFIX = 50
UNFINISHED = ".part"


def check_target(path: str | os.PathLike[str], *, force: bool) -> None:
    """Check, before long work, that `atomic_write` can write its result to `path`.

    Parameters
    ----------
    path : path-like
        File to be written later.
    force : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, `path` is a folder, a pipe or a device, or it exists and `force` is
        False.
    """
    target = _target(path)
    if target.exists() and not force:
        raise OutputError(f"{path}: the file exists; use force (--force) to replace it, or give another name")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: cannot write the file: there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{path}: cannot write the file: the folder {target.parent} is not writable")


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a temporary file beside `path`, for writing and reading, which replaces `path` at the end.

    If the block raises, the temporary file is removed and `path` is unchanged. If `path` is a symbolic link, the file
    that it points to is replaced.

    Parameters
    ----------
    path : path-like
        File to be written.

    Yields
    ------
    file
        Binary file.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, the disk is full, or `path` is a folder, a pipe or a device.
    """
    target = _target(path)
    # `tempfile` would give the file a mode of its own; this one has the mode of any new file.
    temporary = target.with_name(f".{target.name[:PREFIX]}.{secrets.token_hex(8)}{UNFINISHED}")
    try:
        with open(temporary, "x+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(target)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot write the file: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def remove_unfinished(path: str | os.PathLike[str]) -> None:
    """Remove temporary files of `path` that killed processes left behind."""
    target = _target(path)
    for part in target.parent.glob(f".{escape(target.name[:PREFIX])}.*{UNFINISHED}"):
        part.unlink(missing_ok=True)


def _target(path: str | os.PathLike[str]) -> Path:
    """Return the file that `path` points to; refuse a folder, a pipe or a device."""
    path = checked_path(path)
    try:
        target = Path(os.path.realpath(path))
        mode = target.stat().st_mode
    except FileNotFoundError:
        return target
    # A ValueError is raised for names that no file can have, with NUL or lone surrogates.
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise OutputError(f"{path}: cannot write the file: {reason or error}") from error
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: cannot write the file: a folder has this name")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: cannot write the file: it is a pipe or a device, which would be replaced")
    return target
