"""Offset between the camera's clock and the gyro's, from MARS logger's `edge_epochs.txt`."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass

from rsdeblur.io.source import Source
from rsdeblur.io.text import cells_of

SOURCE = re.compile(r"SENSOR_INFO_TIMESTAMP_SOURCE is (?:SENSOR_INFO_TIMESTAMP_SOURCE_)?(REALTIME|UNKNOWN)")


@dataclass(frozen=True, slots=True)
class Clocks:
    """Clocks of a session, from its `edge_epochs.txt`.

    Parameters
    ----------
    source : str
        Android's name for the clock of the camera's timestamps: REALTIME is the gyro's clock, or UNKNOWN.
    differences : tuple of int
        The gyro's clock minus `nanoTime()`, in ns, at the session's start and end.
    """

    source: str
    differences: tuple[int, ...]

    @property
    def time_offset(self) -> float:
        """Camera time minus gyro time in s: 0 for one clock, else as if the camera's clock were `nanoTime()`."""
        if self.source == "REALTIME":
            return 0.0
        return 0.0 - sum(self.differences) / len(self.differences) / 1e9


def is_clocks(source: Source) -> bool:
    """Whether the file is an `edge_epochs.txt`."""
    return SOURCE.search(source.head.decode("latin-1")) is not None


def read_clocks(path: str | os.PathLike[str]) -> Clocks:
    """Read the `edge_epochs.txt` of a MARS logger session.

    Parameters
    ----------
    path : path-like
        The file.

    Raises
    ------
    FileFormatError
        If the file cannot be read or is not an `edge_epochs.txt`; or, naming the line, if its numbers contradict each
        other or the clocks drift apart.
    """
    source = Source(path, "file of clocks")
    text = source.text
    match = SOURCE.search(text.start)
    if match is None:
        raise source.error("not an edge_epochs.txt: it does not contain Android's SENSOR_INFO_TIMESTAMP_SOURCE")
    differences: list[int] = []
    for row in text.rows:
        cells = cells_of(text.lines[row])
        if len(cells) != 3 or not all(re.fullmatch(r"-?\d+", cell) for cell in cells):
            raise text.error("expected three whole numbers of ns: both clocks and their difference", row)
        boot, nano, difference = map(int, cells)
        if boot - nano != difference and nano - boot != difference:
            raise text.error(f"{difference} ns is not the difference of the clocks {boot} and {nano}", row)
        differences.append(boot - nano)
        # CLOCK_MONOTONIC and CLOCK_BOOTTIME differ by the time that a phone slept; the rest is a drift below 1 ms.
        if abs(differences[-1] - differences[0]) > 1_000_000:
            raise text.error(
                "the clocks drift apart during the session: the phone slept, so no single offset fits", row
            )
    return Clocks(match[1], tuple(differences))
