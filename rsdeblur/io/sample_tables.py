"""Sizes of the samples in MP4 and QuickTime videos (ISO/IEC 14496-12, section 8.7.3).

The telemetry's decoder makes room for a sample before it reads it: without this check a file of 39 kB takes 4 GiB.
"""

from __future__ import annotations

import os
import struct
from typing import BinaryIO

import numpy as np

from rsdeblur._util.files import open_file
from rsdeblur.io.source import Source

# Boxes that lead to the table of sizes.
CONTAINERS = frozenset((b"moov", b"trak", b"mdia", b"minf", b"stbl"))
HEADER, LONG_HEADER = struct.Struct(">I4s"), struct.Struct(">Q")
# Version and flags, the size of all samples or 0, the number of samples; then the size of each, if that is 0.
SIZES = struct.Struct(">III")


def check_sample_sizes(source: Source) -> None:
    """Check the sizes of the samples of a video that is a file of its own."""
    with open_file(source.path, source.what) as file:
        whole = file.seek(0, os.SEEK_END)
        # Parts of the file that contain boxes; a list, because a damaged file may nest them without end.
        parts = [(0, whole)]
        while parts:
            place, stop = parts.pop()
            while place + HEADER.size <= stop:
                kind, start, place = _box(file, place, stop)
                if kind in CONTAINERS:
                    parts.append((start, place))
                elif kind == b"stsz" and (largest := _largest(file, start, place)) > whole:
                    raise source.error(
                        f"the video is damaged: it claims a sample of {largest} bytes, and has {whole} in all"
                    )


def _box(file: BinaryIO, place: int, stop: int) -> tuple[bytes, int, int]:
    """Return the kind of the box at `place`, and where its content begins and ends, at `stop` at the latest."""
    file.seek(place)
    size, kind = HEADER.unpack(file.read(HEADER.size))
    start = place + HEADER.size
    if size == 1 and start + LONG_HEADER.size <= stop:
        (size,) = LONG_HEADER.unpack(file.read(LONG_HEADER.size))
        start += LONG_HEADER.size
    # A size of 0 reaches to the end. Nothing can follow a box whose size is less than that of its header.
    end = place + size if size >= start - place else stop
    return kind, start, min(end, stop)


def _largest(file: BinaryIO, start: int, stop: int) -> int:
    """Return the size of the largest sample in the table between two places of the file; 0 if it is cut off."""
    file.seek(start)
    table = file.read(stop - start)
    if len(table) < SIZES.size:
        return 0
    _, same, count = SIZES.unpack_from(table)
    each = np.frombuffer(table, ">u4", min(count, (len(table) - SIZES.size) // 4), SIZES.size)
    return same or int(each.max(initial=0))
