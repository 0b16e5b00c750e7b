"""One pass over a planned video: frames are decoded, deblurred and encoded; sound and motion data are copied."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from rsdeblur._util.files import atomic_write, check_target, checked_path
from rsdeblur.choices import CRF
from rsdeblur.errors import FileFormatError, InputError, OutputError, RsdeblurError
from rsdeblur.types import Progress
from rsdeblur.video.clip import FULL_RANGE, LIMITED_RANGE, RGB, SCALING, Clip, av, reading, values_of
from rsdeblur.video.plan import ClipPlan

__all__ = ["Encoding", "deblur_video"]

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
# No frame refers to a later one, so each packet is that of the frame whose number it has.
OPTIONS = {
    # Intra blocks of 4 x 4 pixels would take a tenth more time for files of no better quality.
    "libx264": {"preset": "veryfast", "partitions": "p8x8,i8x8"},
    "libx265": {"preset": "fast", "x265-params": "log-level=none"},
    "libvpx-vp9": {"b": "0", "deadline": "good", "cpu-used": "3", "auto-alt-ref": "0", "lag-in-frames": "0"},
    "libsvtav1": {"preset": "8", "svtav1-params": "pred-struct=1"},
}


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
        """Return the clip's encoding, or that of another `codec` with the pixel format that is most like the clip's.

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
        best, _ = av.codec.find_best_pix_fmt_of_list(encoder.video_formats or [own], own)
        return cls(encoder.name, best.name, crf)


def _encoder(name: str) -> Any:
    try:
        encoder = av.Codec(name, "w")
    except av.codec.codec.UnknownCodecError:
        return None
    return encoder if encoder.type == "video" else None


def check_output(clip: Clip, encoding: Encoding, output: Path, *, force: bool) -> None:
    """Raise `OutputError` before the work if the video cannot be encoded or written with all streams of its clip."""
    check_target(output, force=force)
    kind = container_of(output)
    with reading(clip.path) as source:
        codecs = " and ".join([encoding.codec, *(sound.codec_context.name for sound in source.streams.audio)])
        what = (
            f"{encoding.codec} does not take frames of {clip.width}x{clip.height} px, {encoding.pixels}, or this "
            f"container does not take {codecs}; use .mkv, or another --codec, like ffv1, which is lossless"
        )
        with _writing(output, what), av.open(BytesIO(), "w", format=kind) as container:
            _add_streams(source, container, clip, encoding)
            container.start_encoding()  # writes the header


@contextmanager
def _writing(output: Path, what: str = "cannot write the video") -> Iterator[None]:
    """Turn FFmpeg's errors in the block into errors that name the file to be written."""
    try:
        yield
    except (av.error.FFmpegError, ValueError) as error:
        raise OutputError(f"{output}: {what} ({getattr(error, 'strerror', error)})") from error


def container_of(path: Path) -> str:
    """Return FFmpeg's name of the container for a file's extension; raise `OutputError` for an unknown one."""
    suffix = path.suffix.lower()
    if suffix not in CONTAINERS:
        raise OutputError(f"{path}: unknown video extension {suffix!r}; use one of {', '.join(CONTAINERS)}")
    return CONTAINERS[suffix]


def deblur_video(
    plan: ClipPlan,
    output: str | os.PathLike[str],
    *,
    encoding: Encoding,
    jobs: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> list[str]:
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
    list of str
        Types of the streams that were left out.

    Raises
    ------
    OutputError
        If the file cannot be written, or its container does not take the streams.
    FileFormatError
        If a frame cannot be decoded.
    """
    output, clip, count = checked_path(output), plan.clip, len(plan.clip)
    check_target(output, force=force)
    report_progress = progress or (lambda stage, fraction: None)
    with (
        reading(clip.path) as source,
        atomic_write(output) as file,
        av.open(file, "w", format=container_of(output)) as container,
    ):
        with _writing(output):
            stream, copies = _add_streams(source, container, clip, encoding, jobs)
        left = [old.type for old in source.streams if old not in copies]
        left.remove("video")
        ends = dict(zip(clip.timestamps, (*clip.timestamps[1:], clip.end), strict=True))
        with closing(_items(plan, source, copies, encoding.pixels, jobs)) as items:
            for item in items:
                with _writing(output):
                    if isinstance(item, av.Packet):
                        item.stream = copies[item.stream]
                        container.mux(item)
                    else:
                        container.mux(_encoded(stream, item, ends))
                report_progress(f"{count - len(ends)} of {count} frames", 1 - len(ends) / count)
        with _writing(output):
            container.mux(_encoded(stream, None, ends))
            container.close()
        if ends:
            raise InputError(f"{clip.path}: the encoder leaves out {len(ends)} of {count} frames; use another --codec")
    return left


def _add_streams(
    source: Any, container: Any, clip: Clip, encoding: Encoding, threads: int = 1
) -> tuple[Any, dict[Any, Any]]:
    """Add all streams to a container; return that of the frames, and the copies of the others by their originals."""
    # SVT-AV1 logs to stderr; level 1 means errors only.
    os.environ.setdefault("SVT_LOG", "1")
    container.metadata.update(source.metadata)
    old = source.streams.video[0]
    rate, options = old.average_rate or 30, {"crf": str(encoding.crf)} | OPTIONS.get(encoding.codec, {})
    stream = container.add_stream(encoding.codec, rate=rate, options=options)
    stream.width, stream.height, stream.pix_fmt = clip.width, clip.height, encoding.pixels
    stream.metadata.update({key: value for key, value in old.metadata.items() if key != "encoder"})
    context, tags = stream.codec_context, old.codec_context
    context.time_base = stream.time_base = clip.time_base
    if old.sample_aspect_ratio:
        context.sample_aspect_ratio = old.sample_aspect_ratio
    context.max_b_frames = 0
    context.thread_count = threads
    context.color_range = tags.color_range
    context.color_primaries, context.color_trc = tags.color_primaries, tags.color_trc
    context.colorspace = _matrix(int(tags.colorspace), clip.pixels, encoding.pixels)
    if clip.matrix is not None:
        stream.set_display_matrix(clip.matrix)
    is_mp4 = container.format.name in ("mp4", "mov")
    if encoding.codec == "libx265" and is_mp4:
        # Apple's players accept no other tag.
        context.codec_tag = "hvc1"
    # FFmpeg calls GPMF, the motion data of GoPro's cameras, plain binary data. Other data have no name, and its writers
    # refuse them; it writes the time code again from the tags of the file.
    data = [each for each in source.streams.data if is_mp4 and each.name == "bin_data"]
    copies = {each: container.add_stream_from_template(each) for each in (*source.streams.audio, *data)}
    for each, new in copies.items():
        new.metadata.update(each.metadata)
    return stream, copies


def _items(plan: ClipPlan, source: Any, copies: dict[Any, Any], pixels: str, jobs: int) -> Generator[Any, None, None]:
    """Yield the new frames in their order, and the packets of the copied streams; `jobs + 1` frames are under way."""
    clip, pictures = plan.clip, source.streams.video[0]
    pictures.thread_type = "AUTO"
    numbers = {timestamp: number for number, timestamp in enumerate(clip.timestamps)}
    waiting: deque[Future[Any]] = deque()
    pool = ThreadPoolExecutor(jobs)
    try:
        for packet in source.demux(pictures, *copies):
            if packet.stream is not pictures:
                if packet.dts is not None and packet.size:
                    yield packet
                continue
            for frame in packet.decode():
                if (number := numbers.pop(frame.pts, None)) is not None:
                    waiting.append(pool.submit(_restored, plan, number, frame, pixels))
                if len(waiting) > jobs + 1:
                    yield waiting.popleft().result()
        if numbers:
            raise FileFormatError(f"{clip.path}: {len(numbers)} of {len(clip)} frames cannot be decoded")
        while waiting:
            yield waiting.popleft().result()
    finally:
        # After an error or an interrupt, nobody waits for the frames under way.
        pool.shutdown(wait=False, cancel_futures=True)


def _encoded(stream: Any, frame: Any, ends: dict[int, int]) -> list[Any]:
    """Return packets of the next frames, or of the last ones if `frame` is None, and remove their times from `ends`."""
    packets: list[Any] = stream.encode(frame)
    for packet in packets:
        # PyAV takes that of a mean frame.
        packet.duration = ends.pop(packet.pts) - packet.pts
    return packets


def _restored(plan: ClipPlan, number: int, frame: Any, pixels: str) -> Any:
    """Return a frame of the result, in the pixel format `pixels`, with the tags of the original."""
    share = np.float32(plan.shares[number])
    matrix = _matrix(int(frame.colorspace), frame.format.name, pixels)
    new = frame
    own = frame.color_range or LIMITED_RANGE
    ranges = {"src_color_range": own, "dst_color_range": own}
    if share:
        try:
            values = values_of(frame)
            sharp = plan.frame(number).apply(values, out=np.empty_like(values)).image
        except RsdeblurError as error:
            raise type(error)(f"{plan.clip.path}: frame {number}: {error}") from error
        if share < 1:
            sharp = np.rint((1 - share) * values + share * sharp).astype(np.uint16)
        new, ranges["src_color_range"] = av.VideoFrame.from_ndarray(sharp, format=RGB), FULL_RANGE
    new = new.reformat(format=pixels, dst_colorspace=matrix, interpolation=SCALING, **ranges)
    new.color_range, new.colorspace = frame.color_range, matrix
    new.color_primaries, new.color_trc = frame.color_primaries, frame.color_trc
    new.pts, new.time_base = frame.pts, frame.time_base
    new.pict_type = 0  # the encoder chooses
    return new


def _matrix(matrix: int, source: str, pixels: str) -> int:
    """Return FFmpeg's number of the `matrix` of frames of the format `source` that are stored as `pixels`."""
    was_rgb, is_rgb = (av.VideoFormat(name).is_rgb for name in (source, pixels))
    return int(av.video.reformatter.Colorspace.ITU709) if was_rgb and not is_rgb else matrix
