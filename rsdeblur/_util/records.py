"""Which tasks of a long run are finished, kept on disk so that an interrupted run continues where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rsdeblur._util.atomic import atomic_write


def fingerprint(settings: Any, files: Iterable[Path]) -> str:
    """Return a text that changes with `settings`, compared by their `repr`, and with the files' sizes and dates."""
    stamps = [(str(path), *_stamp(path)) for path in files]
    return hashlib.sha256(repr((settings, stamps)).encode()).hexdigest()


def _stamp(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0
    return status.st_size, status.st_mtime_ns


class Records:
    """A folder with a small file for each task, each replaced atomically.

    Parameters
    ----------
    folder : Path
        Made by `open`. If it exists, an earlier run has written the files around it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def open(self) -> None:
        """Make the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)

    def claim(self, name: str, fingerprint: str) -> None:
        """Record, before a task begins, that its output `name` belongs to this run and may be replaced."""
        self._write(name, {"mark": fingerprint})

    def claimed(self, name: str, fingerprint: str) -> bool:
        """Whether the task `name` was begun with the same `fingerprint`."""
        return self._read(name).get("mark") == fingerprint

    def finish(self, name: str, fingerprint: str, facts: dict[str, Any]) -> None:
        """Record that the task is done, with the facts about its result."""
        self._write(name, {"mark": fingerprint, "facts": facts})

    def facts(self, name: str, fingerprint: str) -> dict[str, Any] | None:
        """Return the facts of the finished task with the same `fingerprint`, else None."""
        record = self._read(name)
        facts: dict[str, Any] | None = record.get("facts") if record.get("mark") == fingerprint else None
        return facts

    def _path(self, name: str) -> Path:
        return self.folder / f"{hashlib.sha256(name.encode()).hexdigest()[:32]}.json"

    def _write(self, name: str, content: dict[str, Any]) -> None:
        with atomic_write(self._path(name)) as file:
            file.write(json.dumps({"name": name} | content).encode())

    def _read(self, name: str) -> dict[str, Any]:
        try:
            record = json.loads(self._path(name).read_bytes())
        except (OSError, ValueError):
            return {}
        return record if isinstance(record, dict) else {}
