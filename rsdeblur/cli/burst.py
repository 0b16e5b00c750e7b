"""`rsdeblur burst`: deblur several frames of one scene together."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rsdeblur import choices
from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import (
    Inputs,
    clip_exposures,
    display_values,
    naming,
    read_device,
    read_inputs,
    transfer_of,
    warn_of_clip_gravity,
    warn_of_photo_gravity,
)
from rsdeblur.cli._items import ONE_OF_MANY, numbered_from_option, one_name, read_items, refuse_given
from rsdeblur.cli._options import Defaults, Recording, Target
from rsdeblur.cli._output import (
    FAILURES,
    SOME_FAILED,
    check_page,
    prepare_folder,
    print_json,
    progress,
    reason,
    refuse_inputs,
    say,
    say_aside,
)
from rsdeblur.cli._photo import facts_of
from rsdeblur.cli._refinement import correction_text, refinement_facts
from rsdeblur.cli._report import Compared, capture_warnings, report_page
from rsdeblur.cli._types import PATH
from rsdeblur.cli._usage import refuse_unused
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from rsdeblur.burst.burst import BurstResult
    from rsdeblur.choices import Auto, Mode
    from rsdeblur.io.pictures import Picture
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.motion.gyro import GyroLog
    from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur burst a.jpg b.jpg c.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --frames 2,3,4 -o out.jpg
  rsdeblur burst --from clip.mp4 --frames 10:18 --gyro gyro.csv --camera phone.toml --duration 1/30 -o sharp.png
  rsdeblur burst burst1/ burst2/ --camera phone.toml -o sharp/
"""


# `--mode` has a value more than that of other commands. Colours of several frames have the full resolution.
SOLVE = tuple(name for name in (*_options.ONE_PHOTO, "refine", *_options.ONE_RESULT) if name not in ("mode", "chroma"))
# Longest span of frames that is taken for no mistake; the burst itself has a lower limit.
MOST_FRAMES = 1000


class FramesType(click.ParamType[list[int]]):
    """Numbers of frames: `2,3,5`, or `2:6` for 2, 3, 4 and 5."""

    name = "frames"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> list[int]:
        """Return the numbers."""
        if isinstance(value, list):
            return value
        if span := re.fullmatch(r"(\d{1,9}):(\d{1,9})", value):
            first, stop = map(int, span.groups())
            if first < stop <= first + MOST_FRAMES:
                return list(range(first, stop))
        elif re.fullmatch(r"\d{1,9}(,\d{1,9})*", value):
            return [int(number) for number in value.split(",")]
        self.fail(f"{value!r} is neither a list of numbers like 2,3,5 nor a span of up to {MOST_FRAMES}, like 10:18")


@click.command("burst", cls=Command, epilog=EXAMPLES)
@click.argument("photos", type=PATH, nargs=-1, metavar="[PHOTO|FOLDER]...")
@click.option("--from", "clip", type=PATH, metavar="VIDEO", help="Take the frames from a video.")
@click.option(
    "--frames",
    type=FramesType(),
    metavar="A:B|N,N,...",
    help="Numbers of the frames, from 0: lines of --capture, or frames of the video; 10:18 is 10 to 17.",
)
@click.option(
    "--reference",
    type=click.IntRange(min=0),
    metavar="N",
    help="Number of the frame whose pose the result has, one of --frames.  [default: the best]",
)
@click.option("--weights", type=PATH, metavar="PNG", help="Write the weights of the frames, side by side.")
@click.option("--report", type=PATH, metavar="HTML", help="Also write a page that shows result and weights.")
@_options.clip_options(required=False)
@numbered_from_option
@click.option(
    "--mode",
    type=click.Choice(("auto", *choices.MODES)),
    default="auto",
    show_default=True,
    help="One PSF for the picture, one per tile, or one per row; auto takes rows where tiles cannot follow the blur.",
)
@_options.solve_options(*SOLVE)
@_options.target_options("OUT|DIR", "Picture to write, or folder for the pictures of FOLDERs.")
def command(
    photos: tuple[Path, ...],
    clip: Path | None,
    frames: list[int] | None,
    reference: int | None,
    weights: Path | None,
    report: Path | None,
    numbered_from: int | None,
    mode: Mode | Auto,
    recording: Recording,
    options: Options,
    target: Target,
) -> None:
    """Deblur several frames of one scene together. They are PHOTOs, or frames of a video.

    Each shaken frame has lost other details; together they have almost all. Frames that do not fit, or places where
    something moves, do not count. EXIF, colour profile and bit depth are those of the reference.

    Each FOLDER is one burst: a session of MARS logger, OpenCamera Sensors or DeepGyro with its photos. A burst that
    fails does not stop the others; the exit code is then 3.
    """
    from rsdeblur.io.picture_output import check_writable

    if (clip is None) == (not photos):
        raise click.UsageError("give either photos or --from VIDEO")
    refuse_unused(options, choices.MODES if mode == "auto" else [mode])
    if any(photo.is_dir() for photo in photos):
        if not frames and reference is None and weights is None and report is None:
            return _folders(photos, numbered_from, recording, mode, options, target)
        raise click.UsageError("folders have no --frames, --reference, --weights or --report")
    if numbered_from is not None:
        raise click.UsageError("--numbered-from is for folders; --frames says which frames the photos are")
    for name in ("gyro", "camera"):
        if getattr(recording, name) is None:
            raise click.UsageError(f"Missing option '--{name}'.")
    if frames is None:
        where = "frames of the video" if clip else "lines of --capture that belong to the photos"
        raise click.UsageError(f"Missing option '--frames': the {where}, counted from 0, like 2,3,5 or 2:6")
    if reference is not None and reference not in frames:
        raise click.UsageError(f"--reference {reference} is not one of --frames")
    if target.output == weights:
        raise click.UsageError(f"-o and --weights are both {weights}; give each its own name")
    for path in filter(None, (target.output, weights)):
        refuse_inputs(path)
        check_writable(path, force=target.force)
    if report is not None:
        check_page(report, force=target.force)
    shots = _from_clip(clip, frames, recording) if clip else _from_photos(photos, frames, recording)
    with naming(None, recording), capture_warnings() as remarks:
        facts, result = _deblurred(shots, mode, options, target, reference=reference)
    if weights is not None:
        _write_weights(weights, result, force=target.force)
    if report is not None:
        from rsdeblur.report import write_page

        compared = _compared(clip or photos[result.reference], shots, facts, result, options)
        write_page(report, report_page(compared, recording, options, remarks))
    if target.as_json:
        print_json(facts)
    else:
        _print(facts)


class Shots(NamedTuple):
    """Frames of a burst with their numbers and exposures, and their log and camera."""

    pictures: list[Picture]
    numbers: list[int]
    exposures: list[Exposure]
    log: GyroLog
    camera: Camera


def _checked(shots: Shots, names: Sequence[Path | str]) -> Shots:
    """Return the frames of a burst; raise an error that names a frame which the camera or the others do not fit."""
    from rsdeblur.image.encoded import check_size

    shapes = [picture.pixels.shape for picture in shots.pictures]
    for name, shape in zip(names, shapes, strict=True):
        with naming(name):
            check_size(shape, shots.camera)
        if shape != shapes[0]:
            raise InputError(
                f"{name}: the picture has shape {shape}, but {names[0]} has {shapes[0]}; the frames of a burst must "
                "have the same channels"
            )
    return shots


def _deblurred(
    shots: Shots, mode: Mode | Auto, options: Options, target: Target, *, reference: int | None = None
) -> tuple[dict[str, Any], BurstResult]:
    """Deblur and write a burst, and return the facts to report and the result."""
    from rsdeblur.burst.burst import deblur_burst
    from rsdeblur.io.picture_output import write_picture

    pictures, numbers, exposures, log, camera = shots
    options = replace(options, transfer=transfer_of(pictures[0], options.transfer))
    begin = time.perf_counter()
    with progress("burst") as move:
        result = deblur_burst(
            [picture.pixels for picture in pictures],
            *(log, camera, exposures),
            reference="auto" if reference is None else numbers.index(reference),
            mode=mode,
            progress=move,
            **{member.name: getattr(options, member.name) for member in fields(options) if member.name != "mode"},
        )
    write_picture(target.output, result.image, like=pictures[result.reference], force=target.force)
    return _facts(result, numbers, target.output, options, time.perf_counter() - begin), result


def _write_weights(path: Path, result: BurstResult, *, force: bool) -> None:
    """Write the weights of all frames side by side."""
    import numpy as np

    from rsdeblur.io.picture_output import write_picture

    write_picture(path, np.hstack([frame.weights for frame in result.frames]), force=force)


def _compared(photo: Path, shots: Shots, facts: dict[str, Any], result: BurstResult, options: Options) -> Compared:
    """Return the content of the page: the result beside the reference, and the weights of all frames."""
    from rsdeblur.cli._measure import peak_memory_mib

    index, label = result.reference, f"burst, {result.mode}"
    picture = shots.pictures[index]
    transfer = transfer_of(picture, options.transfer)
    return Compared(
        {"photo": str(photo), "modes": {label: facts | {"peak_memory_mib": peak_memory_mib()}}},
        Inputs(picture, shots.log, shots.camera, shots.exposures[index]),
        {
            f"frame {facts['reference']}": display_values(picture.pixels, transfer),
            label: display_values(result.image, transfer),
        },
        {label: result.result.psfs},
        1.0 - float(result.result.coverage.mean()),
        transfer,
        frames=[used | {"weights": frame.weights} for used, frame in zip(facts["frames"], result.frames, strict=True)],
    )


def _folders(
    folders: tuple[Path, ...],
    numbered_from: int | None,
    recording: Recording,
    mode: Mode | Auto,
    options: Options,
    target: Target,
) -> None:
    """Deblur the burst of each folder into the folder of results."""
    if others := [folder for folder in folders if not folder.is_dir()]:
        raise click.UsageError(f"{others[0]} is not a folder; give either photos or folders")
    refuse_given(ONE_OF_MANY, start=recording.start, start_ns=recording.start_ns)
    if target.output.suffix and not target.output.is_dir():
        raise click.UsageError(f"-o {target.output}: the results of folders need a folder, whose name has no extension")
    outputs = [target.output / f"{folder.resolve().name}.png" for folder in folders]
    if len(set(map(one_name, outputs))) < len(outputs):
        raise click.UsageError(
            "two folders have the same name, or names that differ only in case, and so would their results"
        )
    prepare_folder(target.output, [output.name for output in outputs], force=target.force)
    entries: list[dict[str, Any]] = []
    for folder, output in zip(folders, outputs, strict=True):
        try:
            with naming(folder):
                shots = _from_folder(folder, numbered_from, recording, target.output)
                entries.append(_deblurred(shots, mode, options, replace(target, output=output))[0])
        except FAILURES as error:
            message = reason(error)
            named = message if str(folder) in message else f"{folder}: {message}"
            entries.append({"output": str(output), "error": named})
        if not target.as_json:
            if "error" in entries[-1]:
                say_aside(f"error: {entries[-1]['error']}")
            else:
                _print(entries[-1])
    if target.as_json:
        print_json({"bursts": entries})
    if any("error" in entry for entry in entries):
        click.get_current_context().exit(SOME_FAILED)


def _from_folder(folder: Path, numbered_from: int | None, recording: Recording, output: Path) -> Shots:
    """Read the photos of a session and their exposures."""
    given = {member.name: getattr(recording, member.name) for member in fields(Defaults)}
    items = read_items(folder, Defaults(**given), output, numbered_from=numbered_from)
    inputs = []
    for item in items:
        if item.recording is None:
            raise InputError(item.error or str(item.photo))
        inputs.append(read_inputs(item.photo, item.recording))
    pictures, exposures = [each.picture for each in inputs], [each.exposure for each in inputs]
    shots = Shots(pictures, list(range(len(items))), exposures, inputs[0].log, inputs[0].camera)
    return _checked(shots, [item.photo for item in items])


def _from_photos(photos: tuple[Path, ...], frames: list[int], recording: Recording) -> Shots:
    """Read photos, and their lines of the capture file."""
    from rsdeblur.io import read_captures
    from rsdeblur.io.pictures import read_picture

    if recording.capture is None:
        raise click.UsageError("the exposures are not given; use --capture FILE")
    refuse_given(ONE_OF_MANY, start=recording.start, start_ns=recording.start_ns)
    if len(frames) != len(photos):
        raise click.UsageError(f"--frames names {len(frames)} exposures for {len(photos)} photos")
    captures = read_captures(recording.capture, duration=recording.duration)
    _check_range(frames, len(captures), f"{recording.capture}: there is no exposure")
    # The small files come first, so that a wrong one shows before large pictures are read.
    device = read_device(recording)
    shots = Shots([read_picture(photo) for photo in photos], frames, [captures[n] for n in frames], *device)
    for photo, picture, exposure in zip(photos, shots.pictures, shots.exposures, strict=True):
        warn_of_photo_gravity(photo, Inputs(picture, *device, exposure), recording)
    return _checked(shots, photos)


def _from_clip(clip: Path, frames: list[int], recording: Recording) -> Shots:
    """Decode frames of a video, and find their exposures."""
    from rsdeblur.io.pictures import Picture
    from rsdeblur.video.clip import frames as decoded
    from rsdeblur.video.clip import open_clip
    from rsdeblur.video.pixels import values_of

    opened = open_clip(clip)
    _check_range(frames, len(opened), f"{clip}: there is no frame")
    exposures = clip_exposures(opened, recording)
    device = read_device(recording)
    warn_of_clip_gravity(opened, recording, device[1], [exposures[n] for n in frames])
    with naming(clip):
        pictures = [Picture(values_of(next(decoded(opened, n, n + 1)))) for n in frames]
    shots = Shots(pictures, frames, [exposures[n] for n in frames], *device)
    return _checked(shots, [f"{clip}, frame {n}" for n in frames])


def _check_range(frames: list[int], count: int, problem: str) -> None:
    if max(frames) >= count:
        raise InputError(f"{problem} {max(frames)}; the last one is {count - 1}")
    if len(set(frames)) < len(frames):
        raise click.UsageError("--frames names a frame twice")


def _facts(result: BurstResult, frames: list[int], output: Path, options: Options, seconds: float) -> dict[str, Any]:
    used = [
        {"frame": number} | {m.name: getattr(use, m.name) for m in fields(use) if m.name != "weights"}
        for number, use in zip(frames, result.frames, strict=True)
    ]
    facts = facts_of(result.result, output, result.mode, options.prior_name, seconds)
    if result.refinement is not None:
        facts["refinement"] = refinement_facts(result.refinement)
    return facts | {"reference": frames[result.reference], "frames": used}


def _print(facts: dict[str, Any]) -> None:
    wide, tall = facts["psf_px"]
    used = [frame for frame in facts["frames"] if frame["share"] > 0]
    strength = f"NSR {facts['nsr']:.2g}" if facts["weight"] is None else f"weight {facts['weight']:.2g}"
    tiles = f"{facts['bands']} x {facts['strips']} PSFs of up to {wide} x {tall} px"
    verdict = "" if facts["check"] is None else f"; {facts['check']['verdict']}"
    reasons = facts["check"]["reasons"] if facts["check"] else ()
    say(
        f"{facts['output']}: {len(used)} of {len(facts['frames'])} frames, reference {facts['reference']}, "
        f"{facts['mode']}, {tiles}, {facts['prior']}, {strength}, {facts['seconds']:.1f} s{verdict}",
        *([f"  {' '.join(reasons)}"] if reasons else []),
        *(["  " + correction_text(facts["refinement"])] if facts["refinement"] else []),
    )
    for frame in facts["frames"]:
        say(
            f"  frame {frame['frame']}: share {frame['share']:.2f}, fits {100 * frame['support']:.0f} %, "
            f"blur {frame['blur']:.1f} px, shift {frame['shift']:.1f} px, brightness x {frame['gain']:.2f}"
        )
