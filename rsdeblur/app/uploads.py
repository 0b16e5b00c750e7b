"""The temporary folder of the app: files that the browser sent, and the page that opens the app."""

from __future__ import annotations

import os
import re
import shutil
import stat
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from html import escape
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import TypeVar

from rsdeblur.errors import InputError, OutputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

PREFIX = "rsdeblur-app-"
T = TypeVar("T")


class Uploads:
    """Files that the browser sent, each in a folder of its own, so that equal names are different files.

    The folder is removed at the end. What a killed app left behind, the next one removes: a lock marks the folders in
    use, which cleaners of temporary files respect too.
    """

    def __init__(self) -> None:
        _remove_abandoned()
        self._making = threading.Lock()
        self._folder, self._lock = _make()

    def close(self) -> None:
        """Remove the files."""
        shutil.rmtree(self._folder, ignore_errors=True)
        _release(self._lock)
        self._lock = None

    def keep(self, name: str, content: bytes) -> Path:
        """Write a file, and return its path, which has the last part of `name`."""
        # Without anything that a system treats specially.
        clean = "".join(c for c in name.replace("\\", "/").rpartition("/")[2] if c.isprintable() and c not in '<>:"|?*')
        if not clean.strip(". ") or len(clean.encode()) > 200:
            raise InputError("the file has no usable name; rename it")

        def write(folder: Path) -> Path:
            path = folder / clean
            path.write_bytes(content)
            return path

        return self.fill(clean, write)

    def fill(self, what: str, write: Callable[[Path], T]) -> T:
        """Return what `write` returns for a new folder, which is removed if it fails; `what` names its content."""
        folder = None
        try:
            with self._making:
                if not self._folder.is_dir():  # somebody has cleaned up
                    _release(self._lock)
                    self._folder, self._lock = _make()
            folder = Path(mkdtemp(dir=self._folder))
            return write(folder)
        except BaseException as error:
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)
            if not isinstance(error, OSError):
                raise
            reason = error.strerror or plain(str(error))
            raise OutputError(
                f"{what}: cannot write to the temporary folder {gettempdir()}: {reason}; free space there, or set "
                "TMPDIR to another folder and start the app again"
            ) from error

    def has(self, path: Path) -> bool:
        """Return whether a path leads to one of the files."""
        return path.is_relative_to(self._folder)

    def browse(self, address: str) -> None:
        """Open `address` in a browser, through a file that only this user can read, and return at once.

        The system shows the arguments of a browser to every user, so `address`, with its token, must not be one.
        """
        path = self._folder / "open.html"
        url = escape(address)
        page = f'<meta http-equiv="refresh" content="0; url={url}"><a href="{url}">rsdeblur app</a>\n'
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(f'<!doctype html><meta charset="utf-8"><title>rsdeblur app</title>{page}')
        # Some browsers return only when they are closed.
        threading.Thread(target=_browse, args=(path.as_uri(),), daemon=True).start()


def plain(text: str) -> str:
    """Return a text in which files that the browser sent have the names that the user knows."""
    return re.sub(rf"{re.escape(str(Path(gettempdir()) / PREFIX))}[^/\\]+[/\\][^/\\]+[/\\]", "", text)


def _browse(address: str) -> None:
    with suppress(webbrowser.Error, OSError):
        webbrowser.open(address)


def _make() -> tuple[Path, int | None]:
    """Return a new folder and its lock."""
    # It gets its name once it is locked: before, another app would take it for abandoned.
    hidden = Path(mkdtemp(prefix=f".{PREFIX}"))
    lock = None
    with suppress(OSError):
        lock = _locked(hidden)
    return hidden.rename(hidden.with_name(hidden.name[1:])), lock


def _locked(folder: Path) -> int | None:
    """Return a descriptor that locks a folder; None without such locks. OSError: another process has the lock."""
    if fcntl is None:
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _release(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def _remove_abandoned() -> None:
    """Remove the folders of this user that no app has locked."""
    if fcntl is None:
        return
    for folder in Path(gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError):
            facts = folder.lstat()
            if stat.S_ISDIR(facts.st_mode) and facts.st_uid == os.getuid():
                lock = _locked(folder)
                shutil.rmtree(folder, ignore_errors=True)
                _release(lock)
