"""How files are given to FFmpeg: never as addresses, and only in containers that open no other files."""

from __future__ import annotations

import os
from typing import Any

# FFmpeg's names of the containers that are read. It recognises a file by its content, and reads pictures as videos too,
# and playlists, which make it open other files.
CONTAINERS = ("mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpegts")


def existing(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `av.open` that read a file."""
    # FFmpeg takes names for URLs: 10:30.mp4 has the protocol 10.
    return {"file": f"file:{os.path.abspath(path)}", "options": {"format_whitelist": ",".join(CONTAINERS)}}
