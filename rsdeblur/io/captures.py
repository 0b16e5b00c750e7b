"""When pictures were taken and for how long, from the files loggers write beside them."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from decimal import Decimal

from rsdeblur.errors import InputError
from rsdeblur.exposure import Exposure
from rsdeblur.io.formats import choose, text_format
from rsdeblur.io.source import Source
from rsdeblur.io.text import TextFile, cells_of, find_columns, is_number, read_table

WHAT = "capture file"
# Android writes `Exposure time[nanosec]`, iOS `exposure duration[nanosec]`.
MARS_COLUMNS = (
    re.compile(r"timestamp\s*\[nanosec\]"),
    re.compile(r"exposure (time|duration)\s*\[nanosec\]"),
)


def read_captures(path: str | os.PathLike[str]) -> list[Exposure]:
    """Read the exposures of a recording, in the order of the file.

    Reads MARS logger ``movie_metadata.csv`` (Android and iOS; only the stamp and the exposure time are needed, other
    cells may be ``null``) and DeepGyro ``images.txt`` (``t_ns exposure_ns``). The format is told from the content.

    Parameters
    ----------
    path : path-like
        The metadata file.

    Returns
    -------
    list of Exposure
        Each with `start` 0 and the capture's stamp, exact, as `epoch_ns`: the stamp is taken as the start of exposure
        of the first row, which is what Android documents.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is empty, binary, cut off or of an unknown format; or, naming the line, if a stamp
        or an exposure time is missing, not a number or not positive.
    """
    source = Source(path, WHAT)
    return choose(FORMATS, source).read(source)


def _exposures(text: TextFile, rows: list[int], columns: Sequence[int]) -> list[Exposure]:
    table = read_table(text, rows, columns)
    exposures = []
    for row, stamp, duration in zip(rows, table.nanoseconds(Decimal(1)), table.values[:, 0], strict=True):
        try:
            exposures.append(Exposure(0.0, float(duration) / 1e9, int(stamp)))
        except InputError as error:
            raise text.error(f"impossible exposure time of {duration:g} ns: {error}", row) from error
    return exposures


def _mars_columns(text: TextFile) -> list[int] | None:
    return find_columns(text.head, MARS_COLUMNS)


def _read_mars(text: TextFile) -> list[Exposure]:
    return _exposures(text, text.rows[1:], _mars_columns(text) or [])


def _sniff_deepgyro(text: TextFile) -> bool:
    cells = cells_of(text.head)
    return len(cells) == 2 and all(map(is_number, cells))


FORMATS = (
    text_format("mars", "MARS logger movie_metadata.csv", lambda text: _mars_columns(text) is not None, _read_mars),
    text_format(
        "deepgyro",
        "DeepGyro images.txt, `t_ns exposure_ns`",
        _sniff_deepgyro,
        lambda text: _exposures(text, text.rows, (0, 1)),
    ),
)
