"""`rsdeblur video`: deblur the blurred frames of a video."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.files import check_target
from rsdeblur.choices import CRF, KEEP, SHARP
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import naming, read_clip
from rsdeblur.cli._options import CLIP, OUTPUT, SOLVE, Command, Recording, Target, option
from rsdeblur.cli._output import progress, warn
from rsdeblur.cli._types import NOT_NEGATIVE, PATH
from rsdeblur.pipeline.options import Options
from rsdeblur.video import QUALITY

# Options that would make a video flicker, or are for single pictures.
FOR_PICTURES = ("max_memory", "fallback", "normalize", "saturation")

EXAMPLES = """\b
Examples:
  rsdeblur video movie.mp4 --gyro gyro_accel.csv --camera phone.toml --capture movie_metadata.csv -o sharp.mp4
  rsdeblur video clip.mov --gyro clip.gcsv --camera cam.toml --duration 1/50 --quality balanced -o sharp.mov
  rsdeblur video hero.mp4 --camera gopro.toml --duration 1/60 --start 12ms --dry-run
"""


@click.command("video", cls=Command, epilog=EXAMPLES, context_settings={"default_map": {"quality": QUALITY}})
@click.argument("source", type=PATH, metavar="VIDEO")
@_options.recording_options(*CLIP, required=("camera",))
@_options.solve_options(*(name for name in SOLVE if name not in FOR_PICTURES))
@option("--codec", section=OUTPUT, metavar="NAME", help="Encoder of FFmpeg, like libx265.  [default: as VIDEO]")
@option(
    "--crf",
    section=OUTPUT,
    type=click.IntRange(0, 63),
    default=CRF,
    show_default=True,
    help="Quality of the encoding: a lower value is better, and makes a larger file.",
)
@option(
    "--above",
    type=NOT_NEGATIVE,
    default=KEEP,
    show_default=True,
    metavar="PX",
    help="Deblur only frames in which a point draws a longer path than this; 0 deblurs all.",
)
@_options.jobs_option("frames at a time", "the number of cores")
@_options.target_options(
    "OUT",
    "Video to write: .mp4, .mov, .mkv or .webm; by default VIDEO-sharp beside it.",
    default=lambda source, **_: source.with_name(f"{source.stem}{SHARP}{source.suffix}"),
    dry_run=True,
)
def command(
    source: Path,
    recording: Recording,
    options: Options,
    codec: str | None,
    crf: int,
    above: float,
    jobs: int | None,
    target: Target,
) -> None:
    """Deblur the blurred frames of VIDEO. Each has its own exposure window.

    Frames whose blur is at most --above stay as they are; up to twice that, frames are mixed with their deblurred
    version. Sound, motion data, timing, rotation and colour tags are kept. The times of the exposures come from
    --capture, or from the timestamps in the video, counted from --start. Frames that the log does not cover are kept as
    they are. Without --gyro, the log is that in VIDEO itself.
    """
    begin = time.perf_counter()
    recording, output = replace(recording, gyro=recording.gyro or source), target.output
    check_target(output, force=target.force)
    rs.container_of(output)
    rs.keep()
    with progress("video") as move, naming(source, recording):
        clip, log, camera, exposures = read_clip(source, recording)
        encoding = rs.Encoding.like(clip, codec=codec, crf=crf)
        rs.check_output(clip, encoding, output, force=target.force)
        jobs, threads = _options.shared_threads(jobs, options.threads, least=1)
        plan = rs.plan_clip(clip, log, camera, exposures, options, above=above, progress=move)
        plan = replace(plan, options=replace(plan.options, threads=threads))
        facts = {"output": str(output), **rs.clip_facts(plan), "codec": encoding.codec, "pixels": encoding.pixels}
        reasons = [f"frame {i}: {reason}" for i, reason in enumerate(plan.reasons) if reason is not None]
        if reasons:
            warn(f"{source}: {len(reasons)} of {len(clip)} frames are kept as they are; {reasons[0]}")
        if not target.dry_run:
            dropped = rs.deblur_video(plan, output, encoding=encoding, jobs=jobs, force=target.force, progress=move)
            facts |= {"dropped": dropped, "seconds": time.perf_counter() - begin}
    target.show(facts | {"dry_run": target.dry_run}, *_lines(source, output, facts))


def _lines(source: Path, output: Path, facts: dict[str, Any]) -> list[str]:
    wide, tall = facts["psf_px"]
    tiles = f"up to {facts['bands']} x {facts['strips']} PSFs of up to {wide} x {tall} px"
    how = f"{facts['mode']}, {tiles}, {facts['prior']}, {facts['codec']}"
    frames = f"{facts['treated']} of {facts['frames']} frames deblurred"
    frames += f", the largest blur {facts['largest_blur_px']:.1f} px"
    verdict = "" if facts["check"] is None else f"; {facts['check']['verdict']}"
    if "seconds" not in facts:
        fit = f"{facts['frames']} frames, {facts['span_s']:.2f} s, all inputs fit"
        lines = [f"{source}: {fit}; would write {output}", f"  {frames}{verdict}", f"  {how}"]
    else:
        dropped = f"; left out: {', '.join(facts['dropped'])}" if facts["dropped"] else ""
        lines = [f"{output}: {frames}, {how}, {facts['seconds']:.1f} s{dropped}{verdict}"]
    return lines + rs.remarks(facts)
