"""Registry of file formats, and detection of the format of a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from rsdeblur._util import validate
from rsdeblur.errors import FileFormatError
from rsdeblur.io.source import Source
from rsdeblur.io.text import TextFile

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Format(Generic[T]):
    """One file format.

    Parameters
    ----------
    name : str
        Name by which users choose the format.
    title : str
        Description, for lists and messages.
    sniff : callable
        Returns whether the content looks like this format. It reads the start (or the end) only and raises nothing but
        `FileFormatError`, which means no.
    read : callable
        Reads the file or raises `FileFormatError`.
    """

    name: str
    title: str
    sniff: Callable[[Source], bool]
    read: Callable[[Source], T]

    def fits(self, source: Source) -> bool:
        """Whether the content looks like this format."""
        try:
            return self.sniff(source)
        except FileFormatError:
            return False


def text_format(name: str, title: str, sniff: Callable[[TextFile], bool], read: Callable[[TextFile], T]) -> Format[T]:
    """Return a format whose files are lines of text."""
    return Format(
        name, title, lambda source: source.looks_like_text and sniff(source.text), lambda source: read(source.text)
    )


def choose(formats: Sequence[Format[T]], source: Source, name: str | None = None, *, advice: str = "") -> Format[T]:
    """Return the format called `name`; without a name, the first whose `sniff` accepts the content."""
    known = "; ".join(f"{each.name} ({each.title})" for each in formats)
    if name is not None:
        validate.instance("format", name, str)
        for each in formats:
            if each.name == name:
                return each
        raise source.error(f"there is no {source.what} format {name!r}; known formats: {known}")
    for each in formats:
        if each.fits(source):
            return each
    # Imported here because it imports the formats of all kinds.
    from rsdeblur.io.kinds import mistaken

    if (error := mistaken(source)) is not None:
        raise error
    if source.looks_like_json and b"{" in source.head:
        _ = source.json  # raises with the place where a file was cut off
    start = source.text.head.strip()[:60]
    raise source.text.error(
        f"unknown {source.what} format, the content starts with {start!r}{advice}; known formats: {known}",
        source.text.rows[0],
    )
