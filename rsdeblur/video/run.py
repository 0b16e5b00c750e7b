"""Deblurring of a planned video: segments in worker processes, then joining."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass, replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from rsdeblur._util import validate, workers
from rsdeblur._util.atomic import check_target, remove_unfinished
from rsdeblur._util.files import checked_path
from rsdeblur._util.records import Records, contents, fingerprint
from rsdeblur.choices import SEGMENT
from rsdeblur.errors import FileFormatError, OutputError, RsdeblurError
from rsdeblur.types import Progress
from rsdeblur.video._av import av
from rsdeblur.video.clip import Clip, open_container
from rsdeblur.video.joining import container_of, copied_streams, join
from rsdeblur.video.plan import ClipPlan
from rsdeblur.video.segments import CONTAINER, Encoding, Segment, add_stream, encode_segment

# Frames whose time is taken to estimate that of all.
TRIAL = 4


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
        Types of the streams that were left out; "shape of the pixels" if the codec does not keep it.
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
        If the extension is unknown, the folder is missing or not writable, the file exists and `force` is not set, or
        the folder for its segments contains other files.
    """
    container_of(output)
    check_target(output, force=force)
    Records(parts_folder(output)).check()


def check_container(clip: Clip, encoding: Encoding, output: Path) -> None:
    """Check that the frames can be encoded, and that the container takes them, sound and motion data, before the work.

    Parameters
    ----------
    clip : Clip
        The original.
    encoding : Encoding
        Encoding of the new frames.
    output : Path
        The video to be written.

    Raises
    ------
    OutputError
        If they cannot, or the container does not take them.
    """
    if reason := _refusal(clip, encoding, CONTAINER, None):
        size = f"{clip.width}x{clip.height} px, {encoding.pixels}"
        raise OutputError(
            f"{clip.path}: frames of {size}, cannot be encoded by {encoding.codec} ({reason}); use another --codec, "
            "like ffv1, which is lossless, into .mkv"
        )
    with open_container(clip.path) as source:
        if reason := _refusal(clip, encoding, container_of(output), source):
            codecs = " and ".join([encoding.codec, *(sound.codec_context.name for sound in source.streams.audio)])
            raise OutputError(
                f"{output}: this container does not take {codecs} ({reason}); use .mkv, or another --codec"
            )


def _refusal(clip: Clip, encoding: Encoding, kind: str, source: Any) -> str | None:
    """Return why a container does not take the frames, and the sound and motion data of `source`; None if it does."""
    try:
        with av.open(BytesIO(), "w", format=kind) as container:
            add_stream(container, clip, encoding)
            for stream in copied_streams(source, container) if source else ():
                container.add_stream_from_template(stream)
            container.start_encoding()  # writes the header
    except (av.error.FFmpegError, ValueError) as error:
        return str(getattr(error, "strerror", error))
    return None


def deblur_video(
    plan: ClipPlan,
    output: str | os.PathLike[str],
    *,
    encoding: Encoding,
    segment: int = SEGMENT,
    jobs: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> VideoResult:
    """Deblur a video as planned; sound, motion data, timestamps, rotation and colour tags are kept.

    Finished segments are kept in a folder beside `output` until it is complete. After an interrupt, the next call with
    the same arguments continues with them.

    Parameters
    ----------
    plan : ClipPlan
        See :func:`rsdeblur.video.plan.plan_clip`; frames whose share is 0 are left as they are.
    output : path-like
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
    InputError
        If `output` is no path, or a number is not at least 1.
    RsdeblurError
        If a segment fails twice.
    """
    output, segment = checked_path(output), validate.count("segment", segment)
    check_output(output, force=force)
    check_container(plan.clip, encoding, output)
    clip = plan.clip
    parts = Records(parts_folder(output))
    starts = range(0, len(clip), segment)
    segments = [
        Segment(plan, first, min(first + segment, len(clip)), encoding, parts.folder / f"{first:07d}.mkv")
        for first in starts
    ]
    with parts.held():
        try:
            resumed = _encode(segments, parts, _fingerprint(plan, encoding, segment), jobs, progress)
            dropped = join(clip, [each.output for each in segments], output)
            is_kept = False
        except BaseException:
            is_kept = any(each.output.exists() for each in segments)
            raise
        finally:
            if not is_kept:
                parts.remove()
    return VideoResult(len(clip), len(clip) - plan.treated, len(segments), resumed, dropped)


def estimated_seconds(plan: ClipPlan, encoding: Encoding, *, jobs: int = 1) -> float:
    """Estimate how long :func:`deblur_video` takes, from a trial with a few frames that writes no file of its own.

    Parameters
    ----------
    plan, encoding, jobs
        See :func:`deblur_video`.

    Returns
    -------
    float
        Seconds. Planning and the start of worker processes are not counted.
    """
    frames = len(plan.clip)
    first = min(plan.lengths.index(plan.largest), max(0, frames - TRIAL))
    stop = min(first + TRIAL, frames)
    seconds = []
    with TemporaryDirectory() as folder:
        # The first trial loads compiled code.
        for share in (1.0, 1.0, 0.0):
            shares = tuple(share if reason is None else 0.0 for reason in plan.reasons)
            trial = replace(plan, shares=shares)
            begin = time.perf_counter()
            encode_segment(Segment(trial, first, stop, encoding, Path(folder) / "trial.mkv"))
            seconds.append((time.perf_counter() - begin) / (stop - first))
    _, treated, untouched = seconds
    return (plan.treated * treated + (frames - plan.treated) * untouched) / jobs


def _encode(segments: Sequence[Segment], parts: Records, fingerprint: str, jobs: int, progress: Progress | None) -> int:
    """Encode the missing segments; return the number of those that an earlier run finished."""
    report_progress = progress or (lambda stage, fraction: None)
    missing = [each for each in segments if not _is_whole(each.output, parts, fingerprint)]
    total = segments[-1].stop
    frames = total - sum(each.stop - each.first for each in missing)

    def tasks() -> Iterator[Segment]:
        for each in missing:
            parts.claim(each.output.name, fingerprint)
            yield each

    report_progress(f"{frames} of {total} frames", frames / total)
    try:
        with closing(workers.run(encode_segment, tasks(), jobs=jobs, lost=_tidy)) as answers:
            for task, answer in answers:
                if isinstance(answer, workers.Failure):
                    raise RsdeblurError(f"frames {task.first} to {task.stop - 1}: {answer.message}")
                parts.finish(task.output.name, fingerprint, contents(task.output))
                frames += task.stop - task.first
                report_progress(f"{frames} of {total} frames", frames / total)
    finally:
        for each in segments:
            _tidy(each)
    return len(segments) - len(missing)


def _is_whole(path: Path, parts: Records, fingerprint: str) -> bool:
    """Whether a segment is as it was recorded."""
    facts = parts.facts(path.name, fingerprint)
    try:
        return facts is not None and contents(path) == facts
    except FileFormatError:
        return False


def _tidy(segment: Segment) -> None:
    remove_unfinished(segment.output)


def _fingerprint(plan: ClipPlan, encoding: Encoding, segment: int) -> str:
    """Return the fingerprint of everything that the bits of a segment depend on."""
    log, camera = plan.log, plan.camera
    motion: list[Any] = [log.epoch_ns, log.t.tobytes(), log.omega.tobytes(), camera.imu_to_camera.tobytes()]
    motion += astuple(camera)
    if (track := plan.options.translation) is not None:
        motion += [track.epoch_ns, track.t.tobytes(), track.position.tobytes(), np.asarray(track.depth).tobytes()]
    # By its name alone, like the files of a batch, so that the folder may be moved.
    clip = replace(plan.clip, path=Path(plan.clip.path.name))
    shared = [clip, plan.exposures, plan.shares, replace(plan.options, threads=None), plan.strengths]
    return fingerprint([*motion, *shared, encoding, segment], [plan.clip.path])
