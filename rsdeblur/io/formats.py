"""Formats of files and their detection, and archives."""

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Generic, TypeVar

from rsdeblur._util import validate
from rsdeblur.errors import FileFormatError
from rsdeblur.io.columns import RATE, Columns, Quantity, guessed_option, is_table, listed, named_columns
from rsdeblur.io.source import Source


def unpacked_limit(packed: int) -> int:
    """Return the number of bytes that `packed` bytes may unpack to; more is a decompression bomb."""
    # Numbers compress to a third or a tenth of their size, those of a phone that lies still to less.
    return max(100 * packed, 2**26)


T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Format(Generic[T]):
    """One file format: its name, by which users choose it, its title for messages, and how it is found and read.

    `sniff` returns whether the content looks like this format, or the columns of a table. Mostly, it reads the start
    only, and it raises nothing but `FileFormatError`, which means no. `read` reads the file, with the user's choices in
    further arguments, or raises `FileFormatError`.
    """

    name: str
    title: str
    sniff: Callable[[Source], Columns | bool | None]
    read: Callable[..., T]

    def fits(self, source: Source) -> bool:
        """Whether the content looks like this format."""
        try:
            return bool(self.sniff(source))
        except FileFormatError:
            return False


# What to do with a file of each kind, and its formats, the likeliest first; `rsdeblur.io` fills it.
KINDS: dict[str, tuple[str, Sequence[Format[Any]]]] = {}


def mistaken(source: Source) -> FileFormatError | None:
    """Return the error for a file that looks like another kind than `source.what`, and not like that; else None."""
    if source.what in KINDS and any(each.fits(source) for each in KINDS[source.what][1]):
        return None
    for kind, (advice, formats) in KINDS.items():
        if format := next((each for each in formats if each.fits(source)), None):
            title = f" ({format.title})" if format.title != kind else ""
            rates = source.what == "gyro log" and source.looks_like_text and named_columns(source, RATE.bare)
            more = f", or if x, y and z are rates, add {rates.option(RATE)}" if rates else ""
            return source.error(f"not a {source.what}: it looks like a {kind}{title}; {advice}{more}")
    return None


def choose(
    formats: Sequence[Format[T]], source: Source, name: str | None = None, *, quantity: Quantity | None = None
) -> Format[T]:
    """Return the format called `name`, or the first that fits; the error for a table guesses columns of `quantity`."""
    known = "; ".join(f"{each.name} ({each.title})" for each in formats)
    if name is not None:
        validate.instance("format", name, str)
        chosen = next((each for each in formats if each.name == name), None)
        if chosen is None:
            raise source.error(f"there is no {source.what} format {name!r}; known formats: {known}")
        if not chosen.sniff(source):
            raise source.error(f"not in the format {name}: {chosen.title}")
        return chosen
    for each in formats:
        if each.fits(source):
            return each
    if (error := mistaken(source)) is not None:
        raise error
    if source.looks_like_json and b"{" in source.head:
        _ = source.json  # raises with the place where a file was cut off
    start, advice = source.first_line.strip()[:60], f"known formats: {known}"
    if quantity is not None and is_table(source):
        advice = f"{listed(source)}; choose those of the {source.what}: {guessed_option(source, quantity)}"
    raise source.error(f"unknown {source.what} format, the content starts with {start!r}; {advice}", source.rows[0])


def is_archive(source: Source) -> bool:
    """Whether the file is a zip archive."""
    return source.head.startswith((b"PK\x03\x04", b"PK\x05\x06"))


def entries_of(source: Source, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """Return the files in an archive; refuse more than a `source` of its size may unpack to."""
    entries = [each for each in archive.infolist() if not each.is_dir() and "__MACOSX" not in each.filename]
    size, limit = sum(each.file_size for each in entries), unpacked_limit(source.path.stat().st_size)
    if size > limit:
        raise source.error(f"the archive claims to contain {size} bytes, the limit is {limit}; unpack it yourself")
    return entries


def members_of(source: Source, order: Callable[[str], Any]) -> list[Source]:
    """Return the text files of a zip archive, in the order of this key; any other file is returned alone."""
    if not is_archive(source):
        return [source]
    with source.parsing("the archive"), zipfile.ZipFile(BytesIO(source.data)) as archive:
        suffixes = (".csv", ".json", ".txt", ".gcsv", ".tsv")
        entries = [each for each in entries_of(source, archive) if each.filename.lower().endswith(suffixes)]
        entries.sort(key=lambda entry: (order(entry.filename), entry.filename))
        # A damaged member may unpack to more than its entry claims; the rest is not read. Names are joined as text: an
        # absolute one that is joined as a path would replace the archive's path.
        members = [
            Source(f"{source.path}/{entry.filename}", source.what, archive.open(entry).read(entry.file_size))
            for entry in entries
        ]
    if not members:
        # A spreadsheet is an archive, too.
        sheet = b"[Content_Types].xml" in source.head or b"mimetypeapplication/vnd.oasis" in source.head
        raise source.error("a spreadsheet; save it as CSV" if sheet else f"the archive contains no {source.what}")
    return members
