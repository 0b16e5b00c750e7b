"""Files: reading of regular ones only, as a pipe or a device might never end, and atomic writing.

A reader of a written file sees the old file or the new one, never a part of either. Files are given to FFmpeg never as
addresses, and only in containers that open no other files.
"""

import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from rsdeblur.errors import FileFormatError, InputError, OutputError, RsdeblurError

# FFmpeg's names of the containers that are read. It recognises a file by its content, and reads pictures as videos too,
# and playlists, which make it open other files.
CONTAINERS = ("mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts")
FileState = tuple[int, ...] | None
# Advice where a file exists, in the words of the command line.
REPLACE = "use force (--force) to replace it, or give another name"


def checked_path(path: str | os.PathLike[str]) -> Path:
    """Return `path` as a Path; raise `InputError` for what is no path, such as None or the number of an open file."""
    if isinstance(path, (str, os.PathLike)) and isinstance(os.fspath(path), str):
        return Path(path)
    raise InputError(f"path must be the path of a file, got {type(path).__name__}")


@contextmanager
def _regular(path: Path, fault: type[RsdeblurError], action: str) -> Iterator[None]:
    """Raise `fault` if `path` is something else than a regular file, or if the block fails."""
    try:
        # Opening a pipe waits for its writer, and writing would replace it.
        if path.exists() and not path.is_file():
            raise OSError(f"it is {'a folder' if path.is_dir() else 'a pipe or a device'}; give a regular file")
        yield
    except (OSError, ValueError) as error:  # ValueError: NUL or lone surrogates, which no name can have
        raise fault(f"{path}: cannot {action}: {getattr(error, 'strerror', None) or error}") from error


def open_file(path: str | os.PathLike[str], what: str) -> BinaryIO:
    """Open a regular file for reading, which the caller closes; a `FileFormatError` calls it a `what`."""
    path = checked_path(path)
    with _regular(path, FileFormatError, f"read the {what}"):
        return open(path, "rb")


def read_file(path: str | os.PathLike[str], what: str, size: int = -1) -> bytes:
    """Return the content of a regular file, or its first `size` bytes; see :func:`open_file`."""
    with open_file(path, what) as file:
        return file.read(size)


def file_state(path: Path) -> FileState:
    """Return numbers that change when a file does; None if there is no such file, which its reader reports."""
    try:
        facts = path.stat()
    except (OSError, ValueError):
        return None
    return facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns


def ffmpeg_input(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `av.open` that read a file."""
    # FFmpeg takes names for URLs: 10:30.mp4 has the protocol 10.
    return {"file": f"file:{os.path.abspath(path)}", "options": {"format_whitelist": ",".join(CONTAINERS)}}


def check_target(path: str | os.PathLike[str], *, force: bool) -> None:
    """Raise `OutputError`, before long work, if `path` cannot be written, or exists without `force`."""
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
    """
    target = _target(path)
    # `tempfile` would give the file a mode of its own; this one has the mode of any new file.
    part = target.with_name(f".rsdeblur-{secrets.token_hex(8)}.part")
    try:
        with open(part, "x+b") as file:
            with suppress(OSError):
                shutil.copystat(target, part)
            yield file
            file.flush()
            try:
                os.fsync(file.fileno())  # a full disk may be noticed only here
            except OSError as error:  # some file systems cannot synchronise
                if error.errno not in (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EPERM):
                    raise
        os.replace(part, target)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: cannot write the file: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def _target(path: str | os.PathLike[str]) -> Path:
    """Return the file that `path` points to; refuse a folder, a pipe or a device."""
    path = checked_path(path)
    with _regular(path, OutputError, "write the file"):
        return Path(os.path.realpath(path))
