"""Boxes of MP4 and QuickTime videos (ISO/IEC 14496-12)."""

from __future__ import annotations

import os
import struct
from typing import BinaryIO

import numpy as np


def check_sample_sizes(file: BinaryIO) -> None:
    """Raise ValueError if a sample claims more bytes than the video has (section 8.7.3).

    Decoders make room for a sample before they read it: a file of 39 kB may take 4 GiB.
    """
    # Boxes that lead to the table of sizes.
    containers = (b"moov", b"trak", b"mdia", b"minf", b"stbl")
    whole = file.seek(0, os.SEEK_END)
    # Parts of the file that contain boxes; a list, because a damaged file may nest them without end.
    parts = [(0, whole)]
    while parts:
        place, stop = parts.pop()
        while place + 8 <= stop:
            kind, start, place = _box(file, place, stop)
            if kind in containers:
                parts.append((start, place))
            elif kind == b"stsz":
                file.seek(start)
                table = file.read(place - start).ljust(12, b"\0")
                # Version and flags, the size of all samples or 0, their number; then the size of each.
                _, largest, count = struct.unpack_from(">III", table)
                each = np.frombuffer(table, ">u4", min(count, (len(table) - 12) // 4), 12)
                if (largest := largest or int(each.max(initial=0))) > whole:
                    raise ValueError(f"it claims a sample of {largest} bytes, and has {whole} in all")


def _box(file: BinaryIO, place: int, stop: int) -> tuple[bytes, int, int]:
    """Return the kind of the box at `place`, and where its content begins and ends, at `stop` at the latest."""
    file.seek(place)
    size, kind = struct.unpack(">I4s", file.read(8))
    start = place + 8
    if size == 1 and start + 8 <= stop:
        (size,) = struct.unpack(">Q", file.read(8))
        start += 8
    # A size of 0 reaches to the end. Nothing can follow a box whose size is less than that of its header.
    end = place + size if size >= start - place else stop
    return kind, start, min(end, stop)
