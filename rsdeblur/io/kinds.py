"""Kinds of files, for the message about a file that is given in place of another kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rsdeblur.errors import FileFormatError
from rsdeblur.io import cameras, captures, gyro_logs, trajectories
from rsdeblur.io.archives import is_archive
from rsdeblur.io.columns import RATE, named_columns
from rsdeblur.io.gyro_binary import is_video
from rsdeblur.io.pictures import is_picture
from rsdeblur.io.source import Format, Source


class Kind(NamedTuple):
    """A kind of file: its name, what to do with such a file, and its formats, the likeliest first."""

    name: str
    advice: str
    formats: Callable[[], Sequence[Format[Any]]]


# The first kind that fits is reported: a .gcsv log is a gyro log rather than a camera, MARS logger's metadata are
# captures rather than a camera.
KINDS = (
    Kind("picture", "give it as the photo", lambda: [_plain("picture", is_picture)]),
    Kind("video", "give it to rsdeblur video", lambda: [_plain("video", _is_video)]),
    Kind("gyro log", "give it as --gyro", lambda: [*gyro_logs.FORMATS, _plain("zip archive", _has_log)]),
    Kind("capture file", "give it as --capture", lambda: captures.FORMATS),
    Kind("camera file", "give it as --camera", cameras.formats),
    Kind("trajectory", "give it as --translation", lambda: trajectories.FORMATS),
)


def mistaken(source: Source) -> FileFormatError | None:
    """Return the error for a file that looks like another kind than `source.what`; None if it looks like none."""
    for kind in KINDS:
        fits = (each for each in kind.formats() if each.fits(source)) if kind.name != source.what else iter(())
        if (format := next(fits, None)) is not None:
            title = f" ({format.title})" if format.title != kind.name else ""
            rates = ", or if x, y and z are rates, add --gyro-format plain" if _may_be_rates(source) else ""
            return source.error(f"not a {source.what}: it looks like a {kind.name}{title}; {kind.advice}{rates}")
    return None


def _may_be_rates(source: Source) -> bool:
    """Whether a file that should be a gyro log is a table of t, x, y and z, which a trajectory may be too."""
    return (
        source.what == gyro_logs.WHAT and source.looks_like_text and named_columns(source.text, RATE.bare) is not None
    )


def _plain(name: str, sniff: Callable[[Source], bool]) -> Format[None]:
    """Return the only format of a kind, which is read elsewhere."""
    return Format(name, name, sniff, lambda source: None)


def _has_log(source: Source) -> bool:
    """Whether the file is an archive of a logger app with a gyro log; raises `FileFormatError` if it has none."""
    return is_archive(source) and bool(gyro_logs.detect_gyro_format(source.path))


def _is_video(source: Source) -> bool:
    return is_video(source) and not source.looks_like_text
