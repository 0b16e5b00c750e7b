"""Which tasks of a long run are finished, kept on disk so that an interrupted run continues where it stopped."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.files import read_file
from rsdeblur._util.locks import locked
from rsdeblur.errors import OutputError

# File in a folder of records that marks it as one, and that the run which writes there locks.
LOCK = "lock"


def fingerprint(settings: Any, files: Iterable[Path | None]) -> str:
    """Return a text that changes with `settings`, compared by their `repr`, and with the files.

    The `repr` of arrays, and of our objects that contain some, is abbreviated: pass their bytes as well. Files are
    compared by name, size and date, so that a folder may be moved.
    """
    states = [None if path is None else (path.name, *_state(path)) for path in files]
    return hashlib.sha256(repr((settings, states)).encode()).hexdigest()


def _state(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    # A ValueError is raised for names that no file can have.
    except (OSError, ValueError):
        return 0, 0
    return status.st_size, status.st_mtime_ns


def contents(path: Path) -> dict[str, Any]:
    """Return size and check sum of a file.

    Raises
    ------
    FileFormatError
        If it cannot be read.
    """
    data = read_file(path, "file")
    return {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}


class Records:
    """A folder with a small file for each task, each replaced atomically.

    Parameters
    ----------
    folder : Path
        Made by `held`. If it exists, an earlier run has written the files around it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @contextmanager
    def held(self) -> Iterator[None]:
        """Make the folder, and keep other runs out of it while the block runs.

        Raises
        ------
        OutputError
            If another run writes there, the folder contains other files, or it cannot be made.
        """
        busy = f"{self.folder}: another rsdeblur is writing there; wait until it is done"
        with ExitStack() as stack:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                self.check()
                stack.enter_context(locked(self.folder / LOCK, busy))
            except OutputError:
                raise
            except OSError as error:
                raise OutputError(f"{self.folder}: cannot write there: {error.strerror}") from error
            yield

    def check(self) -> None:
        """Check that the folder, if it exists, is one of records.

        Raises
        ------
        OutputError
            If it contains other files.
        """
        if self.folder.is_dir() and any(self.folder.iterdir()) and not (self.folder / LOCK).exists():
            raise OutputError(f"{self.folder}: the folder contains other files; move it, or give another output")

    def claim(self, name: str, fingerprint: str) -> None:
        """Record, before a task begins, that its output `name` belongs to this run and may be replaced."""
        self._write(name, {"mark": fingerprint})

    def claimed(self, name: str, fingerprint: str) -> bool:
        """Whether the task `name` was begun with the same `fingerprint`."""
        return self._read(name).get("mark") == fingerprint

    def known(self, name: str) -> bool:
        """Whether the task `name` was begun, with any fingerprint."""
        return bool(self._read(name))

    def finish(self, name: str, fingerprint: str, facts: dict[str, Any]) -> None:
        """Record that the task is done, with the facts about its result."""
        self._write(name, {"mark": fingerprint, "facts": facts})

    def facts(self, name: str, fingerprint: str) -> dict[str, Any] | None:
        """Return the facts of the finished task with the same `fingerprint`, else None."""
        record = self._read(name)
        facts: dict[str, Any] | None = record.get("facts") if record.get("mark") == fingerprint else None
        return facts

    def remove(self) -> None:
        """Remove the folder with the outputs in it that were claimed; files of others stay, and with them the folder.

        Raises
        ------
        OSError
            If a file cannot be removed.
        """
        for path in self.folder.glob("*.json"):
            record = self._load(path)
            if record:
                (self.folder / Path(record["name"]).name).unlink(missing_ok=True)
                path.unlink()
        (self.folder / LOCK).unlink(missing_ok=True)
        with suppress(OSError):
            self.folder.rmdir()

    def _path(self, name: str) -> Path:
        return self.folder / f"{hashlib.sha256(os.fsencode(name)).hexdigest()[:32]}.json"

    def _write(self, name: str, content: dict[str, Any]) -> None:
        record = {"name": name} | content
        with atomic_write(self._path(name)) as file:
            file.write(json.dumps(record | {"seal": _seal(record)}).encode())

    def _read(self, name: str) -> dict[str, Any]:
        return self._load(self._path(name))

    def _load(self, path: Path) -> dict[str, Any]:
        """Return a record as it was written; an empty one if the file is missing or was changed."""
        try:
            record = json.loads(read_file(path, "record"))
            seal = record.pop("seal")
            return record if seal == _seal(record) else {}
        except (ValueError, RecursionError, AttributeError, KeyError, TypeError):
            return {}


def _seal(record: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(record, sort_keys=True).encode()).hexdigest()
