"""Deblurring of a planned video: segments in worker processes, then joining."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rsdeblur._util import workers
from rsdeblur._util.atomic import check_target, remove_unfinished
from rsdeblur._util.records import Records, fingerprint
from rsdeblur.errors import OutputError, RsdeblurError
from rsdeblur.types import Progress
from rsdeblur.video.joining import container_of, join
from rsdeblur.video.plan import ClipPlan
from rsdeblur.video.segments import Encoding, Segment, encode_segment

SEGMENT = 32


@dataclass(frozen=True, slots=True)
class VideoResult:
    """Summary of a deblurred video.

    Parameters
    ----------
    frames, kept : int
        Number of frames, and how many of them were left as they are.
    segments, resumed : int
        Number of segments, and how many of them an earlier run had finished.
    dropped : list of str
        Types of the streams that were left out.
    """

    frames: int
    kept: int
    segments: int
    resumed: int
    dropped: list[str]


def parts_folder(output: Path) -> Path:
    """Return the folder that contains the finished segments until the video is complete.

    Parameters
    ----------
    output : Path
        The video to be written.
    """
    return output.with_name(f"{output.name}.parts")


def check_output(output: Path, *, force: bool) -> None:
    """Check that a video can be written, before the work.

    Parameters
    ----------
    output : Path
        The video to be written.
    force : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If the extension is unknown, the folder is missing or not writable, or the file exists and `force` is not set.
    """
    container_of(output)
    check_target(output, force=force)


def deblur_video(
    plan: ClipPlan,
    output: Path,
    *,
    encoding: Encoding,
    segment: int = SEGMENT,
    jobs: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> VideoResult:
    """Deblur a video as planned; sound, stamps, rotation and colour tags are kept.

    Finished segments are kept in a folder beside `output` until it is complete. After an interrupt, the next call with
    the same arguments continues with them.

    Parameters
    ----------
    plan : ClipPlan
        See :func:`rsdeblur.video.plan.plan_clip`; frames with a reason are left as they are.
    output : Path
        Video to write; its extension chooses the container.
    encoding : Encoding
        See :meth:`Encoding.like`.
    segment : int
        Number of frames in a segment.
    jobs : int
        Number of worker processes.
    force : bool
        Whether `output` may be replaced.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    VideoResult
        Numbers of frames and segments.

    Raises
    ------
    OutputError
        If a file cannot be written.
    RsdeblurError
        If a segment fails twice.
    """
    check_output(output, force=force)
    parts = Records(parts_folder(output))
    try:
        parts.open()
    except OSError as error:
        raise OutputError(f"{parts.folder}: cannot make the folder: {error.strerror}") from error
    report_progress = progress or (lambda stage, fraction: None)
    clip = plan.clip
    fingerprint = _fingerprint(plan, encoding, segment)
    starts = range(0, len(clip), segment)
    paths = [parts.folder / f"{first:07d}.mkv" for first in starts]
    done = [parts.facts(path.name, fingerprint) is not None and path.is_file() for path in paths]
    resumed = sum(done)

    def tasks() -> Iterator[Segment]:
        for first, path, ready in zip(starts, paths, done, strict=True):
            stop = min(first + segment, len(clip))
            if not ready:
                yield Segment(plan, first, stop, encoding, path)

    finished = resumed
    report_progress(f"{min(finished * segment, len(clip))} of {len(clip)} frames", finished / len(paths))
    try:
        with closing(workers.run(encode_segment, tasks(), jobs=jobs, lost=_tidy)) as answers:
            for task, answer in answers:
                if isinstance(answer, workers.Failure):
                    raise RsdeblurError(f"frames {task.first} to {task.stop - 1}: {answer.message}")
                parts.finish(task.output.name, fingerprint, answer)
                finished += 1
                report_progress(f"{min(finished * segment, len(clip))} of {len(clip)} frames", finished / len(paths))
    finally:
        for path in paths:
            remove_unfinished(path)
    dropped = join(clip, paths, output)
    shutil.rmtree(parts.folder)
    kept = sum(reason is not None for reason in plan.reasons)
    return VideoResult(len(clip), kept, len(paths), resumed, dropped)


def _tidy(segment: Segment) -> None:
    remove_unfinished(segment.output)


def _fingerprint(plan: ClipPlan, encoding: Encoding, segment: int) -> str:
    """Return the fingerprint of everything that the bits of a segment depend on."""
    log, camera = plan.log, plan.camera
    motion: list[Any] = [log.epoch_ns, log.t.tobytes(), log.omega.tobytes(), repr(camera), camera.imu_to_camera]
    shared = [plan.clip, plan.exposures, plan.reasons, replace(plan.options, threads=None), plan.strengths, plan.grid]
    return fingerprint([*motion, *shared, encoding, segment], [plan.clip.path])
