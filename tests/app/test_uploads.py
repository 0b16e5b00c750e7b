"""Laws of the app's temporary folder, and of the line that is copied into a terminal."""

import os
import shutil
import subprocess
import sys
import tempfile

import pytest

from rsdeblur.app.server import Uploads, plain
from rsdeblur.cli._desk import shell_line
from rsdeblur.errors import InputError, OutputError


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Give temporary files a folder of this test."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def uploads(temporary):
    kept = Uploads()
    yield kept
    kept.close()


def test_equal_names_are_different_files_that_only_this_user_can_read(uploads, temporary):
    paths = [uploads.keep(name, name.encode()) for name in ("imu0/data.csv", "cam0\\data.csv", "../../etc/da<ta.csv")]
    assert [path.name for path in paths] == ["data.csv"] * 3
    assert [path.read_bytes() for path in paths] == [b"imu0/data.csv", b"cam0\\data.csv", b"../../etc/da<ta.csv"]
    for path in paths:
        assert path.parents[2] == temporary
        assert path.parent.stat().st_mode & 0o077 == path.parents[1].stat().st_mode & 0o077 == 0
    for name in ("", "..", "/", "a/", "x" * 300):
        with pytest.raises(InputError, match="usable name"):
            uploads.keep(name, b"")
    assert plain(f"{paths[0]}: line 3, see {paths[1]}") == "data.csv: line 3, see data.csv"
    uploads.close()
    assert list(temporary.iterdir()) == []


def test_a_full_disk_keeps_no_part_of_a_file_and_a_deleted_folder_is_made_again(uploads, temporary):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises(OutputError, match="TMPDIR") as caught:
            uploads.keep("gyro.csv", bytes(8192))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert str(caught.value).startswith("gyro.csv: ")
    assert [path for path in temporary.rglob("*") if path.is_file()] == []
    for folder in temporary.iterdir():
        shutil.rmtree(folder)
    assert uploads.keep("gyro.csv", b"t").read_bytes() == b"t"


def test_a_start_removes_what_a_killed_app_left_and_nothing_else(uploads, temporary):
    pytest.importorskip("fcntl")
    kept, others = uploads.keep("photo.png", b"mine"), temporary / "rsdeblur-app-file"
    others.write_bytes(b"no folder")
    killed = "from rsdeblur.app.server import *; Uploads().keep('a.csv', b'1'); os.kill(os.getpid(), 9)"
    environment = os.environ | {"TMPDIR": str(temporary)}
    subprocess.run([sys.executable, "-P", "-c", killed], env=environment, check=False)
    assert len(list(temporary.rglob("a.csv"))) == 1
    Uploads().close()
    assert list(temporary.rglob("a.csv")) == []
    assert (kept.read_bytes(), others.read_bytes()) == (b"mine", b"no folder")


@pytest.mark.parametrize(
    "name", ["plain.png", "two words", "it's", "a\x03\nrm -rf x\n.png", "\x1b[31m\\'é\u202e1", "name\udce9\t7"]
)
def test_a_terminal_reads_the_copied_words_and_gets_no_control_character(name):
    line = shell_line(["printf", "%s", name])
    assert line.isprintable()
    if shutil.which("bash"):
        done = subprocess.run(["bash", "-c", line], capture_output=True, check=True)
        assert done.stdout == name.encode("utf-8", "surrogateescape")
