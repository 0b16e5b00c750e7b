"""Columns of text tables: chosen by the user, found by name and unit, or as the one that rises like time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rsdeblur.errors import InputError
from rsdeblur.io.source import LAYOUT_ROWS, Rows, Source, Table, cells_of, is_number, spread
from rsdeblur.motion.units import (
    ACCELERATION_SPELLINGS,
    FASTEST,
    RATE_SPELLINGS,
    SECONDS,
    SLOWEST,
    TIME_SPELLINGS,
    UNIT_OF,
    spacing_of,
    units_of_time,
)
from rsdeblur.types import FloatArray

# Nanoseconds in each unit of time that a log may use.
TIME_UNITS = {unit: round(1e9 * seconds) for unit, seconds in SECONDS.items()}

# Names of columns, in lower case and reduced to letters. ROS stamps a message when the sensor measured, and again when
# the recorder received it. Sensor Logger's second clock is for tables without another.
TIMES = (
    re.compile("(field)?headerstamp"),
    re.compile(
        "(sensor|event|sampling|elapsed|gyro|motion|unix|epoch)?(t|ts|time|timestamp|stamp)(since(reboot|start|boot))?"
        "|timeintervalsince|zeit|temps|tiempo|tempo"
    ),
    re.compile("(seconds|time)elapsed|elapsed(seconds|time)?"),
)
GYRO = (
    "w|omega|g|gyr|gyro|gyrorad|gyroscope|gyroskop|giroscopio|gyrorotation|(motion)?rotationrate"
    "|(field)?angular(velocity|rate)|angvel|wrss"
)
# A column that says whose sample a row is.
SENSOR = re.compile("(sensor|device)(type|name|id)?|type")
# Without gravity ("linear", "user"), accelerations are of no use.
ACCELEROMETER = (
    "a|alpha|acc|accl|accel|accelero(meter)?|acceleration|beschleunigung|total(acc|acceleration)|arss"
    "|(field)?linearacceleration"
)

# Units that may follow a name without brackets: `t_ns`, `gx_deg/s`, `Time since start in ms`.
SUFFIX = re.compile(rf"(.*?)(?:_| in )({'|'.join(map(re.escape, UNIT_OF))})\s*")
# Programs for flights count axes: `gyro_rad[0]`.
INDEX = re.compile(r"\[([012])\]$")

# Longest cell that may be a name: the patterns take time in proportion to the square of the length.
CELL_WIDTH = 100
# Words in the names of timestamps, for guesses.
STAMPS = re.compile(r"time|stamp|\bts?\b|clock|micros|millis")
# Longest list of columns in a message, characters.
LIST_WIDTH = 400

# `name=column` or `name=column:unit`, of which commas separate several.
CHOICE = re.compile(
    rf"(\w+)\s*=\s*([^=]+?)\s*(?::\s*({'|'.join(map(re.escape, UNIT_OF))}))?\s*(?:,\s*(?=\w+\s*=)|$)", re.IGNORECASE
)
# The columns that users choose, by kind of file. A choice is for the first kind that has them all.
CHOICES = {
    "capture file": ("t", "exposure"),
    "gyro log": ("t", "gx", "gy", "gz", "ax", "ay", "az"),
    "trajectory": ("t", "x", "y", "z", "qx", "qy", "qz", "qw"),
}


@dataclass(frozen=True, slots=True)
class Quantity:
    """Columns that a reader looks for beside that of the timestamps.

    `names` are those by which users choose them, `patterns` the usual ones in headers, `spellings` their units. A table
    may lack the last `optional` ones. `hint` is a pattern of words in names that are not the usual ones.
    """

    names: tuple[str, ...]
    patterns: tuple[re.Pattern[str], ...]
    spellings: Mapping[str, str]
    hint: str
    optional: int = 0
    times: tuple[re.Pattern[str], ...] = TIMES

    @classmethod
    def of(cls, letter: str, word: str, spellings: Mapping[str, str], hint: str) -> Quantity:
        """Return the quantity whose columns are called `word`, before or after the axis."""
        patterns = tuple(re.compile(rf"({word}){axis}(axis)?|{axis}({word})") for axis in "xyz")
        return cls(tuple(letter + axis for axis in "xyz"), patterns, spellings, hint)

    @property
    def bare(self) -> Quantity:
        """The quantity whose columns may also be called x, y and z alone."""
        names = (re.compile(rf"{axis}(axis)?|{each.pattern}") for axis, each in zip("xyz", self.patterns, strict=True))
        return replace(self, patterns=tuple(names))


RATE = Quantity.of("g", GYRO, RATE_SPELLINGS, "gyr|omega|ang|rot|rate|^w|^g")
ACCELERATION = Quantity.of("a", ACCELEROMETER, ACCELERATION_SPELLINGS, "acc")


@dataclass(frozen=True, slots=True)
class Columns:
    """Places of the timestamps and the values among the columns of a table, from 0, and their units if it names them.

    The place of the timestamps is -1 in a table without them. `start` is the place of the first sample among the rows,
    `header` the line that names the columns. `is_named` says that the columns name the sensor.
    """

    places: tuple[int, ...]
    units: tuple[str | None, ...] = (None,) * 8
    start: int = 0
    header: str = ""
    is_named: bool = False

    @property
    def names(self) -> list[str]:
        """Names of all columns, reduced to letters; empty without a header."""
        return [Cell.of(cell).name for cell in cells_of(self.header)] if self.header else []

    def option(self, quantity: Quantity, time_unit: str = "") -> str:
        """Return the option that chooses these columns, with a unit of time if one is given."""
        unit = f":{time_unit}" if time_unit else ""
        places = zip(("t", *quantity.names), self.places, strict=False)
        return "--columns " + ",".join(f"{name}={k + 1}{unit * (name == 't')}" for name, k in places if k >= 0)


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a header, such as `t_ns`, `gx[rad/s]`, `Gyroscope x (rad/s)`, `gyro_rad[0]`.

    The name is in lower case and reduced to letters; `unknown` says that the cell names a unit, but none of `UNIT_OF`.
    """

    name: str
    unit: str | None
    unknown: bool

    @classmethod
    def of(cls, text: str) -> Cell:
        """Return the parts of a cell."""
        if len(text) > CELL_WIDTH:
            return cls("", None, True)
        axis, text = "", text.lower()
        if index := INDEX.search(text):
            axis, text = "xyz"[int(index[1])], text[: index.start()]
        match = re.fullmatch(r"(.*?)\s*[\[(](.*?)[\])]", text)
        if match is None:
            match = SUFFIX.fullmatch(text)
        name, unit = match.groups() if match else (text, "")
        if len(name) > 1 and not unit and UNIT_OF.get(name) in TIME_SPELLINGS:
            name, unit = "t", name  # the clock of small computers: `millis`
        known = UNIT_OF.get(re.sub(r"\s", "", unit))
        return cls(re.sub(r"[^a-z]", "", name) + axis, known, bool(unit) and known is None)


def named_columns(source: Source, values: Quantity = RATE, *, stamped: bool = True) -> Columns | None:
    """Return the columns named by a header; None if no line names the values and, if `stamped`, the timestamps."""
    for line, start in source.headers:
        cells = [Cell.of(cell) for cell in cells_of(line)]
        first = cells_of(source.lines[source.rows[start]]) if start < len(source.rows) else []

        def place(pattern: re.Pattern[str], units: Mapping[str, str]) -> int:
            fits = [
                k
                for k, cell in enumerate(cells)  # noqa: B023
                if pattern.fullmatch(cell.name) and not cell.unknown and (cell.unit is None or cell.unit in units)
            ]
            # Beside timestamps there may be dates.
            return next((k for k in fits if is_number("".join(first[k : k + 1]))), next(iter(fits), -1))  # noqa: B023

        t = next((k for pattern in values.times if (k := place(pattern, TIME_SPELLINGS)) >= 0), -1)
        places = [place(pattern, values.spellings) for pattern in values.patterns]
        needed = len(places) - values.optional
        # A longer header is a line about other lines, as in flight logs.
        is_header = not first or max(places) < len(first)
        if is_header and -1 not in places[:needed] and (t >= 0) is stamped:
            places = [t, *(places[:needed] if -1 in places else places)]
            units = tuple(cells[k].unit if k >= 0 else None for k in places)
            return Columns(tuple(places), units, start, line, is_named=True)
    return None


def choices_of(columns: str) -> dict[str, dict[str, tuple[str, str | None]]]:
    """Return the chosen columns and their units, by kind of file and by name; semicolons separate kinds."""
    chosen = {}
    for part in columns.split(";"):
        pairs = {name: (column, UNIT_OF.get(unit.lower())) for name, column, unit in CHOICE.findall(part.strip())}
        kind = next((kind for kind, known in CHOICES.items() if pairs.keys() <= set(known)), None)
        if kind is None or not pairs:
            known = "; ".join(f"{', '.join(names)} of a {kind}" for kind, names in CHOICES.items())
            raise InputError(f"columns: {part.strip()!r} is not like t=time:us,gx=3,gy=4,gz=5; there are {known}")
        chosen[kind] = pairs
    return chosen


def choice_for(kind: str, columns: str | None) -> str | None:
    """Return a choice of columns if it has a part for this kind of file, else None."""
    return columns if columns is not None and kind in choices_of(columns) else None


def chosen_columns(source: Source, columns: str, kind: str, values: Quantity, *, stamped: bool = True) -> Columns:
    """Return the columns of a table of this kind that the user chose, by names or by numbers from 1."""
    chosen = choices_of(columns).get(kind, {})
    needed = [*["t"] * stamped, *values.names[: len(values.names) - values.optional]]
    if missing := [name for name in needed if name not in chosen]:
        raise InputError(f"columns: {columns!r} lacks {', '.join(missing)} of the {kind}")
    names = [name for name in ("t", *values.names) if name in chosen]
    known = {name: TIME_SPELLINGS if name == "t" else values.spellings for name in names}
    if wrong := [f"{chosen[name][1]} of {name}" for name in names if chosen[name][1] not in (None, *known[name])]:
        raise InputError(f"columns: {wrong[0]} is a wrong unit: {columns!r}")
    wanted = {name: _plain(chosen[name][0]) for name in names}
    words = {column for column in wanted.values() if not column.isdecimal()}
    lines = [*source.headers, ("", 0)]
    header, start = next(((line, after) for line, after in lines if words <= set(_cells(line))), ("", -1))
    if start < 0:
        words -= {cell for line, _ in lines for cell in _cells(line)}
        raise source.error(f"no column of a header is called {' or '.join(sorted(words))!r}; {listed(source)}")
    header, start = (header, start) if words else ("", 0)
    places = {
        name: int(column) - 1 if column.isdecimal() else _cells(header).index(column) for name, column in wanted.items()
    }
    rows = enumerate((cells_of(source.lines[row]) for row in source.rows[start:]), start)
    start = next((i for i, row in rows if all(is_number("".join(row[k : k + 1])) for k in places.values())), -1)
    if start < 0:
        raise source.error(f"no line has numbers in all columns of {columns!r}; {listed(source)}")
    above = [cells_of(line) for line in (header, next((line for line, after in lines if after == start), ""))]

    def unit(name: str) -> str | None:
        units = (Cell.of(cell).unit for cells in above for cell in cells[places[name] : places[name] + 1])
        return chosen[name][1] or next((unit for unit in units if unit in known[name]), None)

    timeless = ["t"] * ("t" not in places)
    units = (*[None for _ in timeless], *map(unit, names))
    return Columns((*[-1 for _ in timeless], *places.values()), units, start, header, is_named=True)


def _cells(header: str) -> list[str]:
    return [_plain(cell) for cell in cells_of(header)]


def _plain(name: str) -> str:
    return name.strip().lstrip("%# ").lower()


def _table(source: Source) -> tuple[list[str], list[str]]:
    """Return the names of the columns of an unknown table, empty without a header, and its first row."""
    rows = [cells_of(source.lines[row]) for row in source.rows[:LAYOUT_ROWS]]
    start = max(range(len(rows)), key=lambda i: sum(map(is_number, rows[i])))
    above = next((cells_of(line) for line, after in source.headers if after == start), [])
    return [cell.lstrip("# ") for cell in above] if len(above) == len(rows[start]) else [], rows[start]


def is_table(source: Source) -> bool:
    """Whether half of the first lines have several numbers."""
    counts = [sum(map(is_number, cells_of(source.lines[row]))) for row in source.rows[:LAYOUT_ROWS]]
    return 2 * sum(count > 1 for count in counts) >= len(counts)


def listed(source: Source) -> str:
    """Return the columns of a table for messages, with their numbers."""
    names, row = _table(source)
    found = ", ".join(f"{k} {name}" for k, name in enumerate(names or row, 1))
    return f"the columns are {found[:LIST_WIDTH]}{'...' * (len(found) > LIST_WIDTH)}"


def guessed_option(source: Source, values: Quantity) -> str:
    """Return the option that names the columns of an unknown table, with `?` for those that cannot be guessed."""
    names, row = _table(source)
    words = [name.lower().replace("roll", "x").replace("pitch", "y").replace("yaw", "z") for name in names]
    words = words or [""] * len(row)
    numeric, grid = [k for k, cell in enumerate(row) if is_number(cell)], layout_grid(source, len(row))
    stamps = [k for k in numeric if STAMPS.search(words[k])] or ([] if grid is None else rising(grid)) or [-1]
    wanted = values.names[: len(values.names) - values.optional] or values.names
    groups: dict[str, list[int]] = {}
    for k in numeric:
        if k != stamps[0]:
            groups.setdefault(re.sub("[xyz0-9]", "", words[k]), []).append(k)
    fits = (
        sorted(group, key=words.__getitem__)
        for hint in values.hint.split("|")
        for group in groups.values()
        if len(group) == len(wanted) and (not names or re.search(hint, words[group[0]]))
    )
    places = (stamps[0], *next(fits, [-1] * len(wanted)))
    return "--columns " + ",".join(f"{name}={k + 1 or '?'}" for name, k in zip(("t", *wanted), places, strict=True))


def check_layout(source: Source, rows: Rows, columns: Columns) -> None:
    """Raise `FileFormatError` if rows have more cells than the header, are of several sensors, or time falls."""
    some, named = spread(rows, LAYOUT_ROWS), len(columns.names)
    cells = [cells_of(source.lines[row]) for row in some]
    for row, found in zip(some, cells, strict=True):
        if 0 < named < len(found):
            raise source.error(
                f"{len(found)} cells, but the header names {named} columns; if the numbers have decimal "
                "commas, separate the columns by semicolons or tabs",
                row,
            )
    for k, name in enumerate(columns.names):
        if SENSOR.fullmatch(name) and len({found[k] for found in cells if k < len(found)}) > 1:
            raise source.error(f"column {k + 1} names several sensors; keep the lines of one only", some[0])
    place = columns.places[0]
    width = min([64, *map(len, cells)])  # the columns of any sensor log, and a bound on the work for other files
    grid = np.array([[float(cell) if is_number(cell) else np.nan for cell in found[:width]] for found in cells])
    if cells and 0 <= place < width:
        times, others = grid[:, place], rising(grid)
        # A few samples may have come late.
        if others and len(times) > 1 and not (np.mean(np.diff(times) >= 0) > 0.9 and times[-1] > times[0]):
            raise source.error(
                f"column {place + 1} was taken as time, but does not rise, unlike "
                f"column {others[0] + 1}; choose: --columns t={others[0] + 1},...",
                some[0],
            )


def unit_of_time(
    table: Table, columns: Columns, quantity: Quantity, rates: tuple[float, float] = (SLOWEST, FASTEST)
) -> str:
    """Return the unit in which the timestamps of a table rise at one of `rates`, Hz; refuse none and several."""
    # Timestamps that fit as nanoseconds fit in every unit, and their differences do not overflow.
    table.check_range(TIME_UNITS["ns"])
    if len(table.rows) < 2:
        raise table.source.error("a log needs at least 2 samples, got 1", table.rows[0])
    fits = units_of_time(table.timestamps, rates)
    if len(fits) == 1:
        return fits[0]
    spacing = spacing_of(table.timestamps)
    shown = " or ".join(f"{unit} ({1 / (spacing * SECONDS[unit]):.3g} Hz)" for unit in fits)
    raise table.source.error(
        f"cannot determine the unit of time: samples {spacing:.6g} apart fit {shown or 'none of s, ms, us, ns'}; check "
        f"column {columns.places[0] + 1}, or give its unit: {columns.option(quantity, (fits or ['s'])[0])}"
    )


def layout_grid(source: Source, columns: int) -> FloatArray | None:
    """Return some rows of a table, spread over it; None unless the first and most others are `columns` numbers."""
    cells = [cells_of(source.lines[row]) for row in spread(source.rows, LAYOUT_ROWS)]
    fitting = [row for row in cells if len(row) == columns and all(map(is_number, row))]
    if not fitting or fitting[0] is not cells[0] or 2 * len(fitting) < len(cells):
        return None
    return np.array(fitting, dtype=np.float64)


def rising(grid: FloatArray) -> list[int]:
    """Return the columns that never fall, and rise as a whole."""
    if len(grid) < 2:
        return []
    (columns,) = np.nonzero((np.diff(grid, axis=0) >= 0).all(axis=0) & (grid[-1] > grid[0]))
    return [int(k) for k in columns]


def time_column(grid: FloatArray) -> int:
    """Return the column of timestamps of a table without a header: the only one that always rises, else the first."""
    columns = rising(grid)
    if len(columns) != 1:
        return 0
    steps = np.unique(np.diff(grid[:, columns[0]]))
    # In a short table a rate may rise by chance (in ten rows, in one of 10! orders), but not evenly.
    even = 0.5 * steps[-1] <= steps[steps > 0][0]
    return columns[0] if even or len(grid) >= 10 else 0
