"""Tables of text: stamps stay exact however they are written, and whatever lines are parsed together."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from rsdeblur.errors import FileFormatError
from rsdeblur.io import text
from rsdeblur.io.text import Table, TextFile, read_table

UNITS = [Decimal(1), Decimal(10**9), Decimal("976562.5"), Decimal("0.3"), Decimal("0.5"), Decimal("1e-3")]
FORMS: dict[str, Callable[[np.random.Generator], str]] = {
    "whole": lambda rng: str(rng.integers(-(10**6), 10**17)),
    "halves": lambda rng: f"{rng.integers(10**6)}{rng.choice(['', '.5', '.25', '.50'])}",
    "decimals": lambda rng: f"{rng.uniform(-10, 1e6):.{rng.integers(10)}f}",
    "exponents": lambda rng: f"{rng.uniform(-10, 1e6):.9e}",
    "long": lambda rng: f"{rng.uniform(0, 1e3):.25f}",
    "signs": lambda rng: rng.choice(["+.5", "-.25", "-7.", "+7", " 8.5 ", "-0.0"]),
    "mixed": lambda rng: FORMS[rng.choice(["whole", "decimals", "exponents", "long", "signs"])](rng),
}


def table(content: str) -> Table:
    parsed = TextFile.parse(Path("log.csv"), content.encode(), "log")
    return read_table(parsed, parsed.rows, [0, 1])


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("block", [1, 7, 1000])
def test_stamps_are_exact(form: str, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "BLOCK", block)
    rng = np.random.default_rng(0)
    stamps = [FORMS[form](rng) for _ in range(50)]
    found = table("".join(f"{stamp},{i}\n" for i, stamp in enumerate(stamps)))
    assert found.values[:, 0].tolist() == list(range(50))
    for unit in UNITS:
        if max(abs(Decimal(stamp) * unit) for stamp in stamps) < 2**62:
            assert found.nanoseconds(unit).tolist() == [round(Decimal(stamp) * unit) for stamp in stamps]


@pytest.mark.parametrize("stamp", ["-.", ".", "1_0.5", "1.-5", "--5.5", "5 5.5", "0" * 47 + "1.5", "nan"])
@pytest.mark.parametrize("block", [1, 1000])
def test_what_is_no_stamp_is_refused_with_its_line(stamp: str, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "BLOCK", block)
    with pytest.raises(FileFormatError, match="line 3: the stamp"):
        table(f"0.5,1\n1.5,1\n{stamp},1\n3.5,1\n")


@pytest.mark.parametrize("first", ["0", "0.5"])
def test_an_open_quote_does_not_swallow_lines(first: str) -> None:
    with pytest.raises(FileFormatError, match="line 2: a quote is not closed"):
        table(f'{first},1,a\n1,2,"a\n2,3,a\n3,4,a\n')


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("block", [1, 2, 1000])
def test_lines_are_those_of_the_text(end: str, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(text, "BLOCK", block)
    monkeypatch.setattr(text, "CHUNK", 5)
    lines = ["# a", "1,2", "", " ", "\t# b", " 3,4", "\u3000", "\u3000\u00b5", "\x1c", "#", "5,6", "\x1c7"]
    parsed = TextFile.parse(Path("log.csv"), end.join(lines).encode(), "log")
    assert list(parsed.lines) == end.join(lines).split("\n")
    assert parsed.rows.tolist() == [i for i, line in enumerate(lines) if line.strip() and line.strip()[0] != "#"]
    assert list(parsed.lines.of(parsed.rows)) == [parsed.lines[int(row)] for row in parsed.rows]
    assert parsed.lines[-1] == lines[-1]
    assert parsed.lines[1:3] == list(parsed.lines)[1:3]
