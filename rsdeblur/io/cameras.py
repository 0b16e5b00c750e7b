"""Camera files."""

from __future__ import annotations

import os

from rsdeblur.camera import Camera


def read_camera(path: str | os.PathLike[str]) -> Camera:
    """Read a camera from the TOML file described in ``docs/camera-file.md``.

    Raises
    ------
    FileFormatError
        If the file cannot be read, is not TOML, lacks a needed key, has an unknown one, or a value is impossible.
    """
    return Camera.load(path)
