"""Atomic writing: only its own temporary files are removed, and what a replaced file was allowed stays allowed."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsdeblur._util.atomic import atomic_write, remove_unfinished
from rsdeblur.errors import OutputError, RsdeblurWarning
from rsdeblur.io.picture_output import picture_to_fill
from rsdeblur.io.pictures import Picture, read_picture

# Ends in the middle of a write, as after SIGKILL.
DIE = """
import os, sys
from rsdeblur._util.atomic import atomic_write
with atomic_write(sys.argv[1]) as file:
    os._exit(0)
"""


def leave_unfinished(path: Path) -> Path:
    """Return the temporary file that a process left behind."""
    before = set(path.parent.iterdir())
    subprocess.run([sys.executable, "-c", DIE, str(path)], check=True)
    (left,) = set(path.parent.iterdir()) - before
    return left


def test_only_own_files_are_removed(tmp_path: Path) -> None:
    """What a killed process left stays until it is removed by name; files whose names begin alike stay."""
    path = tmp_path / "a.png"
    strangers = [tmp_path / name for name in (".a.png.download.part", ".a.png.0123456789abcdef.part", "a.png.part")]
    for stranger in strangers:
        stranger.touch()
    strangers += [leave_unfinished(tmp_path / name) for name in ("a.png.b.png", "a" * 60 + "1", "a" * 60 + "2")]
    leave_unfinished(path)
    remove_unfinished(path)
    remove_unfinished(tmp_path / ("a" * 60))
    assert set(tmp_path.iterdir()) == set(strangers)


def test_two_writers_of_one_file_both_finish(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with atomic_write(path) as first:
        first.write(b"1")
        with atomic_write(path) as second:
            second.write(b"2")
        assert path.read_bytes() == b"2"
    assert path.read_bytes() == b"1"
    assert list(tmp_path.iterdir()) == [path]


def test_a_replaced_file_keeps_mode_and_attributes(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.touch(0o600)
    os.utime(path, (1, 1))
    try:
        os.setxattr(path, "user.origin", b"here")
        attributes = ["user.origin"]
    except (AttributeError, OSError):  # macOS, or a file system without them
        attributes = []
    with atomic_write(path) as file:
        file.write(b"a")
    assert path.stat().st_mode & 0o777 == 0o600
    assert [os.getxattr(path, name) for name in attributes] == [b"here"] * len(attributes)
    # It is another content, of another date.
    assert path.stat().st_mtime > 1


@pytest.mark.parametrize("suffix", [".tif", ".npy"])
def test_a_mapped_picture_has_its_space_before_it_is_filled(tmp_path: Path, suffix: str) -> None:
    """Else a full disk ends the process with SIGBUS."""
    pixels = np.zeros((300, 400, 3), np.uint8)
    with picture_to_fill(tmp_path / f"a{suffix}", pixels.shape, like=Picture(pixels), in_place=True):
        (file,) = tmp_path.iterdir()
        # POSIX counts blocks of 512 bytes; a part of a block is a whole one.
        assert 512 * file.stat().st_blocks >= pixels.size


def failing(number: int) -> Callable[..., None]:
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.mark.parametrize("number", [errno.EPERM, errno.EINVAL])
@pytest.mark.parametrize("in_place", [False, True])
def test_a_disk_without_file_times_and_synchronisation_keeps_the_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, in_place: bool
) -> None:
    for call in ("utime", "fsync", "posix_fallocate") if number == errno.EINVAL else ("utime", "fsync"):
        monkeypatch.setattr(os, call, failing(number), raising=False)
    like = Picture(np.full((3, 4), 7, np.uint8), modified_ns=10**18)
    with (
        pytest.warns(RsdeblurWarning, match="time"),
        picture_to_fill(tmp_path / "a.tif", (3, 4), like=like, in_place=in_place) as pixels,
    ):
        pixels[...] = like.pixels
    assert (read_picture(tmp_path / "a.tif").pixels == 7).all()


@pytest.mark.parametrize("call", ["posix_fallocate", "fsync"])
def test_a_full_disk_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    monkeypatch.setattr(os, call, failing(errno.ENOSPC), raising=False)
    pixels = np.zeros((3, 4), np.uint8)
    with (
        pytest.raises(OutputError, match=r"a\.tif: cannot write the file: No space left on device"),
        picture_to_fill(tmp_path / "a.tif", pixels.shape, like=Picture(pixels), in_place=True),
    ):
        # A map without its space ends the process with SIGBUS.
        assert call == "fsync"
    assert not list(tmp_path.iterdir())
