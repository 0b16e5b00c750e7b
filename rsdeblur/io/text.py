"""Text files of numbers: read fast, and with the exact line named when that fails."""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import FileFormatError
from rsdeblur.types import FloatArray

NUMBER = re.compile(r"\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)

# Longest stamp kept, in characters; 19 digits, a point and an exponent need 30.
STAMP_WIDTH = 48
# Sign and zeros included; Decimal has its limits too.
EXPONENT_WIDTH = 10
INT64_LIMIT = 2**63
# A header stands among the first lines; some apps write a few about the recording above it.
PREAMBLE = 20
# A longer line names no columns: that of a ROS topic with all its covariances has 1500 characters.
HEADER_WIDTH = 4096
# A file that is no table, such as a camera's, has no more characters that matter.
START = 2**20
# Bytes in which line breaks are sought, and lines that are parsed, at a time.
CHUNK, BLOCK = 2**24, 2**16
# Powers of ten that fit int64.
COUNTED_DECIMALS = 18
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


Rows = NDArray[np.intp]


class Lines(Sequence[str]):
    """The lines of a text, made when they are looked at: as strings, those of a long log take ten times its size."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        values = np.frombuffer(data, np.uint8)
        breaks = [np.flatnonzero(values[i : i + CHUNK] == ord("\n")) + i for i in range(0, len(data), CHUNK)]
        self._ends = np.concatenate([*breaks, [len(data)]])

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> list[str]: ...
    def __getitem__(self, place: int | slice) -> str | list[str]:
        found = range(len(self))[place]
        return self.at(found) if isinstance(found, range) else self.at([found])[0]

    def at(self, rows: Rows | Sequence[int]) -> list[str]:
        """Return the lines of those numbers, which increase."""
        if not len(rows):
            return []
        first, last = int(rows[0]), int(rows[-1])
        start = self._ends[first - 1] + 1 if first else 0
        lines = self._data[start : self._ends[last]].decode().split("\n")
        return lines if len(lines) == len(rows) else [lines[row - first] for row in rows]

    def of(self, rows: Rows) -> Iterator[str]:
        """Return the lines of those numbers, which increase, a part at a time."""
        return (line for part in blocks(rows) for line in self.at(part))

    def filled(self) -> Rows:
        """Return the numbers of the lines that are neither blank nor comments (``#``)."""
        starts = np.concatenate([[0], self._ends[:-1] + 1])
        (rows,) = np.nonzero(starts < self._ends)
        first = np.frombuffer(self._data, np.uint8)[starts[rows]]
        filled = first != ord("#")
        # What begins with a space, of which Unicode has many, tells by what comes after it.
        (unsure,) = np.nonzero((first <= ord(" ")) | (first >= 0x80))
        for part in blocks(unsure):
            lines = map(str.lstrip, self.at(rows[part]))
            filled[part] = [line != "" and line[0] != "#" for line in lines]
        found: Rows = rows[filled]
        return found


def blocks(rows: Rows) -> Iterator[Rows]:
    """Cut `rows` into parts whose lines are worked on at a time."""
    return (rows[i : i + BLOCK] for i in range(0, len(rows), BLOCK))


@dataclass(frozen=True, slots=True, eq=False)
class TextFile:
    """A text file in memory.

    `rows` are the 0-based numbers of the lines that are neither blank nor comments (``#``); there is at least one.
    `start` is as much of the text as a file has that is not a table.
    """

    path: Path
    lines: Lines
    rows: Rows
    start: str

    @classmethod
    def parse(cls, path: Path, data: bytes, what: str) -> TextFile:
        """Decode the content of `path`; `what` says in messages what it should have been.

        Raises
        ------
        FileFormatError
            If it is empty or not text.
        """
        try:
            if data.startswith(UTF16_MARKS):
                data = data.decode("utf-16").encode()
            data = data.removeprefix(codecs.BOM_UTF8)
            if not data.isascii():
                data.decode()
        except UnicodeDecodeError:
            data = b"\0"
        if b"\0" in data:
            raise FileFormatError(f"{path}: not a {what}: the file is binary, or text of another encoding than UTF-8")
        lines = Lines(data)
        rows = lines.filled()
        if not len(rows):
            raise FileFormatError(f"{path}: not a {what}: the file is empty{' but for comments' * (b'#' in data)}")
        if _decimal_commas(lines[rows[-1]]):
            lines = Lines(data.replace(b",", b"."))
        return cls(path, lines, rows, data[:START].decode(errors="ignore"))

    @property
    def head(self) -> str:
        """The first line that is neither blank nor a comment."""
        return self.lines[int(self.rows[0])]

    @property
    def headers(self) -> list[tuple[str, int]]:
        """Lines that may name the columns, each with the place in `rows` of what follows it.

        These are the first lines that are not all numbers, or, where there are none, the comments above.
        """
        named: list[tuple[str, int]] = []
        for i, row in enumerate(self.rows[:PREAMBLE]):
            if len(self.lines[row]) > HEADER_WIDTH or all(map(is_number, cells_of(self.lines[row]))):
                break
            named.append((self.lines[row].lstrip("% "), i + 1))
        above = (line.lstrip().removeprefix("#") for line in reversed(self.lines[: self.rows[0]]))
        return named or [(line, 0) for line in islice(above, PREAMBLE) if line.strip() and len(line) <= HEADER_WIDTH]

    def error(self, message: str, row: int | np.intp | None = None) -> FileFormatError:
        """Return the error that names the file and the line; `row` counts from 0, the message from 1."""
        return line_error(self.path, message, row)


def line_error(path: Path, message: str, row: int | np.intp | None = None) -> FileFormatError:
    """Return the error of :meth:`TextFile.error`, for who does not hold on to the text."""
    return FileFormatError(f"{path}: {message}" if row is None else f"{path}, line {row + 1}: {message}")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Stamped samples of a text file.

    `rows` says where each of the n samples stands; `stamps`, shape (n,), are exact in the file's own unit: int64 counts
    of its `decimals`-th decimal place, or `Decimal` objects where these do not do; `values`, shape (n, k), are finite.
    """

    text: TextFile
    rows: Rows
    stamps: NDArray[Any]
    decimals: int
    values: FloatArray

    def check_range(self, unit: Decimal) -> None:
        """Raise `FileFormatError` at the first stamp that, `unit` being the ns in its unit, does not fit int64."""
        # One unit short of the limit, so that rounding stays inside.
        limit = (int(INT64_LIMIT / unit) - 1) * 10**self.decimals
        (beyond,) = np.nonzero((self.stamps > limit) | (self.stamps < -limit))
        if beyond.size:
            (stamp,) = self.stamps[beyond[:1]].tolist()
            stamp = _exact(stamp, self.decimals)
            message = f"stamp {stamp} is beyond the int64 range of nanoseconds (292 years)"
            raise self.text.error(message, self.rows[beyond[0]])

    def nanoseconds(self, unit: Decimal) -> NDArray[np.int64]:
        """Return the stamps as integers, `unit` being the ns in one of the file's units; checks their range."""
        self.check_range(unit)
        unit = unit.scaleb(-self.decimals)
        times, over = unit.as_integer_ratio()
        if self.stamps.dtype != np.int64 or max(_largest(self.stamps) * times, 2 * over) >= INT64_LIMIT:
            return np.array([round(Decimal(stamp) * unit) for stamp in self.stamps.tolist()], dtype=np.int64)
        whole, rest = np.divmod(self.stamps * np.int64(times), np.int64(over))
        # Halves go to the even neighbour, as `round` has it.
        rounded: NDArray[np.int64] = whole + (2 * rest + (whole & 1) > over)
        return rounded


def separator_of(line: str) -> str | None:
    """Return what parts the cells of `line`: a semicolon, a comma, a bar, or None for spaces and tabs."""
    return next((mark for mark in ";,|" if mark in line), None)


def _decimal_commas(line: str) -> bool:
    """Whether `line` is of numbers like `1,5`, parted by semicolons or tabs, as some apps write in some countries."""
    mark = ";" if ";" in line else "\t"
    cells = [cell.strip() for cell in line.split(mark)]
    return "," in line and len(cells) > 1 and all(is_number(cell.replace(",", ".", 1)) for cell in cells)


def cells_of(line: str) -> list[str]:
    """Return the cells of `line` without the spaces and quotes around them, nor what a separator at its end adds."""
    separator = separator_of(line)
    if separator is None and "\t" in line and not all(map(is_number, line.split())):
        separator = "\t"  # names have spaces in them
    cells = [cell.strip().strip('"').strip() for cell in line.split(separator)]
    return cells[:-1] if len(cells) > 1 and not cells[-1] else cells


def find_columns(header: str, wanted: Sequence[re.Pattern[str]]) -> list[int] | None:
    """Return which cell of `header`, in lower case, fully matches each pattern; None if one has no match."""
    names = [cell.lower() for cell in cells_of(header)]
    found = [next((k for k, name in enumerate(names) if want.fullmatch(name)), -1) for want in wanted]
    return None if -1 in found else found


def is_number(cell: str) -> bool:
    """Whether `cell` is a number, NaN and infinity included."""
    return bool(NUMBER.fullmatch(cell) or NOT_FINITE.fullmatch(cell))


def read_table(text: TextFile, rows: Rows | Sequence[int], columns: Sequence[int]) -> Table:
    """Read `columns` (the stamp's first, then the values') of `rows`.

    Raises
    ------
    FileFormatError
        If there are no rows, the last line is cut off, a row has too few columns, or a cell is not a finite number;
        names such a line.
    """
    rows = np.asarray(rows, dtype=np.intp)
    if not len(rows):
        raise text.error("the file holds no samples")
    _check_last(text, rows)
    separator = separator_of(text.lines[rows[0]])
    stamps, values = list[_Stamps](), np.empty((len(rows), len(columns) - 1))
    for i, part in zip(range(0, len(rows), BLOCK), blocks(rows), strict=True):
        found, values[i : i + BLOCK] = _read_block(text, part, columns, separator)
        stamps.append(found)
    return Table(text, rows, *_joined(stamps), values)


# Counts and their decimals, or `Decimal` objects and 0.
_Stamps = tuple[NDArray[Any], int]


def _read_block(text: TextFile, rows: Rows, columns: Sequence[int], mark: str | None) -> tuple[_Stamps, FloatArray]:
    def parse(some: Rows, stamp: str) -> NDArray[Any]:
        dtype = np.dtype([("stamp", stamp), ("values", "f8", (len(columns) - 1,))])
        lines = text.lines.at(some)
        return np.loadtxt(lines, dtype, delimiter=mark, comments=None, quotechar='"', usecols=columns, ndmin=1)

    def parse_exact(some: Rows) -> NDArray[Any]:
        return parse(some, f"S{STAMP_WIDTH}")

    try:
        data = parse(rows, "i8")
    except ValueError:
        # Stamps with a fraction are read as text, so that they stay exact.
        try:
            data = parse_exact(rows)
        except ValueError as error:
            raise _unreadable(text, _first_failure(rows, parse_exact), columns) from error
    if len(data) < len(rows):
        row = next((row for row, line in zip(rows, text.lines.of(rows), strict=True) if line.count('"') % 2), rows[0])
        raise text.error("a quote is not closed, so that the lines after it would be part of the cell", row)
    stamps, values = data["stamp"], data["values"]
    if stamps.dtype == np.int64:
        found: _Stamps = stamps, 0
    else:
        found = _counts(stamps) or (_decimals(text, rows, stamps), 0)
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        sample, k = bad[0]
        message = f"the sample is not finite: {values[sample, k]} in column {columns[k + 1] + 1}; remove the line"
        raise text.error(message, rows[sample])
    return found, values


def _counts(stamps: NDArray[np.bytes_]) -> _Stamps | None:
    """Return stamps as counts of their last decimal place; None if one is no such number, or longer than fits."""
    whole, _, fraction = np.strings.partition(np.strings.strip(stamps), b".")
    digits = np.strings.add(np.strings.lstrip(whole, b"+-"), fraction)
    decimals = int(np.strings.str_len(fraction).max())
    cut_off = np.strings.str_len(stamps).max() == STAMP_WIDTH
    if cut_off or decimals > COUNTED_DECIMALS or not np.strings.isdigit(digits).all():
        return None
    try:
        return np.strings.add(whole, np.strings.ljust(fraction, decimals, b"0")).astype(np.int64), decimals
    except (ValueError, OverflowError):
        return None


def _joined(parts: Sequence[_Stamps]) -> _Stamps:
    """Return all stamps, with as many decimals as any part has."""
    decimals = max(places for _, places in parts)
    if all(counts.dtype == np.int64 and _largest(counts) * 10 ** (decimals - n) < INT64_LIMIT for counts, n in parts):
        return np.concatenate([counts * np.int64(10 ** (decimals - n)) for counts, n in parts]), decimals
    return np.array([_exact(count, n) for counts, n in parts for count in counts.tolist()], dtype=object), 0


def _exact(count: int | Decimal, decimals: int) -> Decimal:
    # Even by zero places, Decimal would round what is long, and refuse what is huge.
    return Decimal(count).scaleb(-decimals) if decimals else Decimal(count)


def _largest(counts: NDArray[np.int64]) -> int:
    return max(abs(int(counts.min())), abs(int(counts.max())))


def _decimals(text: TextFile, rows: Rows, stamps: NDArray[np.bytes_]) -> NDArray[Any]:
    found = [stamp.decode("latin-1") for stamp in stamps.tolist()]
    for row, stamp in zip(rows, found, strict=True):
        exponent = stamp.lower().partition("e")[2]
        if not NUMBER.fullmatch(stamp) or len(stamp) == STAMP_WIDTH or len(exponent) > EXPONENT_WIDTH:
            raise text.error(f"the stamp {stamp!r} is not a finite number", row)
    return np.array([Decimal(stamp) for stamp in found], dtype=object)


def _first_failure(rows: Rows, parse: Callable[[Rows], object]) -> int:
    """Return the first of `rows` that `parse` raises ValueError at, by halving."""
    while len(rows) > 1:
        half = len(rows) // 2
        try:
            parse(rows[:half])
        except ValueError:
            rows = rows[:half]
        else:
            rows = rows[half:]
    return int(rows[0])


def _check_last(text: TextFile, rows: Rows) -> None:
    # A file cut off in its last number alone cannot be told from a whole one without a final line break.
    if len(rows) < 2 or rows[-1] < len(text.lines) - 1:
        return
    before, last = (len(cells_of(text.lines[row])) for row in rows[-2:])
    if last < before:
        raise text.error(
            f"the last line is cut off: {last} of {before} columns; copy the file again or delete the line", rows[-1]
        )


def _unreadable(text: TextFile, row: int, columns: Sequence[int]) -> FileFormatError:
    cells = cells_of(text.lines[row])
    needed = max(columns) + 1
    if len(cells) < needed:
        return text.error(f"too few columns: {len(cells)} found, at least {needed} needed", row)
    bad = next((k for k in columns if not is_number(cells[k])), columns[0])
    return text.error(f"{cells[bad][:40]!r} in column {bad + 1} is not a number", row)
