"""Any log, however its rows and columns are arranged, is read as the same log or refused."""

import warnings
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rsdeblur import FileFormatError, GyroLog, RsdeblurWarning, read_gyro

UNITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
RATE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180, "mrad/s": 1e-3, "mdeg/s": np.pi / 180_000}
RATE_UNITS |= dict.fromkeys(("°/s", "dps", "degrees/s"), np.pi / 180)
# A file is overwritten by every example, which is quick; more of them are run by hand.
LAW = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


Log = tuple[list[int], np.ndarray]


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Return timestamps in ns and rates with three decimals: 25 Hz to 1.6 kHz, 20% of jitter, since a start or 1970."""
    # In a log of a few rows a rate may rise by chance while the timestamps do not.
    count = draw(st.integers(12, 80))
    step = draw(st.integers(600, 40_000)) * 1000
    start = draw(st.integers(0, 9 * 10**14) | st.integers(950_000_000 * 10**9, 2 * 10**18))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    jitter = random.integers(0, step // 5000, count).tolist()
    # Rates that turn round, so that only the timestamps rise.
    rates = np.round(random.uniform(-3, 3, (count, 3)) + np.sin(np.arange(count))[:, None], 3)
    return [start + i * step + jitter[i] * 1000 for i in range(count)], rates


def cells(log: Log, unit: str, place: int, decimals: str = ".3f") -> list[list[str]]:
    """Return the rows of a table, the timestamps in a column of any place."""
    table = [[f"{rate:{decimals}}" for rate in row] for row in log[1].tolist()]
    for row, timestamp in zip(table, log[0], strict=True):
        row.insert(place, f"{Decimal(timestamp).scaleb(-UNITS[unit]):f}")
    return table


def read(folder: Path, rows: list[list[str]], separator: str = ",") -> GyroLog | None:
    """Return the log; None if it is refused, with the file named."""
    path = folder / "log.txt"
    path.write_text("\n".join(separator.join(row) for row in rows) + "\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RsdeblurWarning)
        try:
            return read_gyro(path)
        except FileFormatError as refusal:
            named = str(path) in str(refusal)
    assert named
    return None


def assert_is(found: GyroLog | None, log: Log) -> None:
    assert found is not None
    assert found.epoch_ns == log[0][0]
    np.testing.assert_array_equal(np.rint(found.t * 1e9), [timestamp - log[0][0] for timestamp in log[0]])
    # Units of rates divide and multiply them.
    np.testing.assert_allclose(found.omega, log[1], rtol=1e-14)


@LAW
@given(logs(), st.sampled_from(list(UNITS)), st.integers(0, 3), st.sampled_from(",; \t|"))
def test_units_shifts_separators_and_the_place_of_the_timestamps(tmp_path, log, unit, place, separator):
    assert_is(read(tmp_path, cells(log, unit, place), separator), log)


@LAW
@given(logs(), st.sampled_from(list(UNITS)), st.sampled_from(list(RATE_UNITS)), st.permutations(range(4)))
def test_units_of_rates_and_permuted_columns(tmp_path, log, unit, rate_unit, order):
    head = [f"t[{unit}]", *(f"g{axis}[{rate_unit}]" for axis in "xyz")]
    table = [head, *cells((log[0], log[1] / RATE_UNITS[rate_unit]), unit, 0, "")]
    assert_is(read(tmp_path, [[row[k] for k in order] for row in table]), log)


@LAW
@given(logs(), st.sampled_from(list(UNITS)), st.integers(0, 3), st.data())
def test_repeated_rows_are_dropped_or_refused(tmp_path, log, unit, place, data):
    rows = cells(log, unit, place)
    repeats = data.draw(st.lists(st.integers(1, 3), min_size=len(rows), max_size=len(rows)))
    twice = [row for row, count in zip(rows, repeats, strict=True) for _ in range(count)]
    found = read(tmp_path, twice)
    # If most rows repeat others, nothing shows the unit of time.
    if found is not None or len(twice) < 1.5 * len(rows):
        assert_is(found, log)


@LAW
@given(logs(), st.sampled_from(list(UNITS)), st.integers(0, 3), st.randoms(use_true_random=False), st.booleans())
def test_permuted_rows_are_the_same_log_or_refused(tmp_path, log, unit, place, random, near):
    rows = cells(log, unit, place)
    if near:
        i = random.randrange(len(rows) - 1)
        rows[i : i + 2] = rows[i + 1], rows[i]
    else:
        random.shuffle(rows)
    found = read(tmp_path, rows)
    if found is not None:
        assert_is(found, log)


@LAW
@given(logs(), st.integers(3, 60), st.floats(0.31, 9.0))
@example(([5_000_000 * i for i in range(60)], np.zeros((60, 3))), 20, 4.02)
def test_a_clock_set_back_is_refused_or_leaves_no_trace(tmp_path: Path, log: Log, place: int, intervals: float) -> None:
    """A step back that leaves the timestamps in order cannot be seen; any other one must be."""
    timestamps, rates = log
    place = min(place, len(timestamps) - 1)
    step = int(intervals * (timestamps[-1] - timestamps[0]) / (len(timestamps) - 1))
    back = [*timestamps[:place], *(timestamp - step for timestamp in timestamps[place:])]
    found = read(tmp_path, cells((back, rates), "ns", 0))
    if any(b <= a for a, b in pairwise(back)) and place < len(timestamps) - 1:
        assert found is None


@pytest.mark.parametrize("place", range(4))
def test_a_rate_that_rises_for_a_while_is_not_time(tmp_path: Path, place: int) -> None:
    t = np.arange(200) * 0.005
    rates = np.stack([np.minimum(t, 0.9), t * 0, -t], axis=-1).round(3)
    rates[-1, 0] = 0
    log = np.rint(1e9 * t).astype(int).tolist(), rates
    assert_is(read(tmp_path, cells(log, "s", place)), log)
