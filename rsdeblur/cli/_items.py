"""Items of a batch: the rows of a manifest, the photos of a folder, or photos that are named."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.files import file_state, read_file
from rsdeblur.cli import _engine as rs
from rsdeblur.cli._options import FILES, MANY, ONE_OF_MANY, Recording, refuse_given
from rsdeblur.cli._types import PATH
from rsdeblur.errors import FileFormatError, InputError

# Columns of a manifest with the types of their cells; an empty cell sets nothing.
COLUMNS: dict[str, click.ParamType[Any]] = {
    "photo": PATH,
    "output": PATH,
    **{each.name: each.metadata["type"] or click.STRING for each in fields(Recording) if each.name in MANY},
}


@dataclass(frozen=True, slots=True)
class Item:
    """A photo of the batch, its recording, and the path of its result in the output folder; or its error."""

    photo: Path
    output: Path
    recording: Recording | None
    error: str | None = None


def read_items(sources: Sequence[Path], defaults: Recording, output: Path, *, unpack: bool = False) -> list[Item]:
    """Return the items of a manifest, of several photos, or of a session: a folder, or with `unpack` a zip archive."""
    start = None if defaults.start == "exif" else defaults.start
    refuse_given(ONE_OF_MANY, index=defaults.index, start=start, start_ns=defaults.start_ns)
    # Wrong files that all photos would share are refused once, instead of for every photo.
    if defaults.gyro is not None and defaults.gyro_format is None and defaults.columns is None:
        rs.detect_gyro_format(defaults.gyro)
    if defaults.camera is not None:
        rs.detect_camera_format(defaults.camera)
    if defaults.capture is not None:
        rs.open_captures(defaults.capture, rs.choice_for("capture file", defaults.columns))
    if len(sources) > 1:
        items = list(_photos(sources, None, defaults))
    elif sources[0].is_dir():
        items = list(_session(sources[0], defaults, output))
    elif sources[0].suffix.lower() == ".zip":
        if not unpack:
            raise click.UsageError(f"{sources[0]}: nothing is unpacked here; unpack the archive, and give the folder")
        items = list(_session(rs.unpacked(sources[0], output), defaults, output))
    else:
        items = list(_manifest(sources[0], defaults))
    inputs = [*sources, *(item.photo for item in items)]
    inputs += [getattr(item.recording, name) for item in items for name in FILES if item.recording]
    return list(_without_clashes(items, output, _places(path for path in inputs if path is not None)))


def _without_clashes(items: Iterable[Item], folder: Path, inputs: set[tuple[int, ...]]) -> Iterator[Item]:
    """Set the error of items whose result another item already writes, or would replace an input of any item."""
    writers: dict[str, Item] = {}
    for item in items:
        # Some disks do not tell upper case from lower case.
        other, result = writers.setdefault(str(item.output).casefold(), item), folder / item.output
        clash = None
        if other is not item:
            clash = f"{item.photo}: {other.photo} has the same result, {result}; name another output"
        elif not inputs.isdisjoint(_places([result])):
            clash = f"{item.photo}: {result} is an input too; name another output"
        yield replace(item, error=item.error or clash)


def _places(paths: Iterable[Path]) -> set[tuple[int, ...]]:
    """Return device and number of the files that exist: the same for all names of a file."""
    return {state[:2] for path in set(paths) if (state := file_state(path)) is not None}


def _session(folder: Path, defaults: Recording, output: Path) -> Iterator[Item]:
    """Return items of the photos in a folder of a logger and its subfolders."""
    files = rs.files_in(folder, without=output)
    gyro, capture = defaults.gyro or rs.gyro_log_in(folder, files), defaults.capture
    photos = rs.photos_in(folder, files)
    if defaults.start != "exif" and capture is None:
        capture = rs.capture_file_in([path for path in files if path != gyro])
    camera: Any = defaults.camera or rs.camera_in(files)
    return _photos(photos, folder, replace(defaults, gyro=gyro, camera=camera, capture=capture))


def _photos(photos: Sequence[Path], folder: Path | None, defaults: Recording) -> Iterator[Item]:
    """Return items of photos that share a log; their results have their places in `folder`, or their names."""

    def place(photo: Path) -> Path:
        return result_name(Path(photo.name) if folder is None else photo.relative_to(folder))

    if defaults.capture is None or defaults.start == "exif":
        # The photos of a camera app, beside a log: their EXIF blocks give what is missing.
        for path in photos:
            yield _item(path, place(path), {"start": "exif"}, defaults)
        return
    columns = rs.choice_for("capture file", defaults.columns)
    for photo in rs.indices_of(list(photos), defaults.capture, numbered_from=defaults.numbered_from, columns=columns):
        if photo.error is None:
            yield _item(photo.path, place(photo.path), {"index": photo.index}, defaults)
        else:
            yield Item(photo.path, place(photo.path), None, f"{photo.path}: {photo.error}")


def _manifest(path: Path, defaults: Recording) -> Iterator[Item]:
    content = read_file(path, "manifest")
    try:
        (_, head), *rows = _rows(path, content)
    except FileFormatError as error:
        raise rs.mistaken(rs.Source(path, "manifest")) or error from None
    for line, row in rows:
        if any(cell.strip() for cell in row):
            yield _row(path, line, head, row, defaults)


def _rows(path: Path, content: bytes) -> list[tuple[int, list[str]]]:
    """Return the number of the last line and the cells of each row; the first row has the names of the columns."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: cannot read the manifest: it is not UTF-8 text") from error
    # Spreadsheets of some countries write semicolons.
    delimiter = max(",;\t", key=text.partition("\n")[0].count)
    # A long cell must not end the whole table.
    csv.field_size_limit(max(csv.field_size_limit(), len(text) + 1))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True)
    head = [cell.strip().lower() for cell in next(reader, [])]
    problems = [f"unknown column {name!r}" for name in head if name not in COLUMNS]
    problems += [f"the column {name} occurs {count} times" for name, count in Counter(head).items() if count > 1]
    if "photo" not in head:
        problems.append("no column photo")
    if problems:
        raise FileFormatError(f"{path}, line 1: {problems[0]}; columns are {', '.join(COLUMNS)}")
    return [(1, head), *((reader.line_num, row) for row in reader)]


def _row(path: Path, line: int, head: list[str], row: list[str], defaults: Recording) -> Item:
    photo = Path(f"line {line}")
    cells: dict[str, Any] = {}
    try:
        if len(row) != len(head):
            raise ValueError(f"{len(row)} cells, but the first line names {len(head)} columns")
        if not (photo_name := row[head.index("photo")].strip()):
            raise ValueError("no photo")
        photo = path.parent / photo_name
        for name, cell in zip(head, map(str.strip, row), strict=True):
            if cell and name != "photo":
                try:
                    cells[name] = COLUMNS[name].convert(cell, None, None)
                except click.BadParameter as error:
                    raise ValueError(f"{name}: {error.message}") from error
        inside = photo.relative_to(path.parent) if photo.is_relative_to(path.parent) else photo
        # Photos elsewhere have results in the output folder.
        inside = Path(photo.name) if inside.anchor or ".." in inside.parts else inside
        result = cells.pop("output", None) or result_name(inside)
        if result.anchor or ".." in result.parts:
            raise ValueError(f"output: {result} leads out of the output folder; give a path relative to that folder")
        files = {name: path.parent / cells[name] for name in FILES if name in cells}
        return _item(photo, result, cells | files, defaults)
    except ValueError as error:
        return Item(photo, Path(f"line {line}"), None, f"{path}, line {line}: {error}")


def _item(photo: Path, result: Path, own: dict[str, Any], defaults: Recording) -> Item:
    recording = replace(defaults, **own)
    has_moment = not own.keys().isdisjoint(("start", "start_ns"))
    # A photo with a start of its own needs no capture file, unless it names an exposure there, and a time from EXIF
    # replaces that of the defaults.
    if "capture" not in own and ((has_moment and "index" not in own) or recording.start == "exif"):
        recording = replace(recording, capture=None)
    if recording.gyro is None:
        return Item(photo, result, None, f"{photo}: no gyro file; give it in the column gyro or with --gyro")
    # Without a camera file, the photo's EXIF block gives the camera.
    return Item(photo, result, recording if recording.camera else replace(recording, camera=photo))


def result_name(photo: Path) -> Path:
    """Return the name of a photo's result: its own, or that of a PNG if results cannot have its format."""
    if not photo.name:
        raise InputError(f"{photo}: this is a folder, not a photo")
    return photo if photo.suffix.lower() in rs.KINDS else photo.with_suffix(".png")
