"""Reading of regular files only: reading a pipe or a device might block for ever or never end.

Files are given to FFmpeg never as addresses, and only in containers that open no other files.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Any, BinaryIO

from rsdeblur.errors import FileFormatError, InputError

# FFmpeg's names of the containers that are read. It recognises a file by its content, and reads pictures as videos too,
# and playlists, which make it open other files.
CONTAINERS = ("mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts")
FileState = tuple[int, ...] | None


def checked_path(path: str | os.PathLike[str]) -> Path:
    """Return `path` as a Path; raise `InputError` for what is no path, such as None or the number of an open file."""
    if isinstance(path, (str, os.PathLike)) and isinstance(os.fspath(path), str):
        return Path(path)
    raise InputError(f"path must be the path of a file, got {type(path).__name__}")


def open_file(path: str | os.PathLike[str], what: str) -> BinaryIO:
    """Open a regular file for reading; the caller closes it.

    A `FileFormatError`, in which `what` names the kind of file, says that the file does not exist, cannot be read, or
    is a folder, a pipe or a device.
    """
    path = checked_path(path)
    try:
        file = open(path, "rb", opener=_open_at_once)  # noqa: SIM115 (the caller closes it)
    except (OSError, ValueError) as error:
        raise _unreadable(path, what, error) from error
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise FileFormatError(
            f"{path}: cannot read the {what}: it is a pipe or a device; save its output to a file first"
        )
    return file


def read_file(path: str | os.PathLike[str], what: str, start: int = 0, size: int = -1) -> bytes:
    """Return the content of a regular file, or `size` bytes from `start` on; see :func:`open_file`."""
    with open_file(path, what) as file:
        try:
            file.seek(start)
            return file.read(size)
        except OSError as error:
            raise _unreadable(path, what, error) from error


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


def _open_at_once(path: str, flags: int) -> int:
    # Without this flag, opening a pipe waits for its writer.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _unreadable(path: str | os.PathLike[str], what: str, error: OSError | ValueError) -> FileFormatError:
    # A ValueError is raised for names that no file can have, with NUL or lone surrogates.
    reason = error.strerror if isinstance(error, OSError) else None
    if isinstance(error, IsADirectoryError):
        reason = "it is a folder; give a file"
    return FileFormatError(f"{Path(path)}: cannot read the {what}: {reason or error}")
