"""JPEG: a guard against small files that take hours to decode."""

from __future__ import annotations

import re

# Encoders write about ten scans into a progressive picture. Each scan takes as long to decode as a whole picture,
# but its data may be as short as fifty bytes.
MOST_SCANS = 100
# Pictures may have twelve scans at any size, and more while the pixels of all scans are at most these: some 2 s.
ORDINARY_SCANS, MOST_SCANNED = 12, 1_000_000_000

START, END, SCAN = b"\xff\xd8", b"\xff\xd9", b"\xff\xda"
# Start of frame, of any coding; after the segment's length and the precision it has height and width.
FRAMES = [bytes((0xFF, kind)) for kind in range(0xC0, 0xD0) if kind not in (0xC4, 0xC8, 0xCC)]
# Inside coded samples, 0xFF is followed by 0 or by a restart marker (D0 to D7); these are not matched.
MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")


def check_scans(data: bytes) -> None:
    """Refuse a JPEG with too many scans.

    Raises
    ------
    ValueError
        If there are more than `MOST_SCANS`, or more than its size allows.
    """
    place, scans, most = len(START), 0, MOST_SCANS
    while (marker := MARKER.search(data, place)) and marker[0] != END:
        start = marker.end()
        if marker[0] in FRAMES:
            height, width = (int.from_bytes(data[start + n : start + n + 2], "big") for n in (3, 5))
            most = min(MOST_SCANS, max(ORDINARY_SCANS, MOST_SCANNED // max(height * width, 1)))
        scans += marker[0] == SCAN
        if scans > most:
            raise ValueError(f"the JPEG has more than {most} scans")
        place = start + int.from_bytes(data[start : start + 2], "big")
