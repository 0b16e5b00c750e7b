"""`rsdeblur demo`: simulate a capture and deblur it in every mode."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.choices import MODES, Mode
from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._options import Recording, Target, Track
from rsdeblur.cli._output import prepare_folder, print_json, progress, say, write_json
from rsdeblur.cli._types import SizeType
from rsdeblur.cli.compare import compare_modes, output_names, print_report
from rsdeblur.pipeline.options import Options

if TYPE_CHECKING:
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.motion.gyro import GyroLog
    from rsdeblur.types import Progress

EXPOSURE = 0.05  # s
READOUT = 0.03  # s, a slow phone sensor
FOCAL = 1.1  # picture widths: a phone's main camera sees about 50 degrees
START = 0.25  # s
LOG = 0.6  # s
STRENGTH = 0.2  # of a phone shaken on purpose: blurs by about 30 px at a width of 1024 px
NOISE = 0.01  # standard deviation in linear light: 40 dB
# "global" shows the filter and the noise-to-signal ratio of Sindelar and Sroubek (2013).
PUBLISHED: dict[str, Any] = {"prior": "wiener", "nsr": 0.02}

# The scene extends beyond the frame by this fraction of its longer side, further than the blur reaches.
MARGIN = 0.1

REPORT = "demo.json"

# Least side of the picture, px.
LEAST_SIDE = 64
# Size in px from which a picture takes every step that a large one takes.
LEAST_SIZE = 320, 240

EXAMPLES = """\b
Examples:
  rsdeblur demo -o demo
  rsdeblur demo --size 1600x1200 --seed 7 -o demo
  rsdeblur demo --recording --size 320x240 -o session
  rsdeblur demo --video --size 320x240 -o film
  rsdeblur demo --stock-camera --size 640x480 -o holiday
"""


@click.command("demo", cls=Command, epilog=EXAMPLES)
@click.option(
    "--size",
    type=SizeType(),
    metavar="WxH",
    default="1024x768",
    show_default=True,
    help="Size in px.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of scene, shake and noise."
)
@click.option("--recording", "session", flag_value="recording", help="Only simulate a logger's folder with 4 photos.")
@click.option("--video", "session", flag_value="video", help="Only simulate a logger's folder with a video.")
@click.option(
    "--stock-camera",
    "session",
    flag_value="stock-camera",
    help="Only simulate 2 photos of a camera app, and a log of Sensor Logger.",
)
@_options.target_options("DIR", "Folder to write to.  [default: demo]", default=lambda **_: Path("demo"))
def command(size: tuple[int, int], seed: int, session: str | None, target: Target) -> None:
    """Simulate a capture and deblur it in every mode; needs no data.

    The mode global uses the published method's filter, the others the default prior.

    Writes to DIR the sharp and the blurred picture, the gyro log, the camera file, the picture of each mode,
    side-by-side.png, psfs.png and demo.json, and prints the command that deblurs the blurred picture again. With
    --recording or --video, writes what a logger app would: a gyro log, the exposures, photos or a video, and a camera
    file. With --stock-camera, writes photos with EXIF blocks and a gyro log. Both print the command that deblurs them.
    """
    _check_size(size, seed, session)
    if session:
        _write_session(session, size, seed, target)
        return
    output, force = target.output, target.force
    blurred, rolling = output / "blurred.png", output / "rolling.png"
    gyro, camera = output / "gyro.csv", output / "camera.toml"
    own = (output / "sharp.png", blurred, rolling, gyro, camera)
    prepare_folder(output, [*(path.name for path in own), *output_names(blurred), REPORT], force=force)
    with progress("simulate"):
        _capture(size, seed, output, force=force)
    with progress("compile") as move:
        _compile(move)
    # From here on, the demo uses the files as a user does.
    recording = Recording(gyro=gyro, camera=camera, start=START, duration=EXPOSURE)
    changes: dict[Mode, dict[str, Any]] = {"global": PUBLISHED}
    report = compare_modes(blurred, recording, Options(), Track(), target, truth=rolling, changes=changes).report
    again = [*program(), "deblur", str(blurred), "--gyro", str(gyro), "--camera", str(camera)]
    again += ["--start", str(START), "--duration", str(EXPOSURE), "--force", "-o", str(output / "again.png")]
    report["command"] = shlex.join(again)
    write_json(output / REPORT, report)
    if target.as_json:
        print_json(report)
    else:
        print_report(report)
        where = f"The pictures are in {output}; see side-by-side.png. This command deblurs the blurred one again:"
        say("", where, "", f"  {report['command']}")


def _check_size(size: tuple[int, int], seed: int, session: str | None) -> None:
    """Refuse a size that the scene, the video or the simulated blur does not allow, before anything is written."""
    from rsdeblur.cli import _demo_session
    from rsdeblur.motion.arguments import is_held
    from rsdeblur.motion.paths import Capture
    from rsdeblur.simulation.scene import MOST_PIXELS

    width, height = size
    margin = round(MARGIN * max(size))
    problem = None
    if min(size) < LEAST_SIDE:
        problem = f"the sides must be at least {LEAST_SIDE} px"
    elif (width + 2 * margin) * (height + 2 * margin) > MOST_PIXELS:
        problem = f"the scene may have {MOST_PIXELS} px at most, with a margin of {margin} px; use a smaller size"
    elif session == "video" and (width % 2 or height % 2):
        problem = "the sides of a video must be even"
    else:
        log, camera, exposures = _demo_session.recording(session, size, seed) if session else _recording(size, seed)
        if not all(is_held(Capture.from_log(log, camera, exposure)) for exposure in exposures):
            problem = "the simulated blur is larger than so narrow a picture can hold; use a shape nearer to 4:3"
    if problem:
        raise click.UsageError(f"--size {width}x{height}: {problem}")


def _recording(size: tuple[int, int], seed: int) -> tuple[GyroLog, Camera, list[Exposure]]:
    """Return the simulated log, the camera and the exposure."""
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.simulation.shake import hand_shake

    camera = Camera(*size, FOCAL * size[0], readout_time=READOUT)
    return hand_shake(LOG, strength=STRENGTH, seed=seed), camera, [Exposure(START, EXPOSURE)]


def _write_session(kind: str, size: tuple[int, int], seed: int, target: Target) -> None:
    from rsdeblur.cli import _demo_session

    names = _demo_session.names(kind)
    prepare_folder(target.output, names, force=target.force)
    with progress("simulate"):
        _demo_session.write(kind, size, seed, target.output, force=target.force)
    again = shlex.join([*program(), *_session_command(kind, target.output)])
    if target.as_json:
        print_json({"files": names, "command": again})
    else:
        say("", f"The session is in {target.output}. This command deblurs it:", "", f"  {again}")


def _session_command(kind: str, folder: Path) -> list[str]:
    """Return the arguments that deblur a session."""
    from rsdeblur.cli import _demo_session

    if kind == "recording":
        return ["batch", str(folder), "-o", f"{folder}-sharp"]
    if kind == "stock-camera":
        photo, log = (str(folder / name) for name in (_demo_session.KINDS[kind].files[0], _demo_session.UNIX_LOG))
        readout = f"{1e3 * _demo_session.READOUT:g}ms"
        return ["deblur", photo, "--gyro", log, "--camera", photo, "--readout-time", readout, "--start", "exif"]
    sources = ["--gyro", str(folder / _demo_session.LOG), "--camera", str(folder / _demo_session.CAMERA)]
    sources += ["--capture", str(folder / _demo_session.CAPTURES)]
    return ["video", str(folder / _demo_session.MOVIE), *sources, "-o", f"{folder}-sharp.mp4"]


def program() -> list[str]:
    """Return the words that start rsdeblur again from the same folder: its name alone only if the shell finds it."""
    script = Path(sys.argv[0])
    if script.name == "__main__.py":
        return [sys.executable, "-m", "rsdeblur"]
    on_path = shutil.which("rsdeblur")
    if script.stem != "rsdeblur" or (on_path is not None and os.path.realpath(on_path) == os.path.realpath(script)):
        return ["rsdeblur"]
    return [sys.argv[0]]


def _capture(size: tuple[int, int], seed: int, output: Path, *, force: bool) -> None:
    """Simulate the capture, and write the files that a user would have and the truth."""
    from rsdeblur.image.transfer import from_linear
    from rsdeblur.io.picture_output import write_picture
    from rsdeblur.simulation.scene import scene
    from rsdeblur.simulation.simulate import simulate

    width, height = size
    margin = round(MARGIN * max(size))
    sharp = scene(height + 2 * margin, width + 2 * margin, seed=seed)
    log, camera, (exposure,) = _recording(size, seed)
    taken = simulate(sharp, log, camera, exposure, noise=NOISE, seed=seed)
    pictures: dict[str, Any] = {"sharp": taken.rectified, "rolling": taken.rolling, "blurred": taken.blurred}
    for name, light in pictures.items():
        write_picture(output / f"{name}.png", from_linear(light.clip(0.0, 1.0), "srgb"), force=force)
    camera.save(output / "camera.toml")
    _write_gyro(output / "gyro.csv", log)


def _compile(move: Progress | None) -> None:
    """Deblur a small picture in every mode, so that the times of the table contain no compilation."""
    import numpy as np

    from rsdeblur.pipeline.deblur import deblur
    from rsdeblur.simulation.scene import scene

    width, height = LEAST_SIZE
    picture = np.rint(255 * scene(height, width)).astype(np.uint8)
    log, camera, (exposure,) = _recording(LEAST_SIZE, seed=0)
    for mode in MODES:
        deblur(picture, log, camera, exposure, mode=mode, **(PUBLISHED if mode == "global" else {}), progress=move)


def _write_gyro(path: Path, log: GyroLog) -> None:
    import numpy as np

    from rsdeblur._util.atomic import atomic_write

    with atomic_write(path) as file:
        np.savetxt(file, np.column_stack([log.t, log.omega]), "%.9f", ",", header="t,wx,wy,wz", comments="")
