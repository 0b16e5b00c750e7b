"""One pass over a planned video: frames are decoded, deblurred and encoded; sound and motion data are copied."""

from __future__ import annotations

import heapq
import os
import time
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.atomic import atomic_write, check_target
from rsdeblur._util.files import checked_path
from rsdeblur._util.memory import empty
from rsdeblur.choices import CRF
from rsdeblur.errors import InputError, OutputError, RsdeblurError
from rsdeblur.types import Progress
from rsdeblur.video._av import av
from rsdeblur.video.clip import Clip, frames, open_container, reading
from rsdeblur.video.pixels import frame_of, kept_frame, matrix_of, values_of
from rsdeblur.video.plan import ClipPlan

CONTAINERS = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".webm": "webm"}
# Encoder for each decoder name.
ENCODERS = {
    "h264": "libx264",
    "hevc": "libx265",
    "vp9": "libvpx-vp9",
    "libvpx-vp9": "libvpx-vp9",
    "av1": "libsvtav1",
    "libdav1d": "libsvtav1",
    "prores": "prores_ks",
    "rawvideo": "ffv1",  # lossless, too
}
FALLBACK = "libx264"
# No frame refers to a later one, so packets come in the order of the frames, and get their timestamps.
OPTIONS = {
    # Intra blocks of 4 x 4 pixels would take a tenth more time for files of no better quality.
    "libx264": {"preset": "veryfast", "partitions": "p8x8,i8x8"},
    "libx265": {"preset": "fast", "x265-params": "log-level=none"},
    "libvpx-vp9": {"b": "0", "deadline": "good", "cpu-used": "3", "auto-alt-ref": "0", "lag-in-frames": "0"},
    "libsvtav1": {"preset": "8", "svtav1-params": "pred-struct=1"},
}
# Frames whose time is taken to estimate that of all.
TRIAL = 4


@dataclass(frozen=True, slots=True)
class Encoding:
    """Encoding of the frames.

    Parameters
    ----------
    codec, pixels : str
        FFmpeg's names of the encoder and of the pixel format.
    crf : int
        Constant rate factor: lower is better and larger.
    """

    codec: str
    pixels: str
    crf: int

    @classmethod
    def like(cls, clip: Clip, *, codec: str | None = None, crf: int = CRF) -> Encoding:
        """Return the clip's encoding, or that of another `codec` with the clip's pixel format if it supports it.

        Parameters
        ----------
        clip : Clip
            The clip.
        codec : str, optional
            FFmpeg's name of the codec; default that of the clip.
        crf : int
            Constant rate factor: less is better and larger.

        Raises
        ------
        InputError
            If FFmpeg has no video encoder of that name, or it is "rawvideo".
        """
        if codec == "rawvideo":
            raise InputError("rawvideo loses the pixel format; use ffv1, which is lossless, too")
        name = codec or ENCODERS.get(clip.codec, clip.codec)
        encoder = _encoder(name) or (_encoder(FALLBACK) if codec is None else None)
        if encoder is None:
            raise InputError(f"FFmpeg has no video encoder called {name!r}; try libx264 or libx265")
        # The formats yuvj mean full range, which is a tag of the stream as well.
        own = clip.pixels.replace("yuvj", "yuv")
        allowed = [kind.name for kind in encoder.video_formats or ()] or [own]
        deep = "10" in own or "12" in own
        wanted = (own, "yuv420p10le" if deep else "yuv420p", allowed[0])
        return cls(encoder.name, next(pixels for pixels in wanted if pixels in allowed), crf)


def _encoder(name: str) -> Any:
    try:
        encoder = av.Codec(name, "w")
    except av.codec.codec.UnknownCodecError:
        return None
    return encoder if encoder.type == "video" else None


@dataclass(frozen=True, slots=True)
class VideoResult:
    """Summary of a deblurred video.

    Parameters
    ----------
    frames, kept : int
        Number of frames, and how many of them were left as they are.
    dropped : list of str
        Types of the streams that were left out; "shape of the pixels" if the file does not keep it.
    """

    frames: int
    kept: int
    dropped: list[str]


def check_output(clip: Clip, encoding: Encoding, output: Path, *, force: bool) -> None:
    """Check, before the work, that a video can be encoded and written, and that the container takes all its streams.

    Parameters
    ----------
    clip : Clip
        The clip whose frames and streams are written.
    encoding : Encoding
        Codec and pixel format.
    output : Path
        Path of the video.
    force : bool
        Whether an existing file may be replaced.

    Raises
    ------
    OutputError
        If not.
    """
    check_target(output, force=force)
    if reason := _refusal(clip, encoding, "matroska", None):
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


def container_of(path: Path) -> str:
    """Return FFmpeg's name of the container for a file's extension.

    Parameters
    ----------
    path : Path
        Path of the video.

    Raises
    ------
    OutputError
        If the extension is unknown.
    """
    suffix = path.suffix.lower()
    if suffix not in CONTAINERS:
        raise OutputError(f"{path}: unknown video extension {suffix!r}; use one of {', '.join(CONTAINERS)}")
    return CONTAINERS[suffix]


def _refusal(clip: Clip, encoding: Encoding, kind: str, source: Any) -> str | None:
    """Return why a container does not take the frames, and the copied streams of `source`; None if it does."""
    try:
        with av.open(BytesIO(), "w", format=kind) as container:
            _add_pictures(container, clip, encoding, 1)
            for stream in _copied_streams(source, container) if source else ():
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
    jobs: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> VideoResult:
    """Deblur a video as planned; sound, motion data, timestamps, rotation and colour tags are kept.

    Parameters
    ----------
    plan : ClipPlan
        See :func:`rsdeblur.video.plan.plan_clip`; frames whose share is 0 are left as they are.
    output : path-like
        Video to write; its extension chooses the container. It appears when it is complete.
    encoding : Encoding
        See :meth:`Encoding.like`.
    jobs : int, default 1
        Number of frames that are deblurred at a time, each by ``plan.options.threads``.
    force : bool, default False
        Whether `output` may be replaced.
    progress : callable, optional
        Called as ``progress(stage, fraction)``.

    Returns
    -------
    VideoResult
        Number of frames, and what was left out.

    Raises
    ------
    OutputError
        If the file cannot be written, or its container does not take the streams.
    FileFormatError
        If a frame cannot be decoded.
    """
    output, clip, count = checked_path(output), plan.clip, len(plan.clip)
    check_output(clip, encoding, output, force=force)
    report_progress = progress or (lambda stage, fraction: None)
    try:
        with ExitStack() as stack:
            source = stack.enter_context(open_container(clip.path))
            file = stack.enter_context(atomic_write(output))
            container = stack.enter_context(av.open(file, "w", format=container_of(output)))
            container.metadata.update(source.metadata)
            stream = _add_pictures(container, clip, encoding, jobs)
            tags = source.streams.video[0].metadata
            stream.metadata.update({key: value for key, value in tags.items() if key != "encoder"})
            copies = {old: container.add_stream_from_template(old) for old in _copied_streams(source, container)}
            for old, new in copies.items():
                new.metadata.update(old.metadata)
            pictures = stack.enter_context(closing(_pictures(plan, stream, range(count), jobs)))
            done = 0
            for packet in heapq.merge(pictures, _copied(clip, source, copies), key=_time):
                done += packet.stream is stream
                report_progress(f"{done} of {count} frames", done / count)
                container.mux(packet)
            left = [old.type for old in source.streams if old not in copies]
            left.remove("video")
    except RsdeblurError:
        raise
    except (av.error.FFmpegError, ValueError) as error:
        raise OutputError(f"{output}: cannot write the video: {getattr(error, 'strerror', error)}") from error
    with open_container(output) as made:
        # PyAV cannot set it in Matroska, where VP9 and AV1 have it.
        if clip.aspect is not None and made.streams.video[0].sample_aspect_ratio != clip.aspect:
            left.append("shape of the pixels")
    return VideoResult(count, count - plan.treated, left)


def estimated_seconds(plan: ClipPlan, encoding: Encoding, *, jobs: int = 1) -> float:
    """Estimate how long :func:`deblur_video` takes, in s, from a trial with a few frames that writes no file.

    Parameters
    ----------
    plan : ClipPlan
        Plan of the clip.
    encoding : Encoding
        Codec and pixel format.
    jobs : int, default 1
        Frames that are deblurred at a time.
    """
    frames = len(plan.clip)
    first = min(plan.lengths.index(plan.largest), max(0, frames - TRIAL))
    numbers = range(first, min(first + TRIAL, frames))
    seconds = []
    # The first trial loads compiled code.
    for share in (1.0, 1.0, 0.0):
        trial = replace(plan, shares=tuple(share if reason is None else 0.0 for reason in plan.reasons))
        begin = time.perf_counter()
        with av.open(BytesIO(), "w", format="matroska") as container:
            for packet in _pictures(trial, _add_pictures(container, plan.clip, encoding, 1), numbers, 1):
                container.mux(packet)
        seconds.append((time.perf_counter() - begin) / len(numbers))
    _, treated, untouched = seconds
    return (plan.treated * treated + (frames - plan.treated) * untouched) / jobs


def _add_pictures(container: Any, clip: Clip, encoding: Encoding, threads: int) -> Any:
    """Return a new stream of a container, with its encoder, for the frames of a clip."""
    # SVT-AV1 logs to stderr; level 1 means errors only.
    os.environ.setdefault("SVT_LOG", "1")
    options = {"crf": str(encoding.crf)} | OPTIONS.get(encoding.codec, {})
    stream = container.add_stream(encoding.codec, rate=clip.rate, options=options)
    stream.width, stream.height, stream.pix_fmt = clip.width, clip.height, encoding.pixels
    context = stream.codec_context
    context.time_base = stream.time_base = clip.time_base
    if clip.aspect is not None:
        context.sample_aspect_ratio = clip.aspect
    context.max_b_frames = 0
    context.thread_count = threads
    context.color_range = clip.colours.range
    context.color_primaries, context.color_trc = clip.colours.primaries, clip.colours.transfer
    context.colorspace = matrix_of(clip.colours.space, clip.pixels, encoding.pixels)
    if clip.matrix is not None:
        stream.set_display_matrix(clip.matrix)
    if encoding.codec == "libx265" and container.format.name in ("mp4", "mov"):
        # Apple's players accept no other tag.
        context.codec_tag = "hvc1"
    return stream


def _pictures(plan: ClipPlan, stream: Any, numbers: range, jobs: int) -> Generator[Any, None, None]:
    """Yield the packets of the frames with these numbers, stamped as in the clip."""
    clip = plan.clip
    times = [*clip.timestamps, clip.end]
    waiting = iter(numbers)
    with closing(_new_frames(plan, stream.pix_fmt, numbers, jobs)) as restored:
        for frame in chain(restored, [None]):
            for packet in stream.encode(frame):
                number = next(waiting)
                packet.pts = packet.dts = times[number]
                packet.duration = times[number + 1] - times[number]
                packet.time_base = clip.time_base
                yield packet
    if (left := next(waiting, None)) is not None:
        raise InputError(f"{clip.path}: the encoder leaves out frame {left}; use another --codec")


def _new_frames(plan: ClipPlan, pixels: str, numbers: range, jobs: int) -> Generator[Any, None, None]:
    """Yield the new frames in their order; one more than `jobs` are decoded ahead."""
    waiting: deque[Future[Any]] = deque()
    pool = ThreadPoolExecutor(jobs)
    try:
        with closing(frames(plan.clip, numbers.start, numbers.stop, threads=jobs)) as old:
            for number, frame in zip(numbers, old, strict=True):
                waiting.append(pool.submit(_restored, plan, number, frame, pixels))
                if len(waiting) > jobs + 1:
                    yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        # After an error or an interrupt, nobody waits for the frames under way.
        pool.shutdown(wait=False, cancel_futures=True)


def _restored(plan: ClipPlan, number: int, frame: Any, pixels: str) -> Any:
    """Return a frame of the result."""
    share = plan.shares[number]
    if not share:
        return kept_frame(frame, pixels)
    try:
        values = values_of(frame)
        sharp = plan.frame(number).apply(values, out=empty(values.shape, np.uint16)).image
    except RsdeblurError as error:
        raise type(error)(f"{plan.clip.path}: frame {number}: {error}") from error
    return frame_of(_mixed(values, sharp, share), frame, pixels)


def _mixed(values: NDArray[np.uint16], sharp: NDArray[np.uint16], share: float) -> NDArray[np.uint16]:
    """Return a frame mixed with its deblurred version."""
    if share == 1:
        return sharp
    mixed = np.float32(1 - share) * values
    mixed += np.float32(share) * sharp
    levels: NDArray[np.uint16] = np.rint(mixed, out=mixed).astype(np.uint16)
    return levels


def _copied_streams(source: Any, container: Any) -> list[Any]:
    """Return the streams of an open video that a container takes over: sound, and the data of action cameras."""
    # FFmpeg calls GPMF, the motion data of GoPro's cameras, plain binary data. Other data have no name, and its writers
    # refuse them; it writes the time code again from the tags of the file.
    data = [stream for stream in source.streams.data if stream.name == "bin_data"]
    return [*source.streams.audio, *(data if container.format.name in ("mp4", "mov") else ())]


def _copied(clip: Clip, source: Any, streams: dict[Any, Any]) -> Iterator[Any]:
    if not streams:
        return
    with reading(clip.path):
        for packet in source.demux(*streams):
            if packet.dts is not None and packet.size:
                packet.stream = streams[packet.stream]
                yield packet


def _time(packet: Any) -> float:
    return float(packet.dts * packet.time_base)
