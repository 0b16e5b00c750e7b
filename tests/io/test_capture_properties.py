"""Any file of captures, however it is arranged, is read as the same captures or refused."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsdeblur.errors import FileFormatError
from rsdeblur.io.captures import open_captures

Captures = list[tuple[int, int]]
DIGITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
LAW = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def _in(unit: str, nanoseconds: int) -> str:
    return f"{Decimal(nanoseconds).scaleb(-DIGITS[unit]):f}"


def _timestamps_in(unit: str) -> Callable[[int, int], str]:
    return lambda t, d: _in(unit, t)


# A line of each format for a timestamp and an exposure time in ns, and the line above.
LAYOUTS: dict[str, tuple[str, Callable[[int, int], str]]] = {
    "mars": ("Timestamp[nanosec],fx[px],Exposure time[nanosec]\n", lambda t, d: f"{t},2943.75,{d}"),
    "mars, columns in another order": (
        "exposure duration[nanosec],ISO,Timestamp[nanosec]\n",
        lambda t, d: f"{d},null,{t}",
    ),
    "deepgyro": ("", lambda t, d: f"{t} {d}"),
    "deepgyro in seconds": ("", lambda t, d: f"{_in('s', t)}\t{_in('s', d)}"),
    "image-info": ("", lambda t, d: f"{t} 800 {d} 3182.59 3179.30 1458.69 2114.26 0"),
    "timestamps": ("", lambda t, d: f"{t}"),
    "timestamps in seconds": ("", lambda t, d: _in("s", t)),
    **{f"timestamp[{unit}]": (f"timestamp[{unit}]\n", _timestamps_in(unit)) for unit in DIGITS},
}


@st.composite
def captures(draw: st.DrawFn) -> Captures:
    """Return timestamps and exposure times in ns: 2.5 to 1000 frames per second, 20% of jitter, any origin."""
    count = draw(st.integers(3, 20))
    step = draw(st.integers(1, 400)) * 1_000_000
    # Whole seconds would be taken as ns.
    start = draw(st.integers(0, 2 * 10**18)) | 1
    random = Random(draw(st.integers(0, 2**32)))
    return [(start + i * step + random.randrange(step // 5), random.randrange(1, 10**8)) for i in range(count)]


def read(path: Path, layout: str, found: Captures) -> Captures | None:
    """Return timestamps and exposure times, 0 for none; None if they are refused, with the file named."""
    head, line = LAYOUTS[layout]
    path.write_text(head + "".join(line(*each) + "\n" for each in found))
    try:
        file = open_captures(path)
    except FileFormatError as refusal:
        named = str(path) in str(refusal)
    else:
        times = (0 if time is None else round(1e9 * time) for time in file.durations)
        return list(zip(file.timestamps, times, strict=True))
    assert named
    return None


@pytest.mark.parametrize("layout", LAYOUTS)
@LAW
@given(captures(), st.randoms(use_true_random=False))
def test_units_shifts_and_layouts_permutations_and_repeats(
    tmp_path: Path, layout: str, found: Captures, random: Random
) -> None:
    path = tmp_path / "captures.csv"
    timed = "timestamp" not in layout
    assert read(path, layout, found) == [(timestamp, time * timed) for timestamp, time in found]
    shuffled = random.sample(found, len(found))
    assert shuffled == found or read(path, layout, shuffled) is None
    place = random.randrange(len(found))
    # Once more, with the same exposure time or another.
    repeated = [*found[:place], (found[place][0], random.choice([found[place][1], 7])), *found[place:]]
    assert read(path, layout, repeated) is None
