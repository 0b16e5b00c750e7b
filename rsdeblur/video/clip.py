"""Properties and frames of a video."""

from __future__ import annotations

import os
import struct
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from rsdeblur._util import ffmpeg
from rsdeblur._util.files import checked_path, open_file
from rsdeblur.errors import FileFormatError, RsdeblurWarning
from rsdeblur.io.sessions import PHOTOS
from rsdeblur.video._av import av

HDR_DATA = frozenset({"MASTERING_DISPLAY_METADATA", "CONTENT_LIGHT_LEVEL"})


class Colours(NamedTuple):
    """FFmpeg's numbers for the colours of a video.

    Parameters
    ----------
    range, space, primaries, transfer : int
        Colour range, colour space (the matrix of YCbCr), primaries and transfer characteristic.
    """

    range: int
    space: int
    primaries: int
    transfer: int


@dataclass(frozen=True, slots=True)
class Clip:
    """Properties of a file's first video stream.

    Parameters
    ----------
    path : Path
        The file.
    width, height : int
        Size of the frames as stored, px.
    timestamps : tuple of int
        Presentation times of the frames, in units of `time_base`, increasing.
    end : int
        End of the last frame, in the same units.
    keys : tuple of int
        Timestamps of the frames at which decoding can start.
    time_base : Fraction
        Unit of the timestamps, s.
    codec, pixels : str
        FFmpeg's names of the codec and of the pixel format.
    rate : Fraction
        Mean number of frames per second.
    aspect : Fraction, or None
        Width of a pixel divided by its height, as players show it; None if the video does not say.
    colours : Colours
        Tags of the stream.
    matrix : tuple of 9 int, or None
        How players turn the frames, as FFmpeg's display matrix.
    """

    path: Path
    width: int
    height: int
    timestamps: tuple[int, ...]
    end: int
    keys: tuple[int, ...]
    time_base: Fraction
    codec: str
    pixels: str
    rate: Fraction
    aspect: Fraction | None
    colours: Colours
    matrix: tuple[int, ...] | None

    def __len__(self) -> int:
        return len(self.timestamps)

    @property
    def times(self) -> list[float]:
        """Presentation times of the frames, s after the first one."""
        return [float((timestamp - self.timestamps[0]) * self.time_base) for timestamp in self.timestamps]


def open_container(path: Path) -> Any:
    """Open a video for reading; the caller closes it.

    Parameters
    ----------
    path : Path
        The video.

    Raises
    ------
    FileFormatError
        If FFmpeg cannot read the file, it is a pipe or a device, or not in one of the containers that are read.
    """
    # FFmpeg would wait for the writer of a pipe.
    open_file(path, "video").close()
    try:
        return av.open(**ffmpeg.existing(path))
    except av.error.ArgumentError as error:
        what = "not a video in a container that is read; convert it to MP4, MOV, Matroska, WebM, AVI or MPEG-TS"
        if path.suffix.lower() in PHOTOS:
            what = "a picture, not a video; use rsdeblur deblur for single pictures, rsdeblur batch for many"
        raise FileFormatError(f"{path}: {what}") from error
    except av.error.FFmpegError as error:
        raise _unreadable(path, error) from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn FFmpeg's errors in the block into errors that name the video.

    Parameters
    ----------
    path : Path
        The video.

    Raises
    ------
    FileFormatError
        If FFmpeg cannot read the file.
    """
    try:
        yield
    except av.error.FFmpegError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Any) -> FileFormatError:
    from rsdeblur.io.source import Source, mistaken

    return mistaken(Source(path, "video")) or FileFormatError(f"{path}: cannot read the video: {error.strerror}")


def open_clip(path: str | os.PathLike[str]) -> Clip:
    """Read the properties of a video; the whole file is scanned, but only its first frame is decoded.

    Parameters
    ----------
    path : path-like
        The video.

    Raises
    ------
    FileFormatError, InputError
        If the file is not a video, has no video stream, or its frames have no timestamps; or `path` is no path.

    Warns
    -----
    RsdeblurWarning
        If the video is interlaced, or has HDR10 metadata, which is left out.
    """
    path = checked_path(path)
    with reading(path), open_container(path) as container:
        if not container.streams.video:
            raise FileFormatError(f"{path}: the file has no video stream")
        stream = container.streams.video[0]
        shown, keys, end = set(), set(), 0
        for packet in container.demux(stream):
            if not packet.size or packet.is_discard:
                continue
            if packet.pts is None:
                raise FileFormatError(f"{path}: the frames have no timestamps; convert it to MP4 or Matroska first")
            shown.add(packet.pts)
            end = max(end, packet.pts + max(packet.duration or 0, 1))
            if packet.is_keyframe:
                keys.add(packet.pts)
        if not shown:
            raise FileFormatError(f"{path}: the video has no frames")
    # Opened again: MPEG-TS cannot be sought to its start.
    with reading(path), open_container(path) as container:
        stream = container.streams.video[0]
        first = next(container.decode(stream), None)
        if first is None:
            raise FileFormatError(f"{path}: no frame of the video can be decoded")
        _warn_of_losses(path, first)
        context = stream.codec_context
        return Clip(
            path=path,
            width=first.width,
            height=first.height,
            timestamps=tuple(sorted(shown)),
            end=end,
            keys=tuple(sorted(keys)),
            time_base=stream.time_base,
            codec=context.name,
            pixels=first.format.name,
            rate=stream.average_rate or Fraction(30),
            aspect=stream.sample_aspect_ratio or None,
            colours=Colours(
                *map(int, (first.color_range, first.colorspace, context.color_primaries, context.color_trc))
            ),
            matrix=_display_matrix(first),
        )


def _side_data(frame: Any) -> dict[str, Any]:
    """Return the side data of a frame by the names of their types; PyAV 18 iterates over data, 19 over types."""
    every = [frame.side_data[n] for n in range(len(frame.side_data))]
    return {data.type.name: data for data in every}


def _display_matrix(frame: Any) -> tuple[int, ...] | None:
    data = _side_data(frame).get("DISPLAYMATRIX")
    return None if data is None else struct.unpack("9i", bytes(data))


def _warn_of_losses(path: Path, frame: Any) -> None:
    lost = []
    if frame.interlaced_frame:
        lost.append("it is interlaced: its fields are deblurred as one frame and marked as progressive")
    if not HDR_DATA.isdisjoint(_side_data(frame)):
        lost.append("its HDR10 metadata (mastering display, light levels) is left out")
    for text in lost:
        warnings.warn(f"{path}: {text}", RsdeblurWarning, stacklevel=3)


def frames(clip: Clip, first: int, stop: int, *, threads: int | None = None) -> Generator[Any, None, None]:
    """Decode the frames with the numbers `first` to `stop - 1`.

    Parameters
    ----------
    clip : Clip
        The video.
    first, stop : int
        Numbers of the first frame and of the one after the last, from 0.
    threads : int, optional
        Threads of the decoder; default as many as FFmpeg takes.

    Raises
    ------
    FileFormatError
        If a frame cannot be decoded.
    """
    remaining = set(clip.timestamps[first:stop])
    keys = [key for key in clip.keys if key <= clip.timestamps[first]]
    # One key frame earlier than needed: frames shown before a key frame may refer to frames before it. Seeking in
    # MPEG-TS may end behind the place; then further back, and at last from the start.
    for place in (*(keys[-back] for back in (2, 4, 8, 16) if back < len(keys)), None):
        with reading(clip.path), open_container(clip.path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            # FFmpeg's threads take a tenth more of the processors' time than one.
            stream.codec_context.thread_count = threads or 0
            if place is not None:
                container.seek(place, stream=stream)
            decoded = container.decode(stream)
            head = next(decoded, None)
            if place is not None and (head is None or head.pts is None or head.pts > keys[-1]):
                continue
            for frame in chain([head] if head else [], decoded):
                if frame.pts in remaining:
                    remaining.remove(frame.pts)
                    yield frame
                if not remaining:
                    return
            break
    raise FileFormatError(f"{clip.path}: {len(remaining)} of frames {first} to {stop - 1} cannot be decoded")
