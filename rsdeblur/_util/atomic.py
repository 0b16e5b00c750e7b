"""Atomic writing: a reader sees the old file or the new one, never a part of either."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from rsdeblur._util.files import checked_path
from rsdeblur.errors import OutputError

# Advice where a file exists, in the words of the command line.
REPLACE = "use force (--force) to replace it, or give another name"


def check_target(path: str | os.PathLike[str], *, force: bool) -> None:
    """Check, before long work, that `atomic_write` can write its result to `path`.

    An `OutputError` says that the folder is missing or not writable, that `path` is a folder, a pipe or a device, or
    that it exists although it may not be replaced (`force`).
    """
    target = _target(path)
    if target.exists() and not force:
        raise OutputError(f"{path}: the file exists; {REPLACE}")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: cannot write the file: there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{path}: cannot write the file: the folder {target.parent} is not writable")


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a temporary binary file beside `path`, for writing and reading, which replaces `path` at the end.

    If the block raises, the temporary file is removed and `path` is unchanged. If `path` is a symbolic link, the file
    that it points to is replaced. Mode and extended attributes of a replaced file are kept.

    An `OutputError` says that the folder is missing or not writable, that the disk is full, or that `path` is a folder,
    a pipe or a device.
    """
    target = _target(path)
    try:
        with temporary_beside(target) as file:
            yield file
            file.flush()
            with _where_supported():
                os.fsync(file.fileno())
            file.close()  # Windows does not rename an open file
            os.replace(file.name, target)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot write the file: {error.strerror or error}") from error


def reserve(file: BinaryIO) -> None:
    """Take the disk space for the holes of an open file, where the system can; its memory map takes it piece by piece.

    A full disk is an `OSError` here; for a process that writes through the map it is a fatal signal.
    """
    file.flush()
    if hasattr(os, "posix_fallocate"):  # not on macOS and Windows
        with _where_supported():
            os.posix_fallocate(file.fileno(), 0, os.fstat(file.fileno()).st_size)


@contextmanager
def _where_supported() -> Iterator[None]:
    """Ignore errors of file systems that cannot reserve space or synchronise; those of a full or broken disk raise."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EPERM):
            raise


def remove_unfinished(path: str | os.PathLike[str]) -> None:
    """Remove the temporary files of `path`; call it when the process that wrote them was killed."""
    target = _target(path)
    for part in target.parent.glob(f"{_mark(target)}*.part"):
        part.unlink(missing_ok=True)


def _mark(target: Path) -> str:
    """Return the start of the names of temporary files of `target`, and of no other file in its folder."""
    # A digest, because a name of 255 bytes leaves no room for more.
    return f".rsdeblur-{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}-"


@contextmanager
def temporary_beside(target: Path) -> Iterator[BinaryIO]:
    """Open a new file beside `target` with its mode and extended attributes; remove it at the end."""
    # `tempfile` would give the file a mode of its own; this one has the mode of any new file.
    path = target.with_name(f"{_mark(target)}{secrets.token_hex(8)}.part")
    try:
        with open(path, "x+b") as file:
            with suppress(OSError):
                shutil.copystat(target, path)
            yield file
    finally:
        path.unlink(missing_ok=True)


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
