"""`rsdeblur calibrate`: calibrate camera, clock and axes from a clip or from photos."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import click

from rsdeblur.choices import CAMERA
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import clip_exposures, indices_of, naming, read_captures, read_log, search_span
from rsdeblur.cli._options import FOR_PHOTOS, Command, Recording, Target, option, refuse_given
from rsdeblur.cli._output import check_output, print_table, progress, say
from rsdeblur.cli._types import PATH, SECONDS
from rsdeblur.errors import FileFormatError, InputError, RsdeblurError

EXAMPLES = """\b
Examples:
  rsdeblur calibrate clip.mp4 --gyro gyro_accel.csv --capture movie_metadata.csv -o phone.toml
  rsdeblur calibrate clip.mov --gyro clip.gcsv --camera start.toml --duration 1/500 --from -3s --to 3s -o camera.toml
  rsdeblur calibrate burst/*.jpg --gyro imu.txt --capture images.txt -o tablet.toml
"""

# Frames of a longer clip that are used, and the consecutive ones among them, which are spread over the clip.
USED, RUN = 128, 16
# Factors, units and decimals of the table.
UNITS = {"s": (1e3, "ms", 3), "px": (1, "px", 1), "rad/s": (1, "rad/s", 4), "s/s": (1e6, "us/s", 1)}
UNITS["rad"] = math.degrees(1), "deg", 2
STATES = ("assumed", "determined")
# Options that say where the files are, and when the pictures were taken.
GIVEN = tuple(name for name in _options.SERIES if name not in ("time_offset", "readout_time", "focal_length"))


@click.command("calibrate", cls=Command, epilog=EXAMPLES)
@click.argument("sources", type=PATH, metavar="CLIP|PHOTO...", nargs=-1, required=True)
@_options.recording_options(*GIVEN, required=("gyro",))
@option(*("--from", "first"), type=SECONDS, help="First time offset.  [default: -1s; -30ms where the blur counts]")
@option(*("--to", "last"), type=SECONDS, help="Last time offset.  [default: 1s; 30ms where the blur counts]")
@_options.target_options(
    "TOML",
    f"Camera file to write; by default {CAMERA} beside the first of them.",
    default=lambda sources, **_: sources[0].with_name(CAMERA),
)
def command(
    sources: tuple[Path, ...], recording: Recording, first: float | None, last: float | None, target: Target
) -> None:
    """Calibrate a camera from a CLIP or PHOTOs, and their gyro log.

    The motion between frames against the log gives the clock offset, the mounting of the gyro (all 24, and left-handed
    logs by name), the readout time and its direction, the focal length, and the gyro's bias. The clip may be blurred.
    Turn the camera unevenly about all of its axes, some seconds long, before a distant scene with texture; switch off
    stabilisation. --from and --to are relative to the time offset in the camera file.

    --camera gives start values. Photos of a burst are frames; --index is the number of the first one in --capture, and
    the others follow. Of other photos, at least three, the blur gives the same numbers but the bias, less
    precisely.

    A value that the pictures do not determine is assumed: it keeps its start value. Exit code 1 means that the fit is
    not trustworthy; then no file is written.
    """
    check_output(target.output, force=target.force, suffixes=(".toml",), kind="a camera file is TOML")
    name = sources[0]
    with progress("calibrate") as move, naming(name, recording):
        log = read_log(recording).log
        pictures, exposures, size = _film(sources, recording)
        method: Any = rs.calibrate if _is_clip(exposures) else rs.calibrate_photos
        search, start = search_span(method, first, last), _start(recording.camera, sources[0], size)
        result = method(pictures, exposures, log, start, search=search, progress=move)
    if result.accepted:
        result.camera.save(target.output)
    if result.values and not target.as_json:
        _print(result)
    lines = [f"{target.output}: written"] if result.accepted else []
    written = str(target.output) if result.accepted else None
    target.show(rs.calibration_facts(result) | {"written": written}, *lines)
    if not result.accepted:
        raise InputError(f"{name}: no camera file is written: {result.reason}")


def _is_clip(exposures: list[rs.Exposure]) -> bool:
    """Return whether enough neighbouring pictures are so near in time that they show the same things."""
    # Timestamps of 64 bits are exact as integers only.
    times = [1e-9 * (each.epoch_ns - exposures[0].epoch_ns) + each.start for each in exposures]
    near = sum(0 < after - before <= rs.LONGEST_STEP for before, after in pairwise(times))
    return near >= rs.LEAST_PAIRS


def _film(
    sources: Sequence[Path], recording: Recording
) -> tuple[Iterator[rs.NDArray[Any]], list[rs.Exposure], tuple[int, int]]:
    """Return the pictures to use, their exposures, and their width and height."""
    others = [source for source in sources if not rs.is_picture(rs.Source(source, "video or picture"))]
    if others and len(sources) > 1:
        raise FileFormatError(f"{others[0]}: not a picture; give photos, or one clip alone")
    if not others:
        return _photos(sources, recording)
    refuse_given(FOR_PHOTOS, index=recording.index)
    clip = rs.open_clip(sources[0])
    if len(clip) <= rs.LEAST_PAIRS:
        raise InputError(f"the clip has {len(clip)} frames; at least {rs.LEAST_PAIRS + 1} are needed, of some seconds")
    every, runs = clip_exposures(clip, recording), _runs(len(clip))
    pictures = (rs.values_of(frame) for run in runs for frame in rs.frames(clip, run.start, run.stop))
    return pictures, [every[i] for run in runs for i in run], (clip.width, clip.height)


def _runs(length: int) -> list[range]:
    """Return runs of consecutive frames, spread over a clip of `length` frames."""
    if length <= USED:
        return [range(length)]
    parts = USED // RUN
    firsts = [round(i * (length - RUN) / (parts - 1)) for i in range(parts)]
    return [range(first, first + RUN) for first in firsts]


def _photos(
    photos: Sequence[Path], recording: Recording
) -> tuple[Iterator[rs.NDArray[Any]], list[rs.Exposure], tuple[int, int]]:
    if recording.capture is None:
        raise click.UsageError("photos need --capture FILE, which lists their exposures")
    exposures = read_captures(recording, recording.duration)
    index = recording.index
    if index is None and len(exposures) != len(photos):
        try:
            exposures = [exposures[i] for i in indices_of(photos, recording)]
        except FileFormatError as error:
            raise FileFormatError(f"{error}; or give --index, the number of the first photo") from error
    exposures = exposures[index or 0 :]
    if len(exposures) < len(photos):
        raise InputError(
            f"{recording.capture}: the file lists {len(exposures)} exposures from --index {index or 0} on, but there "
            f"are {len(photos)} photos"
        )
    width, height, _ = rs.read_header(photos[0])
    return (rs.read_picture(photo).pixels for photo in photos), exposures[: len(photos)], (width, height)


def _start(path: Path | None, source: Path, size: tuple[int, int]) -> rs.Camera:
    """Return the camera with the start values: those of a file, of EXIF, or a guess."""
    if path is not None:
        return rs.open_camera(path, size=size).warn(path)
    try:
        return rs.open_camera(source, "exif", size=size).camera
    except RsdeblurError:
        # 27 mm equivalent, with a little cut off for a video.
        return rs.Camera(*size, 0.8 * max(size))


def _print(result: rs.Calibration) -> None:
    rows = [["axes", result.mounting, f"confidence {result.confidence:.2f}", "determined"]]
    for name, each in result.values.items():
        factor, unit, digits = UNITS[each.unit]
        deviation = "" if each.sd is None else f"+-{factor * each.sd:.{digits}f} {unit}"
        rows.append(
            [name.replace("_", " "), f"{factor * each.value:.{digits}f} {unit}", deviation, STATES[each.determined]]
        )
        if name == "readout_time":
            rows.append(["readout direction", result.camera.readout_direction, "", STATES[result.directed]])
    print_table(("", "value", "deviation", ""), rows)
    if result.photos:
        say(f"{result.photos} photos")
    else:
        explained = f"the log explains {result.explained:.1%} of the motion"
        say(f"{result.pairs} pairs of frames, {result.matches} matches; {explained}")
