"""Files and members of archives, of which only the parts in use are read; text is read as lines and as tables.

Tables of numbers are read fast, with exact timestamps, and with the line named where that fails.
"""

import json
import math
import os
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rsdeblur._util.binary import DAMAGE
from rsdeblur._util.files import checked_path, read_file
from rsdeblur._util.threads import once
from rsdeblur.errors import FileFormatError, InputError
from rsdeblur.types import FloatArray

# Bytes that are enough to recognise any format by its start.
HEAD = 4096
NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)

INT64_LIMIT = 2**63
# Rows, spread over a table, that decide its layout: enough that no rate rises from each to the next by chance. The
# names of the columns are among as many first rows, because apps write lines about the recording above them.
LAYOUT_ROWS = 50
# Characters of the longest line that may name columns or contain dates: a ROS topic with all its covariances has 1500.
HEADER_WIDTH = 4096
DATE_WITH_ZONE = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)\.?(\d*)(Z|[+-]\d\d:\d\d)", re.ASCII)
DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*", re.ASCII)

Rows = NDArray[np.intp]


class Source:
    """A file, expected to be a `what`, or a member of an archive with this content."""

    def __init__(self, path: str | os.PathLike[str], what: str, content: bytes | None = None) -> None:
        self.path, self.what, self._content = checked_path(path), what, content
        self.head = read_file(self.path, what, size=HEAD) if content is None else content[:HEAD]

    @once
    def data(self) -> bytes:
        """The whole content."""
        return read_file(self.path, self.what) if self._content is None else self._content

    @property
    def looks_like_text(self) -> bool:
        """Whether the content may be text."""
        return bool(self.head) and (b"\0" not in self.head or self.head[:2] in (b"\xff\xfe", b"\xfe\xff"))

    @property
    def looks_like_json(self) -> bool:
        """Whether the content may be JSON."""
        return self.head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[")

    @once
    def json(self) -> Any:
        """The content as JSON; raises `FileFormatError` if it is not."""
        try:
            return json.loads(self.data.decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise self.error(f"not JSON, or cut off: {error}") from error

    @once
    def _text(self) -> tuple[list[str], Rows]:
        # A binary file, perhaps a video of gigabytes, is not read beyond its start.
        data = self.data if self.looks_like_text else self.head
        try:
            text = data.decode("utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig")
        except UnicodeDecodeError:
            text = "\0"
        if "\0" in text:
            raise self.error(
                f"not a {self.what}: the file is binary, or text of another encoding than UTF-8; unpack it, or export "
                "it as CSV"
            )
        if "\r" in text:
            # Also the breaks of old Macs, and those that Windows doubles when a program writes \r\n as text.
            text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
        lines = text.split("\n")
        rows = np.flatnonzero(np.fromiter((line.lstrip()[:1] not in ("", "#") for line in lines), bool))
        if not len(rows):
            raise self.error(f"not a {self.what}: the file is empty{' but for comments' * ('#' in text)}")
        if DATE_WITH_ZONE.search(lines[rows[len(rows) // 2]][:HEADER_WIDTH]):
            text = DATE_WITH_ZONE.sub(_unix_ns, text)
            lines = text.split("\n")
        # A number without a fraction has no comma, but hardly all numbers of so many rows are such.
        if any(_has_decimal_commas(lines[row]) for row in spread(rows, LAYOUT_ROWS)):
            lines = text.replace(",", ".").split("\n")
        return lines, rows

    @property
    def lines(self) -> list[str]:
        """All lines, without line breaks; raises `FileFormatError` if the content is empty or not text."""
        return self._text[0]

    @property
    def rows(self) -> Rows:
        """Numbers from 0 of the lines that are neither blank nor comments (``#``); at least one."""
        return self._text[1]

    @property
    def start(self) -> str:
        """The first lines, for searches in files that are not tables."""
        return "\n".join(self.lines[:HEAD])

    @property
    def first_line(self) -> str:
        """The first line that is neither blank nor a comment."""
        return self.lines[int(self.rows[0])]

    @property
    def headers(self) -> list[tuple[str, int]]:
        """Lines that may name the columns, each with the place in `rows` of the line after it.

        These are the first lines that are not all numbers. If the first line is all numbers, they are the comments
        above it.
        """
        named: list[tuple[str, int]] = []
        for i, row in enumerate(self.rows[:LAYOUT_ROWS]):
            if len(self.lines[row]) > HEADER_WIDTH or all(map(is_number, cells_of(self.lines[row]))):
                break
            named.append((self.lines[row].lstrip("% "), i + 1))
        above = (line.lstrip().removeprefix("#") for line in reversed(self.lines[: self.rows[0]]))
        return named or [(line, 0) for line in islice(above, LAYOUT_ROWS) if line.strip() and len(line) <= HEADER_WIDTH]

    @contextmanager
    def parsing(self, what: str) -> Iterator[None]:
        """Turn the errors of a parser that trusts the content into one that names the file and its damaged part."""
        try:
            yield
        except FileFormatError:
            raise
        except InputError as error:
            raise self.error(f"{what}: {error}") from error
        except DAMAGE as error:
            raise self.error(f"{what}: damaged or incomplete, {error!r}") from error

    def error(self, message: str, row: int | np.intp | None = None) -> FileFormatError:
        """Return the error that names the file and the line; `row` counts from 0, the message from 1."""
        return line_error(self.path, message, row)


def line_error(path: Path, message: str, row: int | np.intp | None = None) -> FileFormatError:
    """Return the error of :meth:`Source.error`, for callers that do not keep the content in memory."""
    return FileFormatError(f"{path}: {message}" if row is None else f"{path}, line {row + 1}: {message}")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Stamped samples of a text."""

    source: Source
    rows: Rows  # lines of the n samples, counted from 0
    # In the file's own unit, shape (n,): int64 if all are whole numbers that fit, else float64.
    timestamps: NDArray[Any]
    values: FloatArray  # finite, shape (n, k)
    timestamp_cells: Callable[[], list[str]]  # returns the timestamps as they are written

    def check_range(self, unit: Decimal | int) -> None:
        """Raise `FileFormatError` at the first timestamp that does not fit int64 nanoseconds; `unit` is in ns."""
        # A little inside the limit, because float timestamps are rounded.
        limit = float((INT64_LIMIT - 2048) / unit)
        (beyond,) = np.nonzero((self.timestamps > limit) | (self.timestamps < -limit))
        if beyond.size:
            message = f"timestamp {self.timestamps[beyond[0]]} is beyond the int64 range of nanoseconds (292 years)"
            raise self.source.error(message, self.rows[beyond[0]])

    def nanoseconds(self, unit: Decimal | int) -> NDArray[np.int64]:
        """Return the timestamps as whole nanoseconds, halves rounded to even; `unit` is the file's unit in ns."""
        self.check_range(unit)
        whole = self.timestamps.dtype == np.int64
        if whole and unit == int(unit):
            return self.timestamps * np.int64(int(unit))
        exact = self.timestamps.tolist() if whole else self.timestamp_cells()
        return np.array([round(Decimal(timestamp) * unit) for timestamp in exact], np.int64)


def spread(rows: Rows, count: int) -> Rows:
    """Return at most `count` of `rows`, spread evenly from the first to the last."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(count, len(rows))).astype(np.intp))]


def separator_of(line: str) -> str | None:
    """Return what separates the cells of `line`: a semicolon, a comma, a bar, several tabs, or None for any spaces."""
    return next((mark for mark in ";,|" if mark in line), "\t" if line.count("\t") > 1 else None)


def _unix_ns(date: re.Match[str]) -> str:
    with suppress(ValueError):  # a date that does not exist stays as it is
        seconds = int(datetime.fromisoformat(date[1] + date[3]).timestamp())
        return f"{seconds * 10**9 + int(date[2].ljust(9, '0')[:9])}"
    return date[0]


def _has_decimal_commas(line: str) -> bool:
    """Whether `line` holds numbers like `1,5`, separated by semicolons or tabs: some countries write them so."""
    mark = ";" if ";" in line else "\t"
    return "," in line and mark in line and any(map(DECIMAL_COMMA.fullmatch, line.split(mark)))


def cells_of(line: str) -> list[str]:
    """Return the cells of `line` without spaces and quotes around them; a separator at its end adds no cell."""
    cells = [cell.strip().strip('"').strip() for cell in line.split(separator_of(line))]
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def is_number(cell: str) -> bool:
    """Whether `cell` is a number, NaN and infinity included."""
    return bool(NUMBER.fullmatch(cell) or NOT_FINITE.fullmatch(cell))


def read_table(source: Source, rows: Rows | Sequence[int], columns: Sequence[int]) -> Table:
    """Read `columns` (first the timestamp's, then the values') of `rows`."""
    rows = np.asarray(rows, dtype=np.intp)
    if not len(rows):
        raise source.error("the file contains no samples")
    separator = separator_of(source.lines[rows[0]])

    def cells(some: Rows, dtype: DTypeLike, places: Sequence[int] = columns) -> NDArray[Any]:
        lines = map(source.lines.__getitem__, some)
        with warnings.catch_warnings():
            # NumPy before 2.3 only warns when it drops the fraction of a number that is read as an integer.
            warnings.filterwarnings("error", r"loadtxt\(\): Parsing an integer", DeprecationWarning)
            return np.loadtxt(lines, dtype, delimiter=separator, comments=None, quotechar='"', usecols=places, ndmin=1)

    def samples(some: Rows, timestamp: str = "f8") -> NDArray[Any]:
        return cells(some, [("timestamp", timestamp), ("values", "f8", (len(columns) - 1,))])

    try:
        data = samples(rows, "i8")
    except ValueError:
        try:
            data = samples(rows)
        except ValueError as error:
            bad_cells = filter(None, (_bad_cell(source, row, columns) for row in rows.tolist()))
            raise next(bad_cells, source.error("cells must be numbers with decimal points", rows[0])) from error
    if len(data) < len(rows):
        row = next((row for row in rows if source.lines[row].count('"') % 2), rows[0])
        raise source.error("a quote is not closed, so that the lines after it would be part of the cell", row)
    (bad,) = np.nonzero(~(np.isfinite(data["timestamp"]) & np.isfinite(data["values"]).all(axis=1)))
    if bad.size and (failure := _bad_cell(source, int(rows[bad[0]]), columns)):
        raise failure
    # Copies, so that the timestamps can be freed before the values.
    return Table(
        source, rows, data["timestamp"].copy(), data["values"].copy(), lambda: cells(rows, str, columns[:1]).tolist()
    )


def _bad_cell(source: Source, row: int, columns: Sequence[int]) -> FileFormatError | None:
    """Return the error of a line, one of whose cells is missing or not a finite number."""
    cells = cells_of(source.lines[row])
    needed = max(columns) + 1
    if len(cells) < needed:
        return source.error(f"too few columns: {len(cells)} found, at least {needed} needed", row)
    bad = next((k for k in columns if not NUMBER.fullmatch(cells[k]) or math.isinf(float(cells[k]))), None)
    if bad is None:
        return None
    problem = "is not finite; remove the line" if is_number(cells[bad]) else "is not a number"
    return source.error(f"{cells[bad][:40]!r} in column {bad + 1} {problem}", row)
