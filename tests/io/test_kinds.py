"""Exchanged files: the message names the kind of file that one looks like, and where to give it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rsdeblur
from rsdeblur.errors import FileFormatError
from rsdeblur.io.cameras import write_time_offset
from tests.hostile import seeds
from tests.installed import needs

READERS: dict[str, Callable[[Path], Any]] = {
    "gyro log": rsdeblur.read_gyro,
    "capture file": lambda path: rsdeblur.read_captures(path, duration=0.01),
    "camera file": rsdeblur.read_camera,
    "trajectory": rsdeblur.read_trajectory,
    "picture": rsdeblur.read_picture,
}
ADVICE = {
    "gyro log": "give it as --gyro",
    "capture file": "give it as --capture",
    "camera file": "give it as --camera",
    "trajectory": "give it as --translation",
    "picture": "give it as the photo",
    "video": "give it to rsdeblur video",
}
TIMES = np.arange(40) * 5_000_000 + 1_560_000_000_000
KALIBR = seeds.KALIBR[1].decode()


def lines(pattern: str) -> str:
    """Return a line for each of `TIMES`; `pattern` contains t in ns and s in s."""
    return "".join(pattern.format(t=t, s=(t - TIMES[0]) * 1e-9, x=np.sin(t)) + "\n" for t in TIMES.tolist())


# Name and content of files, by kind. Where a kind may be read from another one, as a camera from a log, that is left
# out.
FILES: dict[str, list[tuple[str, str]]] = {
    "gyro log": [
        ("gyro.csv", "t,wx,wy,wz\n" + lines("{s:.3f},{x:.4f},0.1,0.2")),
        ("gyro_accel.csv", "Timestamp[nanosec],gx[rad/s],gy[rad/s],gz[rad/s]\n" + lines("{t},{x:.4f},0.1,0.2")),
        ("imu.csv", "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n" + lines("{t},{x:.4f},1,2,9.8,0,0")),
        ("x_gyro.csv", lines("{x:.4f},0.1,0.2,{t}")),
        ("imu.txt", lines("4 {t} {x:.4f} 0.1 0.2")),
    ],
    "capture file": [
        ("movie_metadata.csv", "Timestamp[nanosec],Exposure time[nanosec]\n" + lines("{t},4000000")),
        ("images.txt", lines("{t} 4000000")),
        ("image_info.txt", lines("{t} 100 4000000 1500 1500 960 540 1")),
        ("timestamps.csv", lines("{t}")),
        ("frame_timestamps.txt", "Timestamp[nanosec]\n" + lines("{t}")),
    ],
    "camera file": [
        ("camera.toml", "width = 320\nheight = 240\nfocal_length = 350\n"),
        ("camera.txt", "# phone\nwidth = 320\nheight = 240\nfocal_length = 350\n"),
        ("camchain.yaml", KALIBR),
        ("lens.json", json.dumps(seeds.PROFILE)),
    ],
    "trajectory": [
        ("poses.txt", lines("{s:.3f} 0 0 0.5 0 0 0 1")),
        ("poses.csv", "t,tx,ty,tz,qx,qy,qz,qw\n" + lines("{s:.3f},0,0,0.5,0,0,0,1")),
    ],
}
# A table of four or eight numbers without a header may be a trajectory.
LIKE = [("x_gyro.csv", "trajectory"), ("image_info.txt", "trajectory")]
EXCHANGED = [
    (kind, name, content, reader)
    for kind, files in FILES.items()
    for name, content in files
    for reader in READERS
    if reader != kind and (name, reader) not in LIKE
]


@pytest.mark.parametrize(("kind", "name", "content", "reader"), EXCHANGED)
def test_exchanged_files_are_named(tmp_path: Path, kind: str, name: str, content: str, reader: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FileFormatError) as error:
        READERS[reader](path)
    message = str(error.value)
    assert message.startswith(f"{path}: not a {reader}: it looks like a {kind} (")
    assert message.endswith(f"; {ADVICE[kind]}")


@pytest.mark.filterwarnings("ignore::rsdeblur.RsdeblurWarning")
@pytest.mark.parametrize(("kind", "name", "content"), [(kind, *file) for kind in FILES for file in FILES[kind]])
def test_the_right_reader_takes_each_file(tmp_path: Path, kind: str, name: str, content: str) -> None:
    if name.endswith(".yaml"):
        needs("kalibr")
    path = tmp_path / name
    path.write_text(content)
    READERS[kind](path)


@pytest.mark.parametrize("reader", ["gyro log", "capture file", "trajectory"])
@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.webp", "a.heic"])
def test_pictures_are_named(tmp_path: Path, reader: str, name: str) -> None:
    path = tmp_path / name
    if name == "a.heic":
        path.write_bytes(b"\0\0\0\x18ftypheic" + bytes(64))
    else:
        Image.new("RGB", (8, 8)).save(path)
    with pytest.raises(FileFormatError, match=f"not a {reader}: it looks like a picture; {ADVICE['picture']}"):
        READERS[reader](path)


@pytest.mark.parametrize("reader", ["capture file", "trajectory", "picture"])
def test_videos_are_named(tmp_path: Path, reader: str) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"\0\0\0\x18ftypmp42" + bytes(64))
    with pytest.raises(FileFormatError, match=f"not a {reader}: it looks like a video; {ADVICE['video']}"):
        READERS[reader](path)


@pytest.mark.parametrize("reader", ["capture file", "camera file", "trajectory", "picture"])
def test_archives_of_logger_apps_are_named(tmp_path: Path, reader: str) -> None:
    path = tmp_path / "export.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(*FILES["gyro log"][0])
    with pytest.raises(FileFormatError, match=f"not a {reader}: it looks like a gyro log .zip archive.; give it as"):
        READERS[reader](path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("notes.txt", "no log")
    with pytest.raises(FileFormatError, match=r"export\.zip: (?!.*looks like)"):
        READERS[reader](path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("camchain.yaml", KALIBR, "format kalibr has no place .* rsdeblur camera import"),
        FILES["gyro log"][0] + ("it looks like a gyro log",),
        ("camera.toml", "width = 320\n", "lacks height"),
    ],
)
def test_only_a_camera_file_has_a_place_for_the_time_offset(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    if name.endswith(".yaml"):
        needs("kalibr")
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FileFormatError, match=message):
        write_time_offset(path, 0.1)
