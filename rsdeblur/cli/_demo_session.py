"""Simulated sessions for `rsdeblur demo`: what a logger app writes, or a camera app and a separate log."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.motion.gyro import GyroLog

EPOCH = 1_560_000_000_000  # ns, of a phone that was started half an hour ago
UNIX_EPOCH = 1_780_000_000_000_000_000  # ns
LATE = 0.41  # s, of the times in EXIF after the exposures: a camera app writes when it stores the photo
MARGIN = 0.1  # of the scene beyond the frame, in longer sides
STRENGTH = 0.4  # of a phone shaken on purpose
FOCAL, READOUT, NOISE = 1.1, 0.02, 0.005  # picture widths, s, standard deviation in linear light
FOCAL35 = 26  # mm, of the photos of a camera app
LOG, CAMERA, CAPTURES, MOVIE = "gyro_accel.csv", "camera.toml", "movie_metadata.csv", "movie.mp4"
UNIX_LOG = "Gyroscope.csv"


class Kind(NamedTuple):
    """Number of frames, their interval and duration in s, their files (none: a video), and the first start in s."""

    frames: int
    interval: Fraction
    duration: Fraction
    files: tuple[str, ...]
    start: float = 0.25
    epoch_ns: int = EPOCH


KINDS = {
    "recording": Kind(4, Fraction(1, 2), Fraction(1, 20), tuple(f"frame{i:04}.png" for i in range(4))),
    "video": Kind(24, Fraction(1, 30), Fraction(1, 40), ()),
    # The log extends beyond the search of `--start exif`.
    "stock-camera": Kind(2, Fraction(2), Fraction(1, 20), ("IMG_1.jpg", "IMG_2.jpg"), 2.5, UNIX_EPOCH),
}


def names(kind: str) -> list[str]:
    """Return the names of the files that :func:`write` makes."""
    others = [UNIX_LOG] if kind == "stock-camera" else [LOG, CAMERA, CAPTURES]
    return [*others, *(KINDS[kind].files or [MOVIE])]


def recording(kind: str, size: tuple[int, int], seed: int) -> tuple[GyroLog, Camera, list[Exposure]]:
    """Return the simulated log, the camera and the exposures of a session."""
    from rsdeblur.io.exif import FILM_DIAGONAL
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.motion.gyro import GyroLog
    from rsdeblur.simulation.shake import hand_shake

    (width, height), session = size, KINDS[kind]
    starts = [
        session.epoch_ns + round(1e9 * (session.start + float(i * session.interval))) for i in range(session.frames)
    ]
    exposures = [Exposure(0.0, float(session.duration), timestamp) for timestamp in starts]
    shake = hand_shake(2 * session.start + float(session.frames * session.interval), strength=STRENGTH, seed=seed)
    focal = FOCAL35 / FILM_DIAGONAL * math.hypot(width, height) if kind == "stock-camera" else FOCAL * width
    # The apps log in phone axes.
    camera = Camera(width, height, focal, readout_time=READOUT, imu_to_camera="phone-landscape")
    return GyroLog(shake.t, shake.omega, session.epoch_ns), camera, exposures


def write(kind: str, size: tuple[int, int], seed: int, folder: Path, *, force: bool) -> None:
    """Simulate a session and write its files.

    They are those of MARS logger with a camera file, or photos with EXIF blocks and a log of Sensor Logger.
    """
    from rsdeblur.io.picture_output import write_picture
    from rsdeblur.io.pictures import Picture

    session, stock = KINDS[kind], kind == "stock-camera"
    if kind == "video":
        import rsdeblur.video._av  # noqa: F401  refuses a missing extra before the work
    log, camera, exposures = recording(kind, size, seed)
    frames = _frames(log, camera, exposures, seed)
    if session.files:
        for name, frame, exposure in zip(session.files, frames, exposures, strict=True):
            like = Picture(frame, _exif(exposure)) if stock else None
            write_picture(folder / name, frame, like=like, bits=8, force=force)
    else:
        _write_movie(folder / MOVIE, frames, size, session.interval)
    if stock:
        _write_log(folder / UNIX_LOG, log, "time,seconds_elapsed,z,y,x", "{t},{s:.9f},{z:.9f},{y:.9f},{x:.9f}")
        return
    camera.save(folder / CAMERA)
    _write_log(folder / LOG, log, "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s]", "{t},{x:.9f},{y:.9f},{z:.9f}")
    _write_captures(folder / CAPTURES, exposures, camera)


def _exif(exposure: Exposure) -> bytes:
    """Return the EXIF block of a camera app."""
    from PIL import Image
    from PIL.ExifTags import IFD, Base

    taken = datetime.fromtimestamp(exposure.epoch_ns * 1e-9 + LATE, UTC)
    block = Image.Exif()
    block[Base.Model] = "rsdeblur demo"
    block.get_ifd(IFD.Exif).update(
        {
            Base.DateTimeOriginal: f"{taken:%Y:%m:%d %H:%M:%S}",
            Base.SubsecTimeOriginal: f"{taken.microsecond // 1000:03}",
            Base.OffsetTimeOriginal: "+00:00",
            Base.ExposureTime: exposure.duration,
            Base.FocalLengthIn35mmFilm: FOCAL35,
        }
    )
    return block.tobytes()


def _frames(log: GyroLog, camera: Camera, exposures: list[Exposure], seed: int) -> Iterator[NDArray[np.float32]]:
    """Yield the frames as display values in [0, 1]."""
    from rsdeblur.image.transfer import from_linear
    from rsdeblur.simulation.clip import simulate_clip
    from rsdeblur.simulation.scene import scene

    margin = round(MARGIN * max(camera.width, camera.height))
    sharp = scene(camera.height + 2 * margin, camera.width + 2 * margin, seed=seed)
    for frame in simulate_clip(sharp, log, camera, exposures, noise=NOISE, seed=seed, samples=16):
        yield from_linear(frame.clip(0.0, 1.0), "srgb")


def _write_log(path: Path, log: GyroLog, header: str, row: str) -> None:
    """Write a line for each sample; `row` contains the time `t` in ns, the seconds `s` from the start, x, y and z."""
    lines = [header]
    for s, (x, y, z) in zip(log.t.tolist(), log.omega.tolist(), strict=True):
        lines.append(row.format(t=log.epoch_ns + round(1e9 * s), s=s, x=x, y=y, z=z))
    _write_lines(path, lines)


def _write_captures(path: Path, exposures: list[Exposure], camera: Camera) -> None:
    header = "Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],Frame readout time[nanosec]"
    focal, readout = camera.focal_length[0], round(1e9 * camera.readout_time)
    rows = (
        f"{each.epoch_ns},{focal:.2f},{focal:.2f},{i},{round(1e9 * each.duration)},{readout}"
        for i, each in enumerate(exposures)
    )
    _write_lines(path, [header, *rows])


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    from rsdeblur._util.atomic import atomic_write

    with atomic_write(path) as file:
        file.writelines(f"{line}\n".encode() for line in lines)


def _write_movie(path: Path, frames: Iterable[NDArray[np.float32]], size: tuple[int, int], interval: Fraction) -> None:
    """Encode display values as H.264 with one frame per `interval`."""
    from rsdeblur._util.atomic import atomic_write
    from rsdeblur.video._av import av

    with atomic_write(path) as file, av.open(file, "w", format="mp4") as container:
        stream: Any = container.add_stream("libx264", rate=1 / interval, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for values in frames:
            frame = av.VideoFrame.from_ndarray(np.rint(65535 * values).astype(np.uint16), format="rgb48le")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
