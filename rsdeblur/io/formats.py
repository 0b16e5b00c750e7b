"""The registry of text formats: which there are, and which one a file is in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from rsdeblur.io.text import TextFile

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Format(Generic[T]):
    """One file format.

    Parameters
    ----------
    name : str
        What the user calls it.
    title : str
        What it is, for lists and messages.
    sniff : callable
        Whether the content looks like this format; looks at the first lines only and never raises.
    read : callable
        Reads the file or raises `FileFormatError`.
    """

    name: str
    title: str
    sniff: Callable[[TextFile], bool]
    read: Callable[[TextFile], T]


def choose(formats: Sequence[Format[T]], text: TextFile, what: str, name: str | None = None) -> Format[T]:
    """Return the format called `name`, or without a name the first one whose `sniff` accepts the content.

    Raises
    ------
    FileFormatError
        If there is none; lists the known formats.
    """
    known = "; ".join(f"{each.name} ({each.title})" for each in formats)
    if name is not None:
        for each in formats:
            if each.name == name:
                return each
        raise text.error(f"there is no {what} format {name!r}; known formats: {known}")
    for each in formats:
        if each.sniff(text):
            return each
    found = text.head.strip()[:60]
    raise text.error(f"unknown {what} format, the content starts with {found!r}; known formats: {known}", text.rows[0])
