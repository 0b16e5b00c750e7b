"""`rsdeblur calibrate`: calibrate camera, clock and axes from a clip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import clip_exposures, naming, read_log
from rsdeblur.cli._options import Moments, Target
from rsdeblur.cli._output import print_json, print_table, progress, say
from rsdeblur.cli._types import SecondsType

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.estimate.calibrate import Calibration
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure

EXAMPLES = """\b
Examples:
  rsdeblur calibrate clip.mp4 --gyro gyro_accel.csv --capture movie_metadata.csv -o phone.toml
  rsdeblur calibrate clip.mov --gyro clip.gcsv --camera start.toml --duration 1/500 --from -3s --to 3s -o camera.toml
  rsdeblur calibrate burst/*.jpg --gyro imu.txt --capture images.txt -o tablet.toml
"""

# Focal length over the longer side where no file gives one: 27 mm equivalent, with a little cut off for a video.
GUESSED_FOCAL = 0.8
# Consecutive frames that are taken from each part of a longer clip.
RUN = 16
# Decimals, factors and units of the table.
UNITS = {"s": (1e3, "ms", 3), "px": (1.0, "px", 1), "rad": (57.29578, "deg", 2), "rad/s": (1.0, "rad/s", 4)}
UNITS |= {"s/s": (1e6, "us/s", 1)}
STATES = ("assumed", "determined")


@click.command("calibrate", cls=Command, epilog=EXAMPLES)
@click.argument("sources", type=_options.PATH, metavar="CLIP|PHOTO...", nargs=-1, required=True)
@_options.clip_log_options
@click.option("--camera", "camera_file", type=_options.PATH, metavar="FILE", help="Camera file with start values.")
@click.option(
    "--index", type=click.IntRange(min=0), default=0, show_default=True, help="Number of the first PHOTO in --capture."
)
@click.option("--from", "first", type=SecondsType(), default=-1.0, help="First time offset.  [default: -1s]")
@click.option("--to", "last", type=SecondsType(), default=1.0, help="Last time offset.  [default: 1s]")
@click.option(
    "--frames",
    type=click.IntRange(min=RUN),
    default=128,
    show_default=True,
    help="Number of frames that are used; those of a longer clip are spread over it.",
)
@_options.target_options("TOML", "Camera file to write.")
def command(
    sources: tuple[Path, ...],
    recording: Moments,
    camera_file: Path | None,
    index: int,
    first: float,
    last: float,
    frames: int,
    target: Target,
) -> None:
    """Calibrate a camera from a CLIP, or from several PHOTOs of one recording, and the gyro log.

    The motion between frames against the log gives the clock offset, the mounting of the gyro (all 24, and left-handed
    logs by name), the readout time and its direction, the focal length, and the gyro's bias. The clip may be blurred.
    Turn the camera unevenly about all of its axes, some seconds long, before a distant scene with texture; switch off
    stabilisation. --from and --to are relative to the time offset in the camera file.

    A value that the clip does not determine is assumed: it keeps its start value. Exit code 1 means that the fit is
    not trustworthy; then no file is written.
    """
    from rsdeblur._util.atomic import check_target
    from rsdeblur.errors import InputError
    from rsdeblur.estimate.calibrate import calibrate

    check_target(target.output, force=target.force)
    log = read_log(recording).log
    with progress("calibrate") as move, naming(sources[0], recording):
        pictures, exposures, size = _film(sources, recording, index, frames)
        camera = _start(camera_file, sources[0], size)
        result = calibrate(pictures, exposures, log, camera, search=(first, last), progress=move)
    if result.accepted:
        result.camera.save(target.output)
    if target.as_json:
        print_json(_facts(result, target.output))
    elif result.values:
        _print(result)
    if not result.accepted:
        raise InputError(f"{sources[0]}: no camera file is written: {result.reason}")
    if not target.as_json:
        say(f"{target.output}: written")


def _film(
    sources: Sequence[Path], recording: Moments, index: int, count: int
) -> tuple[Iterator[NDArray[Any]], list[Exposure], tuple[int, int]]:
    """Return the frames to use, their exposures, and their width and height."""
    from rsdeblur.io.pictures import is_picture
    from rsdeblur.io.source import Source

    if len(sources) > 1 or is_picture(Source(sources[0], "video or picture")):
        return _photos(sources, recording, index)
    from rsdeblur.video.clip import frames, open_clip
    from rsdeblur.video.pixels import values_of

    clip = open_clip(sources[0])
    exposures = clip_exposures(clip, recording)
    runs = _runs(len(clip), count)
    pictures = (values_of(frame) for run in runs for frame in frames(clip, run.start, run.stop))
    return pictures, [exposures[i] for run in runs for i in run], (clip.width, clip.height)


def _runs(length: int, count: int) -> list[range]:
    """Return runs of consecutive frames, `count` frames in all, spread over a clip of `length` frames."""
    if length <= count:
        return [range(length)]
    parts = count // RUN
    firsts = [round(i * (length - RUN) / max(parts - 1, 1)) for i in range(parts)]
    return [range(first, first + RUN) for first in firsts]


def _photos(
    photos: Sequence[Path], recording: Moments, index: int
) -> tuple[Iterator[NDArray[Any]], list[Exposure], tuple[int, int]]:
    from rsdeblur.errors import InputError
    from rsdeblur.io import read_captures, read_picture
    from rsdeblur.io.pictures import read_header

    if recording.capture is None:
        raise click.UsageError(
            "photos need --capture FILE, which lists their exposures", ctx=click.get_current_context()
        )
    exposures = read_captures(recording.capture, duration=recording.duration)[index:]
    if len(exposures) < len(photos):
        raise InputError(
            f"{recording.capture}: the file lists {len(exposures)} exposures from --index {index} on, but there are "
            f"{len(photos)} photos"
        )
    width, height, _ = read_header(photos[0])
    return (read_picture(photo).pixels for photo in photos), exposures[: len(photos)], (width, height)


def _start(path: Path | None, source: Path, size: tuple[int, int]) -> Camera:
    """Return the camera with the start values: those of a file, of EXIF, or a guess."""
    from rsdeblur.errors import RsdeblurError
    from rsdeblur.io import open_camera
    from rsdeblur.motion.camera import Camera

    if path is not None:
        return open_camera(path, size=size).warn(path)
    try:
        return open_camera(source, "exif", size=size).camera
    except RsdeblurError:
        return Camera(*size, GUESSED_FOCAL * max(size))


def _facts(result: Calibration, output: Path) -> dict[str, Any]:
    values = {
        name: {"value": each.value, "sd": each.sd, "unit": each.unit, "determined": each.determined}
        for name, each in result.values.items()
    }
    return {
        "accepted": result.accepted,
        "reason": result.reason,
        "written": str(output) if result.accepted else None,
        "mounting": result.mounting,
        "readout_direction": result.camera.readout_direction,
        "confidence": result.confidence,
        "explained": result.explained,
        "pairs": result.pairs,
        "matches": result.matches,
        "values": values,
    }


def _print(result: Calibration) -> None:
    from rsdeblur.estimate.calibrate import SIGNIFICANT

    rows = [["axes", result.mounting, f"confidence {result.confidence:.2f}", "determined"]]
    for name, each in result.values.items():
        factor, unit, digits = UNITS[each.unit]
        deviation = "" if each.sd is None else f"+-{factor * each.sd:.{digits}f} {unit}"
        rows.append(
            [name.replace("_", " "), f"{factor * each.value:.{digits}f} {unit}", deviation, STATES[each.determined]]
        )
        if name == "readout_time":
            # A global shutter has a readout time of 0, and no direction.
            known = each.sd is not None and each.value > SIGNIFICANT * each.sd
            rows.append(["readout direction", result.camera.readout_direction, "", STATES[known]])
    print_table(("", "value", "deviation", ""), rows)
    explained = f"the log explains {result.explained:.1%} of the motion"
    say(f"{result.pairs} pairs of frames, {result.matches} matches; {explained}")
