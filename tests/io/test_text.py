"""Tables of text: timestamps stay exact however they are written, and an error names the line."""

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from rsdeblur import FileFormatError
from rsdeblur.io.text import Table, TextFile, read_table

UNITS = [Decimal(1), Decimal(10**9), Decimal("976562.5"), Decimal("0.3"), Decimal("0.5"), Decimal("1e-3")]
FORMS: dict[str, Callable[[np.random.Generator], str]] = {
    "whole": lambda rng: str(rng.integers(-(10**6), 10**17)),
    "halves": lambda rng: f"{rng.integers(10**6)}{rng.choice(['', '.5', '.25', '.50'])}",
    "decimals": lambda rng: f"{rng.uniform(-10, 1e6):.{rng.integers(10)}f}",
    "since 1970": lambda rng: f"{rng.integers(10**9, 2 * 10**9)}.{rng.integers(10**9):09d}",
    "exponents": lambda rng: f"{rng.uniform(-10, 1e6):.9e}",
    "long": lambda rng: f"{rng.uniform(0, 1e3):.25f}",
    "longer": lambda rng: "0" * 60 + f"{rng.uniform(0, 1e3):.25f}" + "0" * 60,
    "signs": lambda rng: rng.choice(["+.5", "-.25", "-7.", "+7", " 8.5 ", "-0.0", '"9.5"']),
    "mixed": lambda rng: FORMS[rng.choice(["whole", "decimals", "exponents", "long", "signs"])](rng),
}


def parse(content: str) -> TextFile:
    return TextFile.parse(Path("log.csv"), content.encode(), "log")


def table(content: str) -> Table:
    parsed = parse(content)
    return read_table(parsed, parsed.rows, [0, 1])


@pytest.mark.parametrize("form", FORMS)
def test_timestamps_are_exact(form: str) -> None:
    rng = np.random.default_rng(0)
    timestamps = [FORMS[form](rng) for _ in range(50)]
    found = table("".join(f"{timestamp},{i}\n" for i, timestamp in enumerate(timestamps)))
    assert found.values[:, 0].tolist() == list(range(50))
    exact = [Decimal(timestamp.strip('"')) for timestamp in timestamps]
    for unit in UNITS:
        if max(abs(timestamp * unit) for timestamp in exact) < 2**62:
            assert found.nanoseconds(unit).tolist() == [round(timestamp * unit) for timestamp in exact]


@pytest.mark.parametrize("row", ["{},1\n", "{} 1\n", "{}\t1\n", '"{}","1"\n'])
def test_dates_with_a_zone_are_nanoseconds_since_1970(row: str) -> None:
    second = 1_714_564_800
    cells = {
        "1969-12-31T23:59:59.5Z": -(10**9) // 2,
        "2024-05-01T12:00:00.123Z": second * 10**9 + 123_000_000,
        "2024-05-01T14:00:00.123456789+02:00": second * 10**9 + 123_456_789,
        "2024-05-01T06:30:01-05:30": (second + 1) * 10**9,
    }
    assert table("".join(map(row.format, cells))).nanoseconds(Decimal(1)).tolist() == list(cells.values())


@pytest.mark.parametrize(
    ("cell", "problem"),
    [
        ("2024-02-30T12:00:00Z", "is not a number"),
        ("on 2024-05-01T12:00:00Z.", "is not a number"),
        ("2024-05-01T12:00:00", "has no time zone; append Z"),
    ],
)
def test_what_is_no_date_with_a_zone_is_no_timestamp(cell: str, problem: str) -> None:
    date = "2024-05-01T12:00:00Z,1\n"
    with pytest.raises(FileFormatError, match=f"line 2: '{cell}' in column 1 {problem}"):
        table(f"{date}{cell},1\n{date}{date}")


def test_whole_timestamps_fill_int64() -> None:
    limit = 2**63 - 4096
    assert table(f"{-limit},1\n{limit - 1},1\n").nanoseconds(Decimal(1)).tolist() == [-limit, limit - 1]
    for timestamp in (2**63 - 1, -(2**63), 2**63, 10**300, f"{limit}e3"):
        with pytest.raises(FileFormatError, match=r"line 2: timestamp .* is beyond the int64 range"):
            table(f"0,1\n{timestamp},1\n").nanoseconds(Decimal(1))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\r\r\n"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_lines_are_those_of_the_text(end: str, encoding: str) -> None:
    lines = ["# a", "1,2", "", " ", "\t# b", " 3,4", "\u3000", "\u3000\u00b5", "\x1c", "#", "5,6", "\x1c7"]
    parsed = TextFile.parse(Path("log.csv"), end.join(lines).encode(encoding), "log")
    assert parsed.lines == lines
    assert parsed.rows.tolist() == [i for i, line in enumerate(lines) if line.strip() and line.strip()[0] != "#"]
