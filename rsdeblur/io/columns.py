"""Columns of text tables: found by name, by their units, or as the one that rises like time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from rsdeblur.io.text import LAYOUT_ROWS, Rows, Table, TextFile, cells_of, is_number, spread
from rsdeblur.types import FloatArray

# Nanoseconds in each unit of time that a log may use.
TIME_UNITS = {"s": Decimal(10**9), "ms": Decimal(10**6), "us": Decimal(10**3), "ns": Decimal(1)}
# A gyro samples at 20 Hz to 8 kHz. The sample spacings (ns) then lie within a factor of 400, less than the 1000
# between the units, so a spacing fits at most one unit.
SPACING = (125_000, 50_000_000)

# Spellings of units, without spaces and in lower case.
TIME_SPELLINGS = {
    "s": "s sec secs second seconds",
    "ms": "ms msec millisec milliseconds",
    "us": "us µs μs usec microsec microseconds",
    "ns": "ns nsec nanosec nanoseconds",
}
RATE_SPELLINGS = {
    "rad/s": "rad/s rads rads^-1 rads-1 rads⁻¹ rad·s⁻¹ rad*s^-1 rad/sec radians/s radians/sec radianspersecond rad_s",
    "deg/s": "deg/s degs^-1 degs-1 degs⁻¹ deg/sec °/s °s⁻¹ º/s °/sec dps degrees/s degrees/sec degreespersecond deg_s",
    "mrad/s": "mrad/s",
    "mdeg/s": "mdeg/s mdps",
}
ACCELERATION_SPELLINGS = {
    "m/s^2": "m/s^2 m/s2 m/s² ms^-2 ms-2 ms⁻² m*s^-2 m/s/s mps2 m/sec^2",
    "g": "g",
    "mg": "mg",
}
LENGTH_SPELLINGS = {"m": "m meter meters metre metres"}
UNIT_OF = {
    spelling: unit
    for spellings in (TIME_SPELLINGS, RATE_SPELLINGS, ACCELERATION_SPELLINGS, LENGTH_SPELLINGS)
    for unit, words in spellings.items()
    for spelling in words.split()
}

# Names of columns, in lower case and reduced to letters.
TIME = re.compile(
    "(sensor|event|sampling|elapsed|gyro|motion|unix|epoch)?(t|ts|time|timestamp|stamp)(since(reboot|start|boot))?"
    "|zeit|temps|tiempo|tempo"
)
# Sensor Logger's second clock, for tables without another.
ELAPSED = re.compile("(seconds|time)elapsed|elapsed(seconds|time)?")
GYRO = (
    "w|omega|g|gyr|gyro|gyroscope|gyroskop|giroscopio|gyrorotation|(motion)?rotationrate"
    "|(field)?angular(velocity|rate)|angvel|wrss"
)
# A column that says whose sample a row is.
SENSOR = re.compile("(sensor|device)(type|name|id)?|type")
# Without gravity ("linear", "user"), accelerations are of no use.
ACCELEROMETER = "a|alpha|acc|accl|accel|accelero(meter)?|acceleration|beschleunigung|total(acc|acceleration)|arss"

# Units that may follow a name without brackets: `t_ns`, `gx_deg/s`, `Time since start in ms`.
SUFFIX = re.compile(rf"(.*?)(?:_| in )({'|'.join(map(re.escape, UNIT_OF))}|rad_s|deg_s)\s*")

# Longest cell that may be a name: the patterns take time in proportion to the square of the length.
CELL_WIDTH = 100


@dataclass(frozen=True, slots=True)
class Quantity:
    """Names of the columns of a quantity along x, y and z, and the spellings of its units."""

    names: tuple[re.Pattern[str], ...]
    spellings: dict[str, str]

    @classmethod
    def of(cls, word: str, spellings: dict[str, str]) -> Quantity:
        """Return the quantity whose columns are called `word`, before or after the axis."""
        return cls(tuple(re.compile(rf"({word}){axis}(axis)?|{axis}({word})") for axis in "xyz"), spellings)

    @property
    def bare(self) -> Quantity:
        """The quantity whose columns may also be called x, y and z alone."""
        names = (re.compile(rf"{axis}(axis)?|{name.pattern}") for axis, name in zip("xyz", self.names, strict=True))
        return Quantity(tuple(names), self.spellings)


RATE = Quantity.of(GYRO, RATE_SPELLINGS)
ACCELERATION = Quantity.of(ACCELEROMETER, ACCELERATION_SPELLINGS)


@dataclass(frozen=True, slots=True)
class Columns:
    """Places of timestamps and values (along x, y, z) among the columns of a table, and their units if it names them.

    The place of the timestamps is -1 in a table without them. `start` is the place of the first sample among the rows;
    `names` are the names of all columns.
    """

    places: tuple[int, int, int, int]
    time_unit: str | None = None
    value_units: tuple[str | None, ...] = (None, None, None)
    start: int = 0
    names: tuple[str, ...] = ()

    @property
    def sensors(self) -> list[int]:
        """Places of columns that say whose sample a row is."""
        return [k for k, name in enumerate(self.names) if SENSOR.fullmatch(name)]


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a header, such as `t_ns`, `gx[rad/s]`, `Gyroscope x (rad/s)`.

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
        text = text.lower()
        match = re.fullmatch(r"(.*?)\s*[\[(](.*?)[\])]", text)
        if match is None:
            match = SUFFIX.fullmatch(text)
        name, unit = match.groups() if match else (text, "")
        known = UNIT_OF.get(re.sub(r"\s", "", unit))
        return cls(re.sub(r"[^a-z]", "", name), known, bool(unit) and known is None)


def named_columns(text: TextFile, values: Quantity = RATE, *, stamped: bool = True) -> Columns | None:
    """Return the columns named by a header; None if no line names the values and, if `stamped`, the timestamps."""
    for line, start in text.headers:
        cells = [Cell.of(cell) for cell in cells_of(line)]

        def place(pattern: re.Pattern[str], units: dict[str, str], cells: Sequence[Cell] = cells) -> int:
            fits = (
                k
                for k, cell in enumerate(cells)
                if pattern.fullmatch(cell.name) and not cell.unknown and (cell.unit is None or cell.unit in units)
            )
            return next(fits, -1)

        t = place(TIME, TIME_SPELLINGS)
        t = t if t >= 0 else place(ELAPSED, TIME_SPELLINGS)
        x, y, z = (place(name, values.spellings) for name in values.names)
        if min(x, y, z) >= 0 and (t >= 0) is stamped:
            units = [cells[k].unit for k in (x, y, z)]
            names = tuple(cell.name for cell in cells)
            return Columns((t, x, y, z), cells[t].unit if stamped else None, tuple(units), start, names)
    return None


def check_layout(text: TextFile, rows: Rows, columns: Columns) -> None:
    """Raise `FileFormatError` if some rows contradict the columns.

    A row has more cells than the header names, as those of a comma table with decimal commas have; or the rows are
    samples of several sensors; or the timestamps do not rise, but another column does.
    """
    some = spread(rows, LAYOUT_ROWS)
    cells = [cells_of(text.lines[row]) for row in some]
    for row, found in zip(some, cells, strict=True):
        if 0 < len(columns.names) < len(found):
            raise text.error(
                f"{len(found)} cells, but the header names {len(columns.names)} columns; if the numbers have decimal "
                "commas, separate the columns by semicolons or tabs",
                row,
            )
    for k in columns.sensors:
        sensors = sorted({found[k] for found in cells if k < len(found)})
        if len(sensors) > 1:
            raise text.error(
                f"column {k + 1} names several sensors ({', '.join(sensors)[:80]}); keep the lines of one only",
                some[0],
            )
    place = columns.places[0]
    width = min([64, *map(len, cells)])  # the columns of any sensor log, and a bound on the work for other files
    grid = np.array([[float(cell) if is_number(cell) else np.nan for cell in found[:width]] for found in cells])
    if cells and 0 <= place < width and not _rises(grid[:, place]):
        others = rising(grid)
        if others:
            raise text.error(
                f"column {place + 1} was taken as time, but does not rise, unlike "
                f"{' and '.join(f'column {k + 1}' for k in others)}; name the columns in a header, like t,wx,wy,wz",
                some[0],
            )


def layout_grid(text: TextFile, columns: int) -> FloatArray | None:
    """Return some rows of a table, spread over it; None unless the first and most others are `columns` numbers.

    The format's reader names the line of a row that is not.
    """
    cells = [cells_of(text.lines[row]) for row in spread(text.rows, LAYOUT_ROWS)]
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


def _rises(column: FloatArray) -> bool:
    """Whether the column rises but for a few rows, such as samples that came late."""
    return len(column) < 2 or bool(np.mean(np.diff(column) >= 0) > 0.9 and column[-1] > column[0])


def time_column(grid: FloatArray) -> int:
    """Return the column of timestamps of a table without a header: the only one that always rises, else the first."""
    columns = rising(grid)
    if len(columns) != 1:
        return 0
    steps = np.unique(np.diff(grid[:, columns[0]]))
    # In a short table a rate may rise by chance (in ten rows, in one of 10! orders), but not evenly.
    even = 0.5 * steps[-1] <= steps[steps > 0][0]
    return columns[0] if even or len(grid) >= 10 else 0


def unit_from_spacing(table: Table) -> str:
    """Return the unit of time that makes the median sample spacing that of a gyro."""
    # Timestamps that fit as nanoseconds fit in every unit, and their differences do not overflow.
    table.check_range(TIME_UNITS["ns"])
    if len(table.rows) < 2:
        raise table.text.error("a gyro log needs at least 2 samples, got 1", table.rows[0])
    spacing = float(np.median(np.abs(np.diff(table.timestamps).astype(np.float64))))
    for name, unit in TIME_UNITS.items():
        if SPACING[0] <= spacing * float(unit) <= SPACING[1]:
            return name
    raise table.text.error(
        f"cannot determine the unit of time: the median sample spacing is {spacing:g}, which is no gyro rate between "
        "20 Hz and 8 kHz in s, ms, us or ns; check the column of timestamps"
    )
