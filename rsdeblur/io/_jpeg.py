"""JPEG: a guard against small files that take hours to decode."""

from __future__ import annotations

import re

# Encoders write about ten scans into a progressive picture. Each scan takes as long to decode as a whole picture,
# but its data may be as short as fifty bytes.
MOST_SCANS = 100

START, END, SCAN = b"\xff\xd8", b"\xff\xd9", b"\xff\xda"
# Inside coded samples, 0xFF is followed by 0 or by a restart marker (D0 to D7); these are not matched.
MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


def check_scans(data: bytes) -> None:
    """Refuse a JPEG with too many scans.

    Raises
    ------
    ValueError
        If there are more than `MOST_SCANS`.
    """
    place, scans = len(START), 0
    while (marker := MARKER.search(data, place)) and marker[0] != END:
        scans += marker[0] == SCAN
        if scans > MOST_SCANS:
            raise ValueError(f"the JPEG has more than {MOST_SCANS} scans")
        place = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2], "big")
