"""What the command line writes into the XMP history of a result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsdeblur.io.pictures import Picture
    from rsdeblur.pipeline.options import Options

# Any number of threads gives the same bits; a translation is recorded as its file.
LEFT_OUT = ("threads", "translation")


def recorded(
    picture: Picture, files: Mapping[str, Path | None], options: Options, values: Mapping[str, Any]
) -> Picture:
    """Return the picture with an entry in its history: files with their hashes, options, and values that are set."""
    from rsdeblur.io.history import file_facts, with_history

    facts: dict[str, Any] = {name: file_facts(path) for name, path in files.items() if path is not None}
    facts["options"] = {
        field.name: getattr(options, field.name) for field in fields(options) if field.name not in LEFT_OUT
    }
    return with_history(picture, facts | {name: value for name, value in values.items() if value is not None})
