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

# Markers of segments for metadata.
APPLICATION = range(0xE0, 0xF0)


def check_scans(data: bytes) -> None:
    """Refuse a JPEG with too many scans."""
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


def with_iptc(data: bytes, record: bytes) -> bytes:
    """Return a JPEG with an IPTC record, in a segment behind its other metadata."""
    body = b"Photoshop 3.0\0" + b"8BIM\x04\x04\0\0" + len(record).to_bytes(4, "big") + record + bytes(len(record) % 2)
    place = len(START)
    while data[place] == 0xFF and data[place + 1] in APPLICATION:
        place += 2 + int.from_bytes(data[place + 2 : place + 4], "big")
    return data[:place] + b"\xff\xed" + (len(body) + 2).to_bytes(2, "big") + body + data[place:]
