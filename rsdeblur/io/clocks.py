"""How the camera's clock goes by the gyro's, from what MARS logger notes about both."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from rsdeblur.io.source import Source

WHAT = "file of clocks"
SOURCE = re.compile(r"SENSOR_INFO_TIMESTAMP_SOURCE is (?:SENSOR_INFO_TIMESTAMP_SOURCE_)?(REALTIME|UNKNOWN)")
# What CLOCK_MONOTONIC and CLOCK_BOOTTIME may drift apart in one session.
STEADY_NS = 1_000_000


@dataclass(frozen=True, slots=True)
class Clocks:
    """What a session's `edge_epochs.txt` says.

    Parameters
    ----------
    source : {"REALTIME", "UNKNOWN"}
        Android's name for the clock of the camera's stamps: the gyro's own, or another.
    differences : tuple of int
        The gyro's clock minus `nanoTime()`, in ns, at the session's start and end.
    """

    source: str
    differences: tuple[int, ...]

    @property
    def time_offset(self) -> float:
        """Camera time minus gyro time, s: 0 on one clock; otherwise the camera is taken to stamp by `nanoTime()`."""
        if self.source == "REALTIME":
            return 0.0
        return 0.0 - sum(self.differences) / len(self.differences) / 1e9


def is_clocks(source: Source) -> bool:
    """Whether this is an `edge_epochs.txt`."""
    return SOURCE.search(source.head.decode("latin-1")) is not None


def read_clocks(path: str | os.PathLike[str]) -> Clocks:
    """Read the `edge_epochs.txt` of a MARS logger session.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is no such file; or, naming the line, if its clocks do not go together.
    """
    source = Source(path, WHAT)
    text = source.text
    found = SOURCE.search(text.start)
    if found is None:
        raise source.error("no edge_epochs.txt: it does not tell Android's SENSOR_INFO_TIMESTAMP_SOURCE")
    differences: list[int] = []
    for row in text.rows:
        cells = text.lines[row].split()
        if len(cells) != 3 or not all(re.fullmatch(r"-?\d+", cell) for cell in cells):
            raise text.error("three whole numbers of ns expected: both clocks and their difference", row)
        boot, nano, difference = map(int, cells)
        if boot - nano != difference and nano - boot != difference:
            raise text.error(f"{difference} ns is not the difference of the clocks {boot} and {nano}", row)
        differences.append(boot - nano)
        if abs(differences[-1] - differences[0]) > STEADY_NS:
            raise text.error("the clocks drift apart during the session: the phone slept, so no offset holds", row)
    return Clocks(found[1], tuple(differences))
