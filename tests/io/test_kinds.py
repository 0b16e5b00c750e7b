"""Exchanged files are named, with the place to give them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rsdeblur
from rsdeblur import FileFormatError
from tests._util import files
from tests._util.files import zipped

BY_KIND: dict[str, Callable[[Path], Any]] = {
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
    "trajectory": "rsdeblur.read_trajectory reads it",
    "picture": "give it as the photo",
    "video": "give it to rsdeblur video",
}
# Name and content of files, by kind. Where a kind may be read from another one, as a camera from a log, that is left
# out.
FILES: dict[str, list[tuple[str, str]]] = {
    "gyro log": [
        ("gyro.csv", "t,wx,wy,wz\n" + files.rows("{s},{x},{y},{z}")),
        *((f"{name} gyro.csv", files.LAYOUTS[name][0]) for name in ("mars", "kalibr", "tags", "opencamera")),
    ],
    "capture file": [(f"{name}.csv", files.CAPTURES[name]) for name in ("deepgyro", "image-info", "timestamps")]
    + [("named.csv", files.CAPTURES["named"]), ("frame_timestamps.txt", files.CAPTURES["named timestamps"])],
    "camera file": [
        ("camera.toml", files.CAMERA_TOML[0].decode()),
        ("camera.txt", files.CAMERA_TOML[1].decode()),
        ("camchain.yaml", files.CHAIN),
        ("lens.json", files.LENSES[0].decode()),
    ],
    "trajectory": [(f"{name}.txt", files.TRAJECTORIES[name]) for name in ("tum without a header", "named")],
}
# A table of four or eight numbers without a header may be a trajectory.
LIKE = [("opencamera gyro.csv", "trajectory"), ("image-info.csv", "trajectory")]
EXCHANGED = [
    (kind, name, content, reader)
    for kind, files in FILES.items()
    for name, content in files
    for reader in BY_KIND
    if reader != kind and (name, reader) not in LIKE
]


@pytest.mark.parametrize(("kind", "name", "content", "reader"), EXCHANGED)
def test_exchanged_files_are_named(tmp_path: Path, kind: str, name: str, content: str, reader: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FileFormatError) as error:
        BY_KIND[reader](path)
    message = str(error.value)
    assert message.startswith(f"{path}: not a {reader}: it looks like a {kind} (")
    assert message.endswith(f"; {ADVICE[kind]}")


BINARY = {
    "picture": [
        *(("a.png", files.pngs()[0]), ("a.jpg", files.jpegs()[0]), ("a.tif", files.tiffs()[0])),
        *(("a.webp", files.webps()[0]), ("a.heic", b"\0\0\0\x18ftypheic" + bytes(64))),
    ],
    "video": [("clip.mp4", b"\0\0\0\x18ftypmp42" + bytes(64))],
}


@pytest.mark.parametrize("reader", ["gyro log", "capture file", "trajectory", "picture"])
@pytest.mark.parametrize("kind", BINARY)
def test_pictures_and_videos_are_named(write: Callable[..., Path], reader: str, kind: str) -> None:
    if reader != kind and (reader, kind) != ("gyro log", "video"):
        for name, content in BINARY[kind]:
            with pytest.raises(FileFormatError, match=f"not a {reader}: it looks like a {kind}; {ADVICE[kind]}"):
                BY_KIND[reader](write(content, name))


@pytest.mark.parametrize("reader", ["capture file", "camera file", "trajectory", "picture"])
def test_archives_of_logger_apps_are_named(write: Callable[..., Path], reader: str) -> None:
    path = write(zipped(dict(FILES["gyro log"][:1])), "export.zip")
    with pytest.raises(FileFormatError, match=f"not a {reader}: it looks like a gyro log .zip archive.; give it as"):
        BY_KIND[reader](path)
    write(zipped({"notes.txt": "no log"}), "export.zip")
    with pytest.raises(FileFormatError, match=r"export\.zip: (?!.*looks like)"):
        BY_KIND[reader](path)
