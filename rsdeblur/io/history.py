"""Entry in a picture's XMP history that says how it was made, so that anyone can make it again."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from rsdeblur._util.files import open_file
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.io import _exif_renewal, _xmp
from rsdeblur.io._metadata import AGENT
from rsdeblur.io.claims import parameters_text
from rsdeblur.io.pictures import Picture

# Bytes that are read at a time.
BLOCK = 2**20


def file_facts(path: str | os.PathLike[str]) -> dict[str, str]:
    """Return the name of a file, without its folder, and the SHA-256 of its content.

    Parameters
    ----------
    path : path-like
        The file.

    Raises
    ------
    FileFormatError
        If it cannot be read.
    """
    with open_file(path, "file") as file:
        status = os.fstat(file.fileno())
    return {"name": Path(path).name, "sha256": _digest(Path(path), (status.st_size, status.st_mtime_ns))}


@lru_cache(maxsize=8)
def _digest(path: Path, _: tuple[int, int]) -> str:
    """Return the SHA-256 of a file; kept for the next photo, as a log may be a long video."""
    digest = hashlib.sha256()
    with open_file(path, "file") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def with_history(picture: Picture, parameters: Mapping[str, Any]) -> Picture:
    """Return a picture whose XMP history ends with an entry for its deblurring.

    Parameters
    ----------
    picture : Picture
        The picture that will be `like` in :func:`rsdeblur.write_picture`.
    parameters : mapping
        What the result depends on; it is written as JSON.

    Returns
    -------
    Picture
        The picture with the new XMP packet.

    Warns
    -----
    RsdeblurWarning
        If the packet is damaged; a new one takes its place.
    """
    text = parameters_text(parameters)
    try:
        return replace(picture, xmp=_xmp.with_history(picture.xmp, AGENT, text, _exif_renewal.now()))
    except ValueError as error:
        warnings.warn(f"the XMP packet is damaged and left out: {error}", RsdeblurWarning, stacklevel=2)
        return replace(picture, xmp=_xmp.with_history(None, AGENT, text, _exif_renewal.now()))
