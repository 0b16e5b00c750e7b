"""Joining of segments, sound and motion data into one video, without encoding anything again."""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rsdeblur._util.atomic import atomic_write
from rsdeblur.errors import InputError, OutputError, RsdeblurError
from rsdeblur.video._av import av
from rsdeblur.video.clip import Clip, open_container, reading

CONTAINERS = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska", ".webm": "webm"}


def container_of(path: str | os.PathLike[str]) -> str:
    """Return FFmpeg's name of the container for a file's extension.

    Raises
    ------
    OutputError
        If the extension is unknown.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in CONTAINERS:
        raise OutputError(f"{path}: unknown video extension {suffix!r}; use one of {', '.join(CONTAINERS)}")
    return CONTAINERS[suffix]


def copied_streams(source: Any, container: Any) -> list[Any]:
    """Return the streams of an open video that are copied into a container: sound, and the data of action cameras.

    Parameters
    ----------
    source, container
        The original, and the container that is written.
    """
    # FFmpeg calls GPMF, the motion data of GoPro's cameras, plain binary data. Other data have no name, and its writers
    # refuse them; it writes the time code again from the tags of the file.
    data = [stream for stream in source.streams.data if stream.name == "bin_data"]
    return [*source.streams.audio, *(data if container.format.name in ("mp4", "mov") else ())]


def join(clip: Clip, segments: Sequence[Path], output: Path) -> list[str]:
    """Write the video from its segments, with the sound, the motion data, the timestamps and the tags of the clip.

    Parameters
    ----------
    clip : Clip
        The original.
    segments : sequence of Path
        Files of the new frames, one packet for each frame.
    output : Path
        Video to write; replaced atomically.

    Returns
    -------
    list of str
        Types of the streams that the new file does not have: all except the first video stream, sound and motion data.
        And "shape of the pixels", if they are not square and the codec cannot say so.

    Raises
    ------
    OutputError
        If the file cannot be written, or its container does not take the streams.
    FileFormatError
        If the original or a segment cannot be read.
    """
    try:
        with ExitStack() as stack:
            source = stack.enter_context(open_container(clip.path))
            head = stack.enter_context(open_container(segments[0]))
            file = stack.enter_context(atomic_write(output))
            container = stack.enter_context(av.open(file, "w", format=container_of(output)))
            container.metadata.update(source.metadata)
            pictures = _picture_stream(container, clip, head.streams.video[0])
            pictures.metadata.update(_without_encoder(source.streams.video[0].metadata))
            copies = {
                stream: container.add_stream_from_template(stream) for stream in copied_streams(source, container)
            }
            for old, new in copies.items():
                new.metadata.update(old.metadata)
            for packet in heapq.merge(_pictures(clip, segments, pictures), _copied(clip, source, copies), key=_time):
                container.mux(packet)
            left = [stream.type for stream in source.streams if stream not in copies]
            left.remove("video")
            # PyAV cannot set it in the container, where VP9 and AV1 have it.
            if clip.aspect is not None and head.streams.video[0].sample_aspect_ratio != clip.aspect:
                left.append("shape of the pixels")
            return left
    except RsdeblurError:
        raise
    except (av.error.FFmpegError, ValueError) as error:
        raise OutputError(f"{output}: cannot write the video: {getattr(error, 'strerror', error)}") from error


def _without_encoder(metadata: dict[str, str]) -> dict[str, str]:
    return {key: value for key, value in metadata.items() if key != "encoder"}


def _picture_stream(container: Any, clip: Clip, template: Any) -> Any:
    # Opaque: no encoder is created, because there is none for the names of some decoders.
    stream = container.add_stream_from_template(template, opaque=True)
    stream.time_base = clip.time_base
    if clip.matrix is not None:
        stream.set_display_matrix(clip.matrix)
    if template.codec_context.name == "hevc" and container.format.name in ("mp4", "mov"):
        # Apple's players accept no other tag.
        stream.codec_context.codec_tag = "hvc1"
    return stream


def _time(packet: Any) -> float:
    return float(packet.dts * packet.time_base)


def _pictures(clip: Clip, segments: Sequence[Path], stream: Any) -> Iterator[Any]:
    """Yield the packets of all frames, stamped as in the clip."""
    timestamps = iter([*clip.timestamps, clip.end])
    here = next(timestamps)
    for path in segments:
        with reading(path), open_container(path) as container:
            for packet in container.demux(container.streams.video[0]):
                if not packet.size:
                    continue
                following = next(timestamps, None)
                if following is None:
                    raise InputError(f"{path}: the segments contain more frames than {clip.path}")
                packet.pts = packet.dts = here
                packet.time_base = clip.time_base
                packet.duration = following - here
                packet.stream = stream
                here = following
                yield packet
    if next(timestamps, None) is not None:
        raise InputError(f"{clip.path}: the segments contain fewer frames")


def _copied(clip: Clip, source: Any, streams: dict[Any, Any]) -> Iterator[Any]:
    if not streams:
        return
    with reading(clip.path):
        for packet in source.demux(*streams):
            if packet.dts is not None and packet.size:
                packet.stream = streams[packet.stream]
                yield packet
