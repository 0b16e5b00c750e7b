"""`rsdeblur burst`: deblur several frames of one scene together."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeAlias

import click

from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import naming, photo_gravity, read_clip, read_inputs, transfer_of
from rsdeblur.cli._items import result_name
from rsdeblur.cli._options import CLIP, ONE_OF_MANY, SOLVE, Command, Recording, Target, option, refuse_given
from rsdeblur.cli._output import progress
from rsdeblur.cli._photo import stopwatch
from rsdeblur.cli._types import PATH, TextType
from rsdeblur.errors import InputError
from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur burst a.jpg b.jpg c.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --frames 2,3,4 -o out.jpg
  rsdeblur burst --from clip.mp4 --frames 10:18 --gyro gyro.csv --camera phone.toml --duration 1/30 -o sharp.png
"""


# Frames of a burst with their exposures, and their log and camera.
Shots: TypeAlias = "tuple[list[rs.Picture], list[rs.Exposure], rs.GyroLog, rs.Camera]"


def frame_numbers(text: str) -> list[int]:
    """Return the numbers of frames: `2,3,5`, or `2:6` for 2, 3, 4 and 5."""
    most = rs.MOST_FRAMES
    example = f"a list of numbers like 2,3,5, or a span of up to {most} frames, like 10:18"
    first, colon, stop = text.partition(":")
    try:
        found = list(range(int(first), int(stop))[: most + 1] if colon else map(int, text.split(",")))
    except ValueError:
        found = []
    if not 0 < len(found) <= most or min(found) < 0 or len(set(found)) < len(found):
        raise ValueError(f"{text!r} is not right; write {example}, each frame once")
    return found


def _result(photos: tuple[Path, ...], clip: Path | None, **_: Any) -> Path:
    source = result_name(photos[0]) if photos else (clip or Path("frames")).with_suffix(".png")
    return source.with_name(f"{source.stem}-burst{source.suffix}")


@click.command("burst", cls=Command, epilog=EXAMPLES)
@click.argument("photos", type=PATH, nargs=-1, metavar="[PHOTO]...")
@option("--from", "clip", type=PATH, metavar="VIDEO", help="Take the frames from a video.")
@option(
    "--frames",
    type=TextType("A:B|N,N,...", frame_numbers),
    required=True,
    help="Numbers of the frames, from 0: lines of --capture, or frames of the video; 10:18 is 10 to 17.",
)
@option(
    "--reference",
    type=click.IntRange(min=0),
    metavar="N",
    help="Number of the frame whose pose the result has, one of --frames.  [default: the best]",
)
@_options.recording_options(*CLIP)
# Colours of several frames have the full resolution.
@_options.solve_options(*(name for name in SOLVE if name != "chroma"))
@_options.target_options(
    "OUT",
    "Picture to write; by default PHOTO-burst or VIDEO-burst.png beside the first one.",
    default=_result,
)
def command(
    photos: tuple[Path, ...],
    clip: Path | None,
    frames: list[int],
    reference: int | None,
    recording: Recording,
    options: Options,
    target: Target,
) -> None:
    """Deblur several frames of one scene together. They are PHOTOs, or frames of a video.

    Each shaken frame has lost other details; together they have almost all. Frames that do not fit, or places where
    something moves, do not count. EXIF, colour profile and bit depth are those of the reference.
    """
    if (clip is None) == (not photos):
        raise click.UsageError("give either photos or --from VIDEO")
    if reference is not None and reference not in frames:
        raise click.UsageError(f"--reference {reference} is not one of --frames")
    rs.check_writable(target.output, force=target.force)
    shots = _from_clip(clip, frames, recording) if clip else _from_photos(photos, frames, recording)
    with naming(None, recording):
        facts = _deblurred(shots, frames, options, target, reference=reference)
    target.show(facts, *_lines(facts))


def _deblurred(
    shots: Shots, numbers: list[int], options: Options, target: Target, *, reference: int | None
) -> dict[str, Any]:
    """Deblur and write a burst, and return the facts to report."""
    pictures, exposures, log, camera = shots
    options = replace(options, transfer=transfer_of(pictures[0], options.transfer))
    with stopwatch() as elapsed, progress("burst") as move:
        result = rs.deblur_burst(
            [picture.pixels for picture in pictures],
            *(log, camera, exposures),
            reference="auto" if reference is None else numbers.index(reference),
            progress=move,
            **{each.name: getattr(options, each.name) for each in fields(options)} | {"mode": options.mode or "auto"},
        )
        seconds = elapsed()
    rs.write_picture(target.output, result.image, like=pictures[result.reference], force=target.force)
    used = [
        {"frame": number} | {each.name: getattr(use, each.name) for each in fields(use) if each.name != "weights"}
        for number, use in zip(numbers, result.frames, strict=True)
    ]
    facts = rs.result_facts(result.result, target.output, options.prior_name, seconds)
    return facts | {"reference": numbers[result.reference], "frames": used}


def _from_photos(photos: tuple[Path, ...], frames: list[int], recording: Recording) -> Shots:
    """Read photos, and their lines of the capture file."""
    if recording.capture is None:
        raise click.UsageError("the exposures are not given; use --capture FILE")
    refuse_given(ONE_OF_MANY, start=recording.start, start_ns=recording.start_ns)
    if len(frames) != len(photos):
        raise click.UsageError(f"--frames names {len(frames)} exposures for {len(photos)} photos")
    inputs = []
    for photo, number in zip(photos, frames, strict=True):
        each = replace(recording, index=number)
        inputs.append(read_inputs(photo, each))
        photo_gravity(photo, inputs[-1], each)
    pictures, exposures = [each.picture for each in inputs], [each.exposure for each in inputs]
    return pictures, exposures, inputs[0].log, inputs[0].camera


def _from_clip(clip: Path, frames: list[int], recording: Recording) -> Shots:
    """Decode frames of a video, and find their exposures."""
    opened, log, camera, exposures = read_clip(clip, recording)
    if max(frames) >= len(opened):
        raise InputError(f"{clip}: there is no frame {max(frames)}; the last one is {len(opened) - 1}")
    with naming(clip):
        pictures = [rs.Picture(rs.values_of(next(rs.frames(opened, n, n + 1)))) for n in frames]
    return pictures, [exposures[n] for n in frames], log, camera


def _lines(facts: dict[str, Any]) -> list[str]:
    used = sum(frame["share"] > 0 for frame in facts["frames"])
    frames = f"{used} of {len(facts['frames'])} frames, reference {facts['reference']}"
    return [
        f"{facts['output']}: {frames}, {rs.summary(facts)}",
        *rs.remarks(facts),
        *(
            f"  frame {frame['frame']}: share {frame['share']:.2f}, fits {100 * frame['support']:.0f} %, "
            f"blur {frame['blur']:.1f} px, shift {frame['shift']:.1f} px, brightness x {frame['gain']:.2f}"
            for frame in facts["frames"]
        ),
    ]
