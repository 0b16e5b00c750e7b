"""Hostile files: a reader reads them, or refuses them in one message that names the file.

Damaged files of every format, and a test for every fault that long runs have found: `RSDEBLUR_HOSTILE` is the number of
damaged files of each format.
"""

import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rsdeblur import Camera, PsfBank
from rsdeblur.errors import FileFormatError, RsdeblurError
from rsdeblur.io import open_camera, open_gyro, read_acceleration, read_captures, read_gyro, read_picture
from rsdeblur.io.trajectories import read_trajectory
from tests._util import files
from tests.hostile import targets
from tests.installed import needs

READERS: dict[str, Callable[[Path], Any]] = {
    "gyro": open_gyro,
    "acceleration": read_acceleration,
    "trajectory": read_trajectory,
    "camera": open_camera,
    "toml": Camera.load,
    "captures": read_captures,
    "picture": read_picture,
    "bank": PsfBank.load,
}
# Number of inputs per target; each takes a few milliseconds.
INPUTS = int(os.environ.get("RSDEBLUR_HOSTILE", "15"))


@pytest.fixture(params=READERS.values(), ids=READERS)
def read(request: pytest.FixtureRequest) -> Callable[[Path], Any]:
    return request.param


def refuses(read: Callable[[Path], Any], path: Path) -> bool:
    """Return whether a file is refused; the message must name the file, or one that was to be written beside it."""
    error = None
    try:
        read(path)
    except RsdeblurError as caught:
        error = caught
    assert error is None or str(path.parent) in str(error)
    return error is not None


def refusal(read: Callable[[Path], Any], path: Path) -> str:
    with pytest.raises(FileFormatError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


# Extras that write or read these formats.
EXTRAS = {"gyroflow": "gyroflow", "gyroflow-cbor": "gyroflow", "heic": "heif", "dng": "raw", "kalibr": "kalibr"}


@pytest.mark.parametrize("name", targets.TARGETS)
def test_spoilt_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    if name in EXTRAS:
        needs(EXTRAS[name])
    target = targets.TARGETS[name]
    path = tmp_path / target.name
    refused = 0
    with warnings.catch_warnings():
        # Warnings of libraries about the files do not matter; computing with NaN or overflowing numbers does.
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", category=RuntimeWarning, module="rsdeblur")
        for content in target.seeds():
            path.write_bytes(target.pack(content) if target.pack else content)
            target.read(path)
        for number in range(INPUTS):
            path.write_bytes(target.spoilt(number))
            refused += refuses(target.read, path)
    # The mutations have an effect; but a picture is read even without its EXIF block.
    assert refused or name == "jpeg-exif"


def test_what_is_no_file_is_refused_at_once(read: Callable[[Path], Any], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "nothing").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    places = {"pipe": "a pipe or a device", "/dev/zero": "a pipe or a device", "": "it is a folder"}
    places |= {"nothing": "No such file", "loop": "Too many levels", "a\0b": "cannot read", "a\ud800b": "cannot read"}
    for name, words in places.items():
        assert words in refusal(read, tmp_path / name)


@pytest.mark.parametrize("name", ["a\nb.csv", "a b'\".csv", "-rf.csv", "\udcff.csv", "é😀.csv", "x" * 250 + ".csv"])
def test_odd_names(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(files.GYRO_TABLES["plain"][0])
    assert len(read_gyro(path)) == len(files.RATES)
    path.write_bytes(b"nothing")
    refusal(read_gyro, path)


def test_yaml_has_aliases_and_nothing_that_is_built_or_called(tmp_path: Path) -> None:
    needs("kalibr")
    path = tmp_path / "camera.yaml"
    camera = "cam0: {camera_model: pinhole, intrinsics: %s, resolution: [640, 480], distortion_model: none}\n"
    path.write_text("k: &k [500, 500, 320, 240]\n" + camera % "*k")
    assert open_camera(path).camera.focal_length == (500.0, 500.0)
    path.write_text(camera % f"!!python/object/apply:os.mkdir [{tmp_path / 'made'}]")
    assert "could not determine a constructor" in refusal(open_camera, path)
    assert not (tmp_path / "made").exists()


def test_zip_whose_names_lead_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "secret.csv").write_bytes(files.GYRO_TABLES["plain"][0])
    path = tmp_path / "a.zip"
    for name in (f"{tmp_path}/secret.csv", "../secret.csv"):
        path.write_bytes(files.zipped({name: b"\0\0\0\x18ftypmp42"}))
        assert "a.zip" in refusal(open_gyro, path)


def test_a_damaged_tiff_prints_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(b"II*\0\x08\0\0\0\x02\0" + b"\x01\x63" * 30)
    refusal(read_picture, path)
    assert capfd.readouterr().err == ""
