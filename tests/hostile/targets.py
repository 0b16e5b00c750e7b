"""What is damaged: the readers, valid files, and what must hold for everything that is read."""

import json
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from rsdeblur import PsfBank, read_picture, write_picture
from rsdeblur.io import open_camera, read_acceleration, read_trajectory
from rsdeblur.report.facts import camera_facts, capture_facts, gyro_facts, picture_facts
from tests._util import files, gyroflow
from tests.hostile import packets
from tests.hostile.mutate import mutated

AS_IS: dict[str, Any] = dict.fromkeys(("format", "unit", "orientation", "columns"))
WRITTEN = (".jpg", ".png", ".tif", ".webp", ".npy")


@dataclass(frozen=True, slots=True)
class Target:
    """One reader and one format.

    Parameters
    ----------
    read : callable
        Reads a file and checks the result; may raise nothing but `RsdeblurError`.
    seeds : callable
        Makes valid files, or content that `pack` makes into files.
    name : str
        Name of the file.
    text : bool
        Whether to damage numbers, words and lines.
    pack : callable, optional
        Makes a file of the damaged content, for formats with check sums or compression, which reject random damage.
    """

    read: Callable[[Path], Any]
    seeds: Callable[[], Sequence[bytes]]
    name: str = "file.bin"
    text: bool = False
    pack: Callable[[bytes], bytes] | None = None

    def spoilt(self, number: int) -> bytes:
        """Return hostile file `number`, the same in every run."""
        rng = random.Random(f"{self.name} {number}")
        contents = _seeds(self)
        content = rng.choice(contents)
        if self.pack is None:
            return mutated(content, rng, contents, text=self.text)
        content = mutated(content, rng, contents, text=self.text) if rng.random() < 0.9 else content
        file = self.pack(content)
        return mutated(file, rng, [file], text=False) if rng.random() < 0.15 else file


@cache
def _seeds(target: Target) -> Sequence[bytes]:
    return target.seeds()


def _gyro(path: Path) -> None:
    json.dumps(gyro_facts(path, AS_IS))


def _unstamped(path: Path) -> None:
    json.dumps(gyro_facts(path, AS_IS | {"rate": 200.0}))


def _trajectory(path: Path) -> None:
    read_trajectory(path)


def _camera(path: Path) -> None:
    json.dumps(camera_facts(open_camera(path)))


def _captures(path: Path) -> None:
    json.dumps(capture_facts(path))


def _picture(path: Path) -> None:
    picture = read_picture(path)
    json.dumps(picture_facts(path))
    # A picture that was read must be writable, with its EXIF block and profile.
    extension = WRITTEN[path.stat().st_size % len(WRITTEN)]
    if np.isfinite(picture.pixels).all():
        write_picture(path.with_name(f"again{extension}"), picture.pixels, like=picture, force=True)


def _text(read: Callable[[Path], Any], texts: Sequence[bytes] | dict[str, str], name: str) -> Target:
    contents = [text.encode() for text in texts.values()] if isinstance(texts, dict) else texts
    return Target(read, lambda: contents, name, text=True)


TARGETS: dict[str, Target] = {
    **{name: _text(_gyro, tables, "log.csv") for name, tables in files.GYRO_TABLES.items()},
    "unstamped": _text(_unstamped, files.UNSTAMPED, "log.csv"),
    "acceleration": _text(read_acceleration, files.ACCELERATIONS, "accel.csv"),
    "trajectory": _text(_trajectory, files.TRAJECTORIES, "poses.txt"),
    "sensorlogger-json": Target(_gyro, lambda: [files.sensorlogger_json()], "log.json", text=True),
    "gyrodata": Target(_gyro, lambda: [files.trailer()], "a.jpg"),
    "zip": Target(_gyro, lambda: [files.GYRO_TABLES["sensorlogger"][0]], "a.zip", text=True, pack=files.archive),
    "zip-file": Target(
        _gyro,
        lambda: [files.archive(files.GYRO_TABLES["sensorlogger"][0])],
        "a.zip",
    ),
    "gyroflow": Target(
        _gyro,
        lambda: [
            gyroflow.project({"raw_imu": [[0.005 * i, *rate] for i, rate in enumerate(files.RATES.tolist())]}),
            gyroflow.project({"raw_imu": [{"timestamp_ms": 5 * i, "gyro": [1, 2, 3.5]} for i in range(9)]}),
            gyroflow.packed_project(gyroflow.cbor(), "file_metadata"),
            b'{"gyro_source": {"raw_imu": [[0.0, 1, 2, 3], [0.005, 1, 2, 3]]}}',
        ],
        "a.gyroflow",
        text=True,
    ),
    "gyroflow-cbor": Target(
        _gyro, lambda: [gyroflow.cbor()], "a.gyroflow", pack=partial(gyroflow.packed_project, key="file_metadata")
    ),
    "gyroflow-bincode": Target(
        _gyro, lambda: [gyroflow.bincode()], "a.gyroflow", pack=partial(gyroflow.packed_project, key="raw_imu")
    ),
    "toml": _text(_camera, files.CAMERA_TOML, "camera.toml"),
    "kalibr": _text(_camera, files.KALIBR, "camera.yaml"),
    "dso": Target(_camera, lambda: [text.encode() for text in files.DSO], "camera.txt", text=True),
    "gyroflow-lens": Target(_camera, lambda: [*files.LENSES, gyroflow.project({})], "lens.json", text=True),
    "exif": Target(_camera, lambda: [files.exif()], "a.jpg", pack=files.jpeg),
    "captures": _text(_captures, files.CAPTURES, "captures.csv"),
    "mars-camera": _text(_camera, [files.CAPTURES["ios"].encode()], "captures.csv"),
    "gyrodata-captures": Target(_captures, lambda: [files.trailer()], "a.jpg"),
    "jpeg": Target(_picture, lambda: [*files.jpegs(), *packets.jpegs()], "a.jpg"),
    "jpeg-exif": Target(_picture, lambda: [files.exif()], "a.jpg", pack=files.jpeg),
    "png": Target(_picture, lambda: [*files.pngs(), *packets.pngs()], "a.png"),
    "png-mended": Target(_picture, files.pngs, "a.png", pack=files.mended_png),
    "webp": Target(_picture, lambda: [*files.webps(), *packets.webps()], "a.webp"),
    "tiff": Target(_picture, lambda: [*files.tiffs(), *packets.tiffs()], "a.tif"),
    "npy": Target(_picture, files.npys, "a.npy"),
    "heic": Target(_picture, lambda: [files.heic(), *packets.heics()], "a.heic"),
    "dng": Target(_picture, lambda: [files.dng()], "a.dng"),
    "psf-bank": Target(PsfBank.load, lambda: [files.bank()], "bank.npz"),
}
