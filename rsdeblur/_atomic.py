"""Writing files so that a reader sees the old file or the new one, never a part of either."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from glob import escape
from pathlib import Path
from typing import BinaryIO

from rsdeblur.errors import OutputError

UNFINISHED = ".part"
# Characters of the target's name in the temporary one: names have bounds.
LONGEST = 100


def check_target(path: str | os.PathLike[str], *, force: bool) -> None:
    """Check cheaply that `atomic_write` may write `path`, before the work whose result is to go there.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, `path` is a folder, or it exists and `force` is not set.
    """
    target = Path(path)
    if target.is_dir():
        raise OutputError(f"{target}: cannot write the file: a folder has this name")
    if target.exists() and not force:
        raise OutputError(f"{target}: the file exists; use force (--force) to replace it, or give another name")
    if not target.parent.is_dir():
        raise OutputError(f"{target}: cannot write the file: there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK):
        raise OutputError(f"{target}: cannot write the file: the folder {target.parent} is not writable")


def remove_unfinished(path: str | os.PathLike[str]) -> None:
    """Remove what `atomic_write` left of `path` in a process that was killed."""
    target = Path(path)
    for part in target.parent.glob(f".{escape(target.name[:LONGEST])}.*{UNFINISHED}"):
        part.unlink(missing_ok=True)


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a temporary file beside `path`; on success it replaces `path`, on any failure it vanishes.

    Raises
    ------
    OutputError
        If the folder is missing or not writable, the disk is full, or `path` is a folder.
    """
    target = Path(path)
    temporary = None
    try:
        if target.is_dir():
            raise OutputError(f"{target}: cannot write the file: a folder has this name")
        handle, name = tempfile.mkstemp(prefix=f".{target.name[:LONGEST]}.", suffix=UNFINISHED, dir=target.parent)
        temporary = Path(name)
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files private; give the result the mode any new file would have.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
        temporary = None
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{target}: cannot write the file: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
