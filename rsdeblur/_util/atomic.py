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
from rsdeblur._util.locks import HAS_LOCKS, lock, open_itself
from rsdeblur.errors import OutputError

# Bytes written at a time where a file system cannot reserve space.
BLOCK = 2**20
# Advice where a file exists, in the words of the command line.
REPLACE = "use force (--force) to replace it, or give another name"


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
        raise OutputError(f"{path}: the file exists; {REPLACE}")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: cannot write the file: there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{path}: cannot write the file: the folder {target.parent} is not writable")


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a temporary file beside `path`, for writing and reading, which replaces `path` at the end.

    If the block raises, the temporary file is removed and `path` is unchanged. If `path` is a symbolic link, the file
    that it points to is replaced. Mode, extended attributes and, where the system allows it, owner and group of a
    replaced file are kept.

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
    remove_unfinished(target)
    try:
        with temporary_beside(target) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
            if not HAS_LOCKS:  # Windows does not rename an open file
                file.close()
            # Locked until it has its name, or `remove_unfinished` might remove it.
            os.replace(file.name, target)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot write the file: {error.strerror or error}") from error


def reserve(file: BinaryIO) -> None:
    """Take the disk space for the holes of an open file, which its memory map would otherwise take one by one.

    A full disk is an error here; for a process that writes through the map it is a fatal signal.

    Raises
    ------
    OSError
        If the disk is full.
    """
    file.flush()
    size = os.fstat(file.fileno()).st_size
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(file.fileno(), 0, size)
            return
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.EINVAL):
                raise
    # macOS and some file systems do not have it: the same bytes are written again.
    for start in range(0, size, BLOCK):
        file.seek(start)
        block = file.read(BLOCK)
        file.seek(start)
        file.write(block)
    file.flush()


def remove_unfinished(path: str | os.PathLike[str]) -> None:
    """Remove temporary files of `path` that killed processes left behind; those in use are locked and stay."""
    target = _target(path)
    for part in target.parent.glob(f"{_mark(target)}*.part"):
        with suppress(OSError), open(part, "rb", opener=open_itself) as file:
            lock(file)
            part.unlink()


def _mark(target: Path) -> str:
    """Return the start of the names of temporary files of `target`, and of no other file in its folder."""
    # A digest, because a name of 255 bytes leaves no room for more.
    return f".rsdeblur-{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:16]}-"


@contextmanager
def temporary_beside(target: Path) -> Iterator[BinaryIO]:
    """Open a new locked file beside `target`, with the mode, owner and extended attributes that `target` has.

    It is removed at the end, or if the process is killed, by the next :func:`atomic_write` to `target`.
    """
    while True:
        # `tempfile` would give the file a mode of its own; this one has the mode of any new file.
        path = target.with_name(f"{_mark(target)}{secrets.token_hex(8)}.part")
        try:
            with open(path, "x+b") as file:
                try:
                    lock(file)
                    is_own = path.exists()
                except OSError as error:
                    # Without locks, nobody removes it.
                    is_own = not isinstance(error, BlockingIOError)
                # Else `remove_unfinished` has taken it in the moment before it was locked.
                if is_own:
                    _inherit(file, target)
                    yield file
                    return
        finally:
            path.unlink(missing_ok=True)


def _inherit(file: BinaryIO, target: Path) -> None:
    with suppress(OSError):
        old, new = target.stat(), os.fstat(file.fileno())
        if (old.st_uid, old.st_gid) != (new.st_uid, new.st_gid):
            shutil.chown(file.name, old.st_uid, old.st_gid)
    with suppress(OSError):
        shutil.copystat(target, file.name)


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
