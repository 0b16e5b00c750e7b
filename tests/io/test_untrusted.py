"""With RSDEBLUR_BLOCK_UNTRUSTED, no decoder that public fuzzing does not cover sees a byte of a file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rsdeblur.errors import FileFormatError
from rsdeblur.io import Picture, read_gyro, read_picture, write_picture
from rsdeblur.io.source import BLOCK_UNTRUSTED

PIXELS = (np.arange(12 * 20 * 3) % 251).reshape(12, 20, 3).astype(np.uint8)
VIDEO = b"\0\0\0\x18ftypmp42\0\0\0\0" + bytes(64)


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Switch the decoders off, and make every use of them an error."""
    monkeypatch.setenv(BLOCK_UNTRUSTED, "1")
    for name in ("tifffile.TiffFile", "imagecodecs.png_decode"):
        monkeypatch.setattr(name, lambda *arguments, **options: pytest.fail("the decoder was called"))
    monkeypatch.setitem(sys.modules, "telemetry_parser", None)


@pytest.mark.parametrize(
    ("name", "pixels"),
    [("a.tif", PIXELS), ("a.tif", PIXELS.astype(np.float32) / 255), ("a.png", PIXELS.astype(np.uint16) * 257)],
)
def test_pictures_are_refused_and_the_variable_is_named(
    tmp_path: Path, name: str, pixels: NDArray[Any], request: pytest.FixtureRequest
) -> None:
    path = tmp_path / name
    write_picture(path, pixels, like=Picture(pixels))
    request.getfixturevalue("refused")
    for in_place in (False, True):
        with pytest.raises(FileFormatError, match=rf"{name}.*no public fuzzing covers.*{BLOCK_UNTRUSTED}"):
            read_picture(path, in_place=in_place)


def test_videos_are_refused_and_the_variable_is_named(tmp_path: Path, refused: None) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(VIDEO)
    with pytest.raises(FileFormatError, match=rf"a.mp4.*telemetry-parser.*{BLOCK_UNTRUSTED}"):
        read_gyro(path)


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.webp", "a.npy", "a.tif"])
def test_other_pictures_are_read(
    tmp_path: Path, name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_picture(tmp_path / name, PIXELS)
    # Zero switches nothing off.
    monkeypatch.setenv(BLOCK_UNTRUSTED, "0") if name == "a.tif" else request.getfixturevalue("refused")
    assert read_picture(tmp_path / name).pixels.shape == PIXELS.shape
