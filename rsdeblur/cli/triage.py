"""`rsdeblur triage`: which pictures are blurred, by the gyro log alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

import click

from rsdeblur._util.files import atomic_write
from rsdeblur.choices import DROP, KEEP
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import clip_exposures, read_device, read_recording
from rsdeblur.cli._items import read_items
from rsdeblur.cli._options import FOLDER, FOR_PHOTOS, Command, Recording, Target, option, refuse_given, require
from rsdeblur.cli._output import prepare_folder, print_json, progress, reason, say, usage_as_input_error, write_json
from rsdeblur.cli._types import NOT_NEGATIVE, PATH
from rsdeblur.errors import InputError, RsdeblurError

REPORT, PLOT = "triage.json", "triage.svg"
MANIFESTS = (".csv", ".txt")

EXAMPLES = """\b
Examples:
  rsdeblur triage mars_session/ --camera phone.toml -o triage
  rsdeblur triage frames/ --gyro gyro.csv --capture frames.csv --camera phone.toml --json
  rsdeblur triage clip.mp4 --gyro clip.mp4 --camera gopro.toml --duration 1/60 --keep 2 --drop 50 -o triage
"""


# A photo or a frame: its name, its exposure or None, its blur in px, and the reason why that is unknown.
Shot: TypeAlias = "tuple[dict[str, Any], rs.Exposure | None, float, str | None]"


@click.command("triage", cls=Command, epilog=EXAMPLES)
@click.argument("source", type=PATH, metavar="FOLDER|CLIP")
@_options.recording_options(*FOLDER, required=())
@option(
    "--keep",
    type=NOT_NEGATIVE,
    default=KEEP,
    show_default=True,
    metavar="PX",
    help="Longest path of a picture that is sharp enough as it is.",
)
@option(
    "--drop",
    type=NOT_NEGATIVE,
    default=DROP,
    show_default=True,
    metavar="PX",
    help="Longest path of a picture that is worth deblurring.",
)
@_options.target_options("DIR", f"Folder for {REPORT} and {PLOT}; without it, print the counts only.")
def command(source: Path, recording: Recording, keep: float, drop: float, target: Target) -> None:
    """Measure the blur of photos or frames by the gyro log alone.

    No pixels are read. Each picture gets the length of the longest path that a point draws during the exposure, in px,
    and a decision: keep, deblur or drop; unknown where the log does not cover the exposure. FOLDER is a session of a
    logger, a folder of photos with --gyro and --capture, or a manifest like that of `batch`; CLIP is a video. Blur by
    focus and by moving subjects is not in a gyro log.
    """
    output: Path | None = target.output
    if output is not None:
        prepare_folder(output, [REPORT, PLOT], force=target.force)
    if drop < keep:
        raise click.UsageError("--drop must be at least --keep")
    rs.check_thresholds(keep, drop)
    is_clip = source.is_file() and source.suffix.lower() not in MANIFESTS
    if is_clip:
        moment = recording.start if recording.start == "exif" else None
        refuse_given(FOR_PHOTOS, numbered_from=recording.numbered_from, start=moment)
        shots = _frames(source, recording)
    else:
        shots = _photos(source, recording, output)
    if not shots:
        raise InputError(f"{source}: there is nothing to measure, because no photo is listed")
    import numpy as np

    names, exposures, blurs, reasons = zip(*shots, strict=True)
    judged = rs.Triage(np.array(blurs), reasons, keep, drop)
    entries = _entries(names, exposures, judged)
    report = {"keep_px": keep, "drop_px": drop, "counts": judged.counts, "items": entries}
    if output is not None:
        write_json(output / REPORT, report)
        with atomic_write(output / PLOT) as file:
            file.write(rs.timeline_svg([entry["time_s"] for entry in entries], judged))
    if target.as_json:
        print_json(report)
    else:
        _print(source, judged, output)
    if judged.counts["unknown"] == len(judged):
        kind = "frames" if is_clip else "photos"
        raise InputError(f"{source}: the blur of all {len(judged)} {kind} is unknown, the first: {judged.reasons[0]}")


def _frames(source: Path, recording: Recording) -> list[Shot]:
    """Measure the frames of a video; only their timestamps are read."""
    require(recording, "gyro", "camera")
    device = read_device(recording)
    exposures = clip_exposures(rs.open_clip(source), recording)
    return [({"frame": i}, each, *rs.blur_of(*device, each)) for i, each in enumerate(_shown(exposures))]


def _photos(source: Path, recording: Recording, output: Path | None) -> list[Shot]:
    """Measure the photos of a folder or of a manifest."""
    shots: list[Shot] = []
    for item in _shown(read_items([source], recording, output or source / "triage")):
        exposure, blur, failure = None, math.nan, item.error
        if item.recording is not None:
            try:
                with usage_as_input_error():
                    log, camera, exposure = read_recording(item.recording, item.photo)
                blur, failure = rs.blur_of(log, camera, exposure)
            except (RsdeblurError, OSError) as error:
                failure = reason(error)
        shots.append(({"photo": str(item.photo)}, exposure, blur, failure))
    return shots


def _shown(items: Sequence[Any]) -> Iterator[Any]:
    """Yield items, and show the progress."""
    with progress("triage") as move:
        for i, item in enumerate(items):
            move(f"{i + 1} of {len(items)}", i / len(items))
            yield item


def _entries(
    names: Sequence[dict[str, Any]], exposures: Sequence[rs.Exposure | None], judged: rs.Triage
) -> list[dict[str, Any]]:
    """Return what is known about each picture; times are those after the first start of an exposure."""
    # Timestamps of 64 bits are exact as integers only.
    starts = [None if each is None else each.epoch_ns + round(1e9 * each.start) for each in exposures]
    first = min((start for start in starts if start is not None), default=0)
    columns = zip(names, starts, judged.lengths.tolist(), judged.decisions, judged.reasons, strict=True)
    return [
        name
        | {"time_s": None if start is None else 1e-9 * (start - first)}
        | {"blur_px": None if math.isnan(length) else length, "decision": decision, "reason": reason}
        for name, start, length, decision, reason in columns
    ]


def _print(source: Path, judged: rs.Triage, output: Path | None) -> None:
    counts = ", ".join(f"{count} {decision}" for decision, count in judged.counts.items() if count)
    known = [length for length in judged.lengths.tolist() if not math.isnan(length)]
    say(f"{source}: {counts}" + (f"; median {median(known):.1f} px, largest {max(known):.1f} px" if known else ""))
    reasons = [reason for reason in judged.reasons if reason is not None]
    # The reason of an error is printed at the end.
    if reasons and known:
        say(f"  {len(reasons)} unknown, the first: {reasons[0]}")
    if output is not None:
        say(f"  see {output / REPORT} and {output / PLOT}")
