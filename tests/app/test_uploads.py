"""Laws of the app's temporary folder."""

import tempfile

import pytest

from rsdeblur.app.server import Uploads, plain
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
    kept.cleanup()


def test_equal_names_are_different_files_that_only_this_user_can_read(uploads, temporary):
    paths = [uploads.keep(name, name.encode()) for name in ("imu0/data.csv", "cam0\\data.csv", "../../etc/da<ta.csv")]
    assert [path.name for path in paths] == ["data.csv"] * 3
    assert [path.read_bytes() for path in paths] == [b"imu0/data.csv", b"cam0\\data.csv", b"../../etc/da<ta.csv"]
    for path in paths:
        assert path.parents[2] == temporary
        assert path.parent.stat().st_mode & 0o077 == path.parents[1].stat().st_mode & 0o077 == 0
    for name in ("", "..", "/", "a/"):
        with pytest.raises(InputError, match="usable name"):
            uploads.keep(name, b"")
    assert plain(f"{paths[0]}: line 3, see {paths[1]}") == "data.csv: line 3, see data.csv"
    uploads.cleanup()
    assert list(temporary.iterdir()) == []


def test_a_full_disk_is_an_error_that_names_the_remedy(uploads, temporary):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        with pytest.raises(OutputError, match="TMPDIR") as caught:
            uploads.keep("gyro.csv", bytes(8192))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert str(caught.value).startswith("gyro.csv: ")
