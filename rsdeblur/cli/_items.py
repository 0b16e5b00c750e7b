"""The items of a batch: the rows of a manifest, or the photos of a session folder."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import click

from rsdeblur.cli._options import Defaults, Recording, SecondsType
from rsdeblur.errors import FileFormatError

# What a cell of a column is; an empty cell says nothing.
COLUMNS: dict[str, Callable[[str], Any]] = {
    **dict.fromkeys(("photo", "output", "gyro", "camera", "capture"), Path),
    **dict.fromkeys(("gyro_format", "unit", "orientation"), str),
    **dict.fromkeys(("index", "start_ns"), int),
    **dict.fromkeys(
        ("start", "duration", "time_offset", "readout_time"), lambda cell: SecondsType().convert(cell, None, None)
    ),
}
FILES = ("gyro", "camera", "capture")
# Results of other pictures, HEIC and raw, are written as PNG.
WRITABLE = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".npy")


@dataclass(frozen=True, slots=True)
class Item:
    """A photo of the batch, what belongs to it, and the result's place in the output folder; or what is wrong."""

    photo: Path
    output: Path
    recording: Recording | None
    error: str | None = None


def read_items(source: Path, defaults: Defaults, output: Path, *, numbered_from: int | None) -> list[Item]:
    """Return the items of a manifest or of a session folder, in its order.

    Raises
    ------
    FileFormatError
        If the manifest cannot be read, or the folder is no session.
    """
    items = _session(source, defaults, output, numbered_from) if source.is_dir() else _manifest(source, defaults)
    return list(_without_clashes(items))


def _without_clashes(items: Iterable[Item]) -> Iterator[Item]:
    """Find fault with items whose result another one writes already."""
    writers: dict[Path, Path] = {}
    for item in items:
        other = writers.setdefault(item.output, item.photo)
        if other is item.photo or item.error is not None:
            yield item
        else:
            yield replace(item, error=f"{item.photo}: {item.output} is the result of {other}; name another output")


def _session(folder: Path, defaults: Defaults, output: Path, numbered_from: int | None) -> Iterator[Item]:
    from rsdeblur.io.sessions import open_session

    session = open_session(folder, numbered_from=numbered_from, without=output)
    found = Defaults(**asdict(defaults) | {"gyro": session.gyro, "capture": session.capture})
    if defaults.camera is None:
        found = replace(found, camera=session.camera)
    for photo in session.photos:
        place = _result(photo.path.relative_to(folder))
        if photo.error is not None:
            yield Item(photo.path, place, None, f"{photo.path}: {photo.error}")
        else:
            yield _item(photo.path, place, {"index": photo.index}, found)


def _manifest(path: Path, defaults: Defaults) -> Iterator[Item]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no UTF-8 text"
        raise FileFormatError(f"{path}: cannot read the manifest: {reason}") from error
    if not lines:
        raise FileFormatError(f"{path}: the manifest is empty; its first line must name columns: photo,index,...")
    # Spreadsheets of some countries write semicolons.
    reader = csv.reader(lines, delimiter=max(",;\t", key=lines[0].count), skipinitialspace=True)
    head = [cell.strip().lower() for cell in next(reader)]
    unknown = [name for name in head if name not in COLUMNS]
    if unknown or "photo" not in head:
        found = f"unknown column {unknown[0]!r}" if unknown else "no column photo"
        raise FileFormatError(f"{path}, line 1: {found}; columns are {', '.join(COLUMNS)}")
    for row in reader:
        if any(cell.strip() for cell in row):
            yield _row(path, reader.line_num, head, row, defaults)


def _row(path: Path, line: int, head: list[str], row: list[str], defaults: Defaults) -> Item:
    photo = Path(f"line {line}")
    cells: dict[str, Any] = {}
    try:
        if len(row) != len(head):
            raise ValueError(f"{len(row)} cells, but the first line names {len(head)} columns")
        if not (named := row[head.index("photo")].strip()):
            raise ValueError("no photo")
        photo = path.parent / named
        for name, cell in zip(head, map(str.strip, row), strict=True):
            if cell and name != "photo":
                cells[name] = _converted(name, cell)
        own = photo.relative_to(path.parent) if photo.is_relative_to(path.parent) else Path(photo.name)
        result = cells.pop("output", _result(own))
        if result.is_absolute() or ".." in result.parts or ".." in own.parts:
            result = Path(result.name)
        files = {name: path.parent / cells[name] for name in FILES if name in cells}
        return _item(photo, result, cells | files, defaults)
    except ValueError as error:
        return Item(photo, Path(f"line {line}"), None, f"{path}, line {line}: {error}")


def _converted(name: str, cell: str) -> Any:
    try:
        return COLUMNS[name](cell)
    except click.BadParameter as error:
        raise ValueError(f"{name}: {error.message}") from error
    except ValueError as error:
        raise ValueError(f"{name}: {cell!r} is not a whole number") from error


def _item(photo: Path, result: Path, own: dict[str, Any], defaults: Defaults) -> Item:
    given = {name: value for name, value in asdict(defaults).items() if value is not None}
    if "capture" not in own and not own.keys().isdisjoint(("start", "start_ns")):
        given.pop("capture", None)
    given |= own
    for name in ("gyro", "camera"):
        if name not in given:
            return Item(photo, result, None, f"{photo}: no {name} file; give it in the column {name} or by --{name}")
    return Item(photo, result, Recording(**given))


def _result(photo: Path) -> Path:
    return photo if photo.suffix.lower() in WRITABLE else photo.with_suffix(".png")
