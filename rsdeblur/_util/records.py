"""Which tasks of a long run are finished, kept on disk so that an interrupted run goes on where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rsdeblur._util.atomic import atomic_write


def fingerprint(settings: Any, files: Iterable[Path]) -> str:
    """Return what changes if `settings` (of which `repr` must tell all) or a file's size or date does."""
    stamps = [(str(path), *_stamp(path)) for path in files]
    return hashlib.sha256(repr((settings, stamps)).encode()).hexdigest()


def _stamp(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns


class Records:
    """A folder with a small file for each task, each replaced atomically.

    Parameters
    ----------
    folder : Path
        Made by `open`; a folder that exists says that what lies around it is this run's own.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def open(self) -> None:
        """Make the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)

    def claim(self, name: str, fingerprint_: str) -> None:
        """Note, before a task begins, that what it leaves under `name` is its own."""
        self._write(name, {"mark": fingerprint_})

    def claimed(self, name: str, fingerprint_: str) -> bool:
        """Whether the task called `name` was begun with the same `fingerprint`."""
        return self._read(name).get("mark") == fingerprint_

    def finish(self, name: str, fingerprint_: str, facts: dict[str, Any]) -> None:
        """Note that the task is done, and what came out."""
        self._write(name, {"mark": fingerprint_, "facts": facts})

    def facts(self, name: str, fingerprint_: str) -> dict[str, Any] | None:
        """Return what came out of the finished task with the same `fingerprint`, else None."""
        found = self._read(name)
        facts: dict[str, Any] | None = found.get("facts") if found.get("mark") == fingerprint_ else None
        return facts

    def _path(self, name: str) -> Path:
        return self.folder / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.json"

    def _write(self, name: str, content: dict[str, Any]) -> None:
        with atomic_write(self._path(name)) as file:
            file.write(json.dumps({"name": name} | content).encode())

    def _read(self, name: str) -> dict[str, Any]:
        try:
            found = json.loads(self._path(name).read_bytes())
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}
