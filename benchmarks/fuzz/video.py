"""A small video with gyro data, cut out of a real one: only the first samples of its telemetry track."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

CONTAINERS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")
SAMPLES = 2


def excerpt(path: Path) -> bytes:
    """Return the telemetry of a GoPro MP4 file as an MP4 file.

    Raises
    ------
    ValueError
        If the file has no telemetry track.
    """
    data = path.read_bytes()
    boxes = dict(_boxes(data))
    track = next((body for kind, body in _boxes(boxes[b"moov"]) if kind == b"trak" and b"gpmd" in body), None)
    if track is None:
        raise ValueError(f"{path}: the file has no telemetry track")
    (sizes,) = _find(track, b"stsz")
    (places,) = _find(track, b"stco")
    lengths = struct.unpack_from(f">{SAMPLES}I", sizes, 12)
    starts = struct.unpack_from(f">{SAMPLES}I", places, 8)
    samples = [data[start : start + length] for start, length in zip(starts, lengths, strict=True)]
    head = _box(b"ftyp", boxes[b"ftyp"])
    first = len(head) + 8
    new = {
        b"stsz": struct.pack(f">III{SAMPLES}I", 0, 0, SAMPLES, *lengths),
        b"stco": struct.pack(f">II{SAMPLES}I", 0, SAMPLES, first, first + lengths[0]),
        b"stsc": struct.pack(">IIIII", 0, 1, 1, 1, 1),
        b"stts": struct.pack(">IIII", 0, 1, SAMPLES, 1001),
    }
    others = b"".join(_box(kind, body) for kind, body in _boxes(boxes[b"moov"]) if kind != b"trak")
    return head + _box(b"mdat", b"".join(samples)) + _box(b"moov", others + _box(b"trak", _replaced(track, new)))


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = 0
    while place + 8 <= len(data):
        size, kind = struct.unpack_from(">I4s", data, place)
        yield kind, data[place + 8 : place + size]
        place += size


def _box(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I4s", len(body) + 8, kind) + body


def _find(data: bytes, target: bytes) -> Iterator[bytes]:
    for kind, body in _boxes(data):
        if kind == target:
            yield body
        elif kind in CONTAINERS:
            yield from _find(body, target)


def _replaced(data: bytes, new: dict[bytes, bytes]) -> bytes:
    return b"".join(
        _box(kind, _replaced(body, new) if kind in CONTAINERS else new.get(kind, body)) for kind, body in _boxes(data)
    )
