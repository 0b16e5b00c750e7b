"""`rsdeblur demo`: simulate a capture and deblur it in every mode, or simulate the files of a logger or camera app."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import click

from rsdeblur._util.files import atomic_write
from rsdeblur.choices import CAMERA
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._options import Command, Recording, Target, option
from rsdeblur.cli._output import prepare_folder, print_json, progress, say
from rsdeblur.cli._types import SIZE
from rsdeblur.cli.compare import REPORT, compare_modes, output_names
from rsdeblur.pipeline.options import Options

FOCAL35 = 26  # mm, of the photos of a camera app
LOG, CAPTURES, MOVIE = "gyro_accel.csv", "movie_metadata.csv", "movie.mp4"
CAPTURE_LOG = "gyro.csv"


# Header and row of a log; a row contains the time `t` in ns, the seconds `s` from the start, x, y and z.
PLAIN = "t,wx,wy,wz", "{s:.9f},{x:.9f},{y:.9f},{z:.9f}"
MARS = "Timestamp[nanosec], gx[rad/s], gy[rad/s], gz[rad/s]", "{t},{x:.9f},{y:.9f},{z:.9f}"
SENSOR_LOGGER = "time,seconds_elapsed,z,y,x", "{t},{s:.9f},{z:.9f},{y:.9f},{x:.9f}"


class Kind(NamedTuple):
    """What is simulated: files, the log's first; frames, their interval and exposure (s), and the recording.

    `command` deblurs what is in the folder `{d}`, `log` is the form of the log. `strength` is that of the shake, of a
    phone shaken on purpose, `noise` a standard deviation in linear light, `start` that of the first frame (s),
    `readout` in s and `epoch_ns` that of the log.
    """

    files: tuple[str, ...]
    command: str
    log: tuple[str, str]
    frames: int
    interval: Fraction
    duration: Fraction = Fraction(1, 20)
    start: float = 0.25
    epoch_ns: int = 1_560_000_000_000  # of a phone that was started half an hour ago
    strength: float = 0.4
    noise: float = 0.005
    readout: float = 0.02

    @property
    def photos(self) -> list[str]:
        """The files that are pictures."""
        return [name for name in self.files if name.endswith((".png", ".jpg"))]


KINDS = {
    # Blurs by about 30 px at a width of 1024 px, with the readout of a slow phone sensor.
    "capture": Kind(
        (CAPTURE_LOG, CAMERA, "sharp.png", "rolling.png", "blurred.png"),
        "deblur {d}/blurred.png --gyro {d}/gyro.csv --camera {d}/camera.toml --start 0.25 --duration 0.05 "
        "-o {d}/again.png",
        *(PLAIN, 1, Fraction(1, 10)),
        epoch_ns=0,
        strength=0.2,
        noise=0.01,
        readout=0.03,
    ),
    "recording": Kind(
        (LOG, CAMERA, CAPTURES, *(f"frame{i:04}.png" for i in range(4))),
        "batch {d} -o {d}-sharp",
        *(MARS, 4, Fraction(1, 2)),
    ),
    "video": Kind(
        (LOG, CAMERA, CAPTURES, MOVIE),
        f"video {{d}}/{MOVIE} --gyro {{d}}/{LOG} --camera {{d}}/{CAMERA} --capture {{d}}/{CAPTURES} -o {{d}}-sharp.mp4",
        *(MARS, 24, Fraction(1, 30), Fraction(1, 40)),
    ),
    # The log extends beyond the search of `--start exif`.
    "stock-camera": Kind(
        ("Gyroscope.csv", "IMG_1.jpg", "IMG_2.jpg"),
        "deblur {d}/IMG_1.jpg --gyro {d}/Gyroscope.csv",
        *(SENSOR_LOGGER, 2, Fraction(2)),
        start=2.5,
        epoch_ns=1_780_000_000_000_000_000,
    ),
}

EXAMPLES = """\b
Examples:
  rsdeblur demo --size 1600x1200 --seed 7 -o demo
  rsdeblur demo --stock-camera --size 640x480 -o holiday
"""


@click.command("demo", cls=Command, epilog=EXAMPLES)
@option("--size", type=SIZE, metavar="WxH", default="1024x768", show_default=True, help="Size in px.")
@option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of scene, shake and noise.")
@option(
    *("--recording", "kind"),
    flag_value="recording",
    default="capture",
    help="Only simulate a logger's folder with 4 photos.",
)
@option(*("--video", "kind"), flag_value="video", help="Only simulate a logger's folder with a video.")
@option(
    *("--stock-camera", "kind"),
    flag_value="stock-camera",
    help="Only simulate 2 photos of a camera app, and a log of Sensor Logger.",
)
@_options.target_options("DIR", "Folder to write to; by default demo.", default=lambda **_: Path("demo"))
def command(size: tuple[int, int], seed: int, kind: str, target: Target) -> None:
    """Simulate a capture and deblur it in every mode; needs no data.

    Writes to DIR the sharp and the blurred picture, the gyro log, the camera file, and what `compare` writes. With
    --recording or --video, writes what a logger app would: a gyro log, the exposures, photos or a video, and a camera
    file. With --stock-camera, writes photos with EXIF blocks and a gyro log. Each prints the command that deblurs.
    """
    if min(size) < 64 or (kind == "video" and (size[0] % 2 or size[1] % 2)):
        raise click.UsageError(f"--size {size[0]}x{size[1]}: the sides must be at least 64 px, and of a video even")
    output, force = target.output, target.force
    names, words = KINDS[kind].files, KINDS[kind].command.split()
    again = shlex.join(["rsdeblur", *(word.format(d=output) for word in words)])
    compared = [*output_names(output / "blurred.png"), REPORT] if kind == "capture" else []
    prepare_folder(output, [*names, *compared], force=force)
    with progress("simulate"):
        write_files(kind, size, seed, output, force=force)
    if kind == "capture":
        # From here on, the demo uses the files as a user does.
        blurred, rolling, gyro, camera = (output / name for name in ("blurred.png", "rolling.png", CAPTURE_LOG, CAMERA))
        start, duration = KINDS[kind].start, float(KINDS[kind].duration)
        recording = Recording(gyro=gyro, camera=camera, start=start, duration=duration)
        compare_modes(blurred, recording, Options(), target, truth=rolling)
    elif target.as_json:
        print_json({"files": names, "command": again})
    if not target.as_json:
        say("", f"The files are in {output}. This command deblurs them:", "", f"  {again}")


def simulated(kind: str, size: tuple[int, int], seed: int) -> tuple[rs.GyroLog, rs.Camera, list[rs.Exposure]]:
    """Return the simulated log, the camera and the exposures."""
    (width, height), session = size, KINDS[kind]
    times = [session.start + float(i * session.interval) for i in range(session.frames)]
    exposures = [rs.Exposure(0.0, float(session.duration), session.epoch_ns + round(1e9 * time)) for time in times]
    length = 2 * session.start + float(session.frames * session.interval)
    shake = rs.hand_shake(length, strength=session.strength, seed=seed)
    # Others see about 50 degrees, like a phone's main camera.
    focal = rs.focal35_px(FOCAL35, width, height) if kind == "stock-camera" else 1.1 * width
    # The apps log in phone axes.
    axes: dict[str, Any] = {} if kind == "capture" else {"imu_to_camera": "phone-landscape"}
    camera = rs.Camera(width, height, focal, readout_time=session.readout, **axes)
    return rs.GyroLog(shake.t, shake.omega, session.epoch_ns), camera, exposures


def write_files(kind: str, size: tuple[int, int], seed: int, folder: Path, *, force: bool) -> None:
    """Simulate, and write the files that a user would have; of a single capture, the truth too."""
    session = KINDS[kind]
    if kind == "video":
        import rsdeblur.video.clip  # noqa: F401  refuses a missing extra before the work
    log, camera, exposures = simulated(kind, size, seed)
    # The scene extends beyond the frame, further than the blur reaches.
    margin = round(0.1 * max(size))
    sharp = rs.scene(size[1] + 2 * margin, size[0] + 2 * margin, seed=seed)
    if kind == "capture":
        taken = rs.simulate(sharp, log, camera, exposures[0], noise=session.noise, seed=seed)
        frames = map(_display, (taken.rectified, taken.rolling, taken.blurred))
    else:
        clip = rs.simulate_clip(sharp, log, camera, exposures, noise=session.noise, seed=seed, samples=16)
        frames = map(_display, clip)
    if kind == "video":
        _write_movie(folder / MOVIE, frames, size, session.interval)
    else:
        blocks = [_exif(each) for each in exposures] if kind == "stock-camera" else [None] * len(session.photos)
        for name, frame, block in zip(session.photos, frames, blocks, strict=True):
            rs.write_picture(folder / name, frame, like=rs.Picture(frame, block), bits=8, force=force)
    header, row = session.log
    samples = zip(log.t.tolist(), log.omega.tolist(), strict=True)
    rows = (row.format(t=log.epoch_ns + round(1e9 * s), s=s, x=x, y=y, z=z) for s, (x, y, z) in samples)
    _write_lines(folder / session.files[0], [header, *rows])
    if CAMERA in session.files:
        camera.save(folder / CAMERA)
    if CAPTURES in session.files:
        focal, readout = camera.focal_length[0], round(1e9 * camera.readout_time)
        header = "Timestamp[nanosec],fx[px],fy[px],Frame No.,Exposure time[nanosec],Frame readout time[nanosec]"
        rows = (
            f"{each.epoch_ns},{focal:.2f},{focal:.2f},{i},{round(1e9 * each.duration)},{readout}"
            for i, each in enumerate(exposures)
        )
        _write_lines(folder / CAPTURES, [header, *rows])


def _display(light: rs.NDArray[Any]) -> rs.NDArray[Any]:
    return rs.from_linear(light.clip(0.0, 1.0), "srgb")


def _exif(exposure: rs.Exposure) -> bytes:
    """Return the EXIF block of a camera app."""
    from PIL import Image
    from PIL.ExifTags import IFD, Base

    # Late, s: a camera app writes the time when it stores the photo.
    taken = datetime.fromtimestamp(exposure.epoch_ns * 1e-9 + 0.41, UTC)
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


def _write_lines(path: Path, lines: Sequence[str]) -> None:
    with atomic_write(path) as file:
        file.writelines(f"{line}\n".encode() for line in lines)


def _write_movie(path: Path, frames: Iterable[rs.NDArray[Any]], size: tuple[int, int], interval: Fraction) -> None:
    """Encode display values as H.264 with one frame per `interval`."""
    import numpy as np

    with atomic_write(path) as file, rs.av.open(file, "w", format="mp4") as container:
        stream: Any = container.add_stream("libx264", rate=1 / interval, options={"crf": "12"})
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for values in frames:
            frame = rs.av.VideoFrame.from_ndarray(np.rint(65535 * values).astype(np.uint16), format="rgb48le")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
