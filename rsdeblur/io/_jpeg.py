"""JPEG, of which a few bytes may ask for hours of work."""

from __future__ import annotations

import re

# Encoders make ten scans of a progressive picture. Each takes the time of a whole picture,
# but its data may have no more than fifty bytes.
MOST_SCANS = 100

START, END, SCAN = b"\xff\xd8", b"\xff\xd9", b"\xff\xda"
# Within coded samples 0xFF is followed by 0 or by a restart marker.
MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


def check_scans(data: bytes) -> None:
    """Refuse a JPEG of too many scans.

    Raises
    ------
    ValueError
        If there are more than a hundred.
    """
    place, scans = len(START), 0
    while (marker := MARKER.search(data, place)) and marker[0] != END:
        scans += marker[0] == SCAN
        if scans > MOST_SCANS:
            raise ValueError(f"a JPEG of more than {MOST_SCANS} scans")
        place = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2], "big")
