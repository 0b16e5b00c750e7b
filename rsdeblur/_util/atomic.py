"""Writing files so that a reader sees the old file or the new one, never a part of either."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import BinaryIO

from rsdeblur.errors import OutputError

# Characters of the file's name that the temporary one repeats: of 4 bytes each, with the rest they fit into 255.
PREFIX = 50
UNFINISHED = ".part"


def check_target(path: str | os.PathLike[str], *, force: bool) -> None:
    """Check cheaply that `atomic_write` may write `path`, before the work whose result is to go there.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, `path` is a folder, a pipe or a device, or it exists and `force` is
        not set.
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
    """Open a temporary file beside `path` for writing and reading; on success it replaces `path`, else it vanishes.

    A symbolic link stays one: the file that it leads to is replaced.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, the disk is full, or `path` is a folder, a pipe or a device.
    """
    target = _target(path)
    # A name of its own, which its maker takes away; made in the common way, so that it has the mode of any new file.
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
    """Remove what `atomic_write` left of `path` in a process that was killed."""
    target = _target(path)
    for part in target.parent.glob(f".{escape(target.name[:PREFIX])}.*{UNFINISHED}"):
        part.unlink(missing_ok=True)


def _target(path: str | os.PathLike[str]) -> Path:
    """Return the file that `path` leads to; a folder, a pipe or a device must not be replaced by one."""
    try:
        target = Path(os.path.realpath(path))
        mode = target.stat().st_mode
    except FileNotFoundError:
        return target
    # Names that no file can have, with NUL or lone surrogates, are a ValueError.
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise OutputError(f"{path}: cannot write the file: {reason or error}") from error
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: cannot write the file: a folder has this name")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: cannot write the file: it is a pipe or a device, which would be replaced")
    return target
