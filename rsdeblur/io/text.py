"""Text files of numbers: read fast, and with the exact line named when that fails."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._validate import FloatArray
from rsdeblur.errors import FileFormatError

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
UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True, slots=True)
class TextFile:
    """A text file in memory.

    `rows` are the 0-based numbers of the lines that are neither blank nor comments (``#``); there is at least one.
    """

    path: Path
    lines: list[str]
    rows: list[int]

    @classmethod
    def parse(cls, path: Path, data: bytes, what: str) -> TextFile:
        """Decode the content of `path`; `what` says in messages what it should have been.

        Raises
        ------
        FileFormatError
            If it is empty or not text.
        """
        try:
            text = data.decode("utf-16" if data.startswith(UTF16_MARKS) else "utf-8-sig")
        except UnicodeDecodeError:
            text = "\0"
        if "\0" in text:
            raise FileFormatError(f"{path}: not a {what}: the file is binary, or text of another encoding than UTF-8")
        lines = text.split("\n")
        rows = [row for row, line in enumerate(map(str.lstrip, lines)) if line and line[0] != "#"]
        if not rows:
            raise FileFormatError(f"{path}: not a {what}: the file is empty{' but for comments' * ('#' in text)}")
        if _decimal_commas(lines[rows[-1]]):
            lines = [line.replace(",", ".") for line in lines]
        return cls(path, lines, rows)

    @property
    def head(self) -> str:
        """The first line that is neither blank nor a comment."""
        return self.lines[self.rows[0]]

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

    def error(self, message: str, row: int | None = None) -> FileFormatError:
        """Return the error that names the file and the line; `row` counts from 0, the message from 1."""
        where = f"{self.path}" if row is None else f"{self.path}, line {row + 1}"
        return FileFormatError(f"{where}: {message}")


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Stamped samples of a text file.

    `rows` says where each of the n samples stands; `stamps`, shape (n,), are exact in the file's own unit: int64, or
    `Decimal` objects where the file has fractions; `values`, shape (n, k), are finite.
    """

    text: TextFile
    rows: list[int]
    stamps: NDArray[Any]
    values: FloatArray

    def check_range(self, unit: Decimal) -> None:
        """Raise `FileFormatError` at the first stamp that, `unit` being the ns in its unit, does not fit int64."""
        # One unit short of the limit, so that rounding stays inside.
        limit = int(INT64_LIMIT / unit) - 1
        (beyond,) = np.nonzero((self.stamps > limit) | (self.stamps < -limit))
        if beyond.size:
            message = f"stamp {self.stamps[beyond[0]]} is beyond the int64 range of nanoseconds (292 years)"
            raise self.text.error(message, self.rows[beyond[0]])

    def nanoseconds(self, unit: Decimal) -> NDArray[np.int64]:
        """Return the stamps as integers, `unit` being the ns in one of the file's units; checks their range."""
        self.check_range(unit)
        if self.stamps.dtype == np.int64 and unit == int(unit):
            return np.asarray(self.stamps * np.int64(unit), dtype=np.int64)
        return np.array([round(Decimal(stamp) * unit) for stamp in self.stamps.tolist()], dtype=np.int64)


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


def read_table(text: TextFile, rows: list[int], columns: Sequence[int]) -> Table:
    """Read `columns` (the stamp's first, then the values') of `rows`.

    Raises
    ------
    FileFormatError
        If there are no rows, the last line is cut off, a row has too few columns, or a cell is not a finite number;
        names the first such line.
    """
    if not rows:
        raise text.error("the file holds no samples")
    _check_last(text, rows)
    separator = separator_of(text.lines[rows[0]])

    def parse(some: list[int], stamp: str) -> NDArray[Any]:
        dtype = np.dtype([("stamp", stamp), ("values", "f8", (len(columns) - 1,))])
        lines = [text.lines[row] for row in some]
        return np.loadtxt(lines, dtype, delimiter=separator, comments=None, quotechar='"', usecols=columns, ndmin=1)

    def parse_exact(some: list[int]) -> NDArray[Any]:
        return parse(some, f"S{STAMP_WIDTH}")

    try:
        data = parse(rows, "i8")
        stamps = data["stamp"]
    except ValueError:
        # Stamps with a fraction are read as text, so that they stay exact.
        try:
            data = parse_exact(rows)
        except ValueError as error:
            raise _unreadable(text, _first_failure(rows, parse_exact), columns) from error
        stamps = _decimals(text, rows, [stamp.decode("latin-1") for stamp in data["stamp"].tolist()])
    values = data["values"]
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        sample, k = bad[0]
        message = f"the sample is not finite: {values[sample, k]} in column {columns[k + 1] + 1}; remove the line"
        raise text.error(message, rows[sample])
    return Table(text, rows, stamps, values)


def _decimals(text: TextFile, rows: list[int], stamps: list[str]) -> NDArray[Any]:
    for row, stamp in zip(rows, stamps, strict=True):
        exponent = stamp.lower().partition("e")[2]
        if not NUMBER.fullmatch(stamp) or len(stamp) == STAMP_WIDTH or len(exponent) > EXPONENT_WIDTH:
            raise text.error(f"the stamp {stamp!r} is not a finite number", row)
    return np.array([Decimal(stamp) for stamp in stamps], dtype=object)


def _first_failure(rows: list[int], parse: Callable[[list[int]], object]) -> int:
    """Return the first of `rows` that `parse` raises ValueError at, by halving."""
    while len(rows) > 1:
        half = len(rows) // 2
        try:
            parse(rows[:half])
        except ValueError:
            rows = rows[:half]
        else:
            rows = rows[half:]
    return rows[0]


def _check_last(text: TextFile, rows: list[int]) -> None:
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
