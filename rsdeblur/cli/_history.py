"""What the command line writes into the XMP history of a result, and into its C2PA manifest."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsdeblur.io.claims import Credentials
    from rsdeblur.io.pictures import Picture
    from rsdeblur.pipeline.options import Options

# Any number of threads gives the same bits; a translation is recorded as its file.
LEFT_OUT = ("threads", "translation")


def recorded(
    picture: Picture,
    photo: Path,
    files: Mapping[str, Path | None],
    options: Options,
    values: Mapping[str, Any],
    credentials: Credentials | None,
) -> Picture:
    """Return the picture with an entry in its history: files with their hashes, options, and values that are set.

    With a signer, the picture also gets a claim with the same content.

    Raises
    ------
    RsdeblurError
        If C2PA refuses the signer or the photo.
    """
    from rsdeblur.io.history import file_facts, with_history

    facts: dict[str, Any] = {"photo": file_facts(photo)}
    facts |= {name: file_facts(path) for name, path in files.items() if path is not None}
    facts["options"] = {name: value for name, value in options.recorded.items() if name not in LEFT_OUT}
    facts |= {name: value for name, value in values.items() if value is not None}
    picture = with_history(picture, facts)
    if credentials is None:
        return picture
    from rsdeblur.io.claims import with_claim

    return with_claim(picture, credentials, photo, facts)
