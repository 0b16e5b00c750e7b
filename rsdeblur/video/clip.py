"""What a video is, and its frames."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

from rsdeblur.errors import FileFormatError
from rsdeblur.video._av import av


class Colours(NamedTuple):
    """What FFmpeg calls range, space (the matrix of YCbCr), primaries and transfer characteristic, as its numbers."""

    range: int
    space: int
    primaries: int
    transfer: int


@dataclass(frozen=True, slots=True)
class Clip:
    """A video's first picture stream.

    Parameters
    ----------
    path : Path
        The file.
    width, height : int
        Of the frames as stored, px.
    stamps : tuple of int
        When each frame is shown, in units of `time_base`, increasing.
    end : int
        When the last one's time is over.
    keys : tuple of int
        Those among `stamps` at which decoding can start.
    time_base : Fraction
        In s.
    codec, pixels : str
        FFmpeg's names of the codec and of the pixel format.
    rate : Fraction
        Mean number of frames per second.
    colours : Colours
        Tags of the stream.
    matrix : tuple of 9 int, or None
        How players turn the frames, as FFmpeg's display matrix.
    """

    path: Path
    width: int
    height: int
    stamps: tuple[int, ...]
    end: int
    keys: tuple[int, ...]
    time_base: Fraction
    codec: str
    pixels: str
    rate: Fraction
    colours: Colours
    matrix: tuple[int, ...] | None

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def times(self) -> list[float]:
        """When each frame is shown, in s after the first one."""
        return [float((stamp - self.stamps[0]) * self.time_base) for stamp in self.stamps]


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a video for reading; what FFmpeg cannot read is refused.

    Raises
    ------
    FileFormatError
        Naming the file.
    """
    try:
        with av.open(os.fspath(path)) as container:
            yield container
    except av.error.FFmpegError as error:
        raise FileFormatError(f"{path}: cannot read the video: {error.strerror}") from error


def open_clip(path: str | os.PathLike[str]) -> Clip:
    """Read what a video is; all of the file is looked through, but only its first frame decoded.

    Raises
    ------
    FileFormatError
        If the file is no video, has no picture stream, or its frames have no stamps.
    """
    path = Path(path)
    with opened(path) as container:
        if not container.streams.video:
            raise FileFormatError(f"{path}: there are no pictures in the file")
        stream = container.streams.video[0]
        shown, keys, end = set(), set(), 0
        for packet in container.demux(stream):
            if not packet.size or packet.is_discard:
                continue
            if packet.pts is None:
                raise FileFormatError(f"{path}: its frames have no stamps; convert it to MP4 or Matroska first")
            shown.add(packet.pts)
            end = max(end, packet.pts + max(packet.duration or 0, 1))
            if packet.is_keyframe:
                keys.add(packet.pts)
        if not shown:
            raise FileFormatError(f"{path}: there are no frames in the video")
        container.seek(min(shown), stream=stream)
        first = next(container.decode(stream))
        context = stream.codec_context
        return Clip(
            path=path,
            width=first.width,
            height=first.height,
            stamps=tuple(sorted(shown)),
            end=end,
            keys=tuple(sorted(keys)),
            time_base=stream.time_base,
            codec=context.name,
            pixels=first.format.name,
            rate=stream.average_rate or Fraction(30),
            colours=Colours(
                *map(int, (first.color_range, first.colorspace, context.color_primaries, context.color_trc))
            ),
            matrix=_display_matrix(first),
        )


def _display_matrix(frame: Any) -> tuple[int, ...] | None:
    for data in frame.side_data:
        if data.type.name == "DISPLAYMATRIX":
            return struct.unpack("9i", bytes(data))
    return None


def frames(clip: Clip, first: int, stop: int) -> Iterator[Any]:
    """Decode the frames from number `first` to before `stop`.

    Raises
    ------
    FileFormatError
        If a frame cannot be decoded.
    """
    wanted = set(clip.stamps[first:stop])
    with opened(clip.path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        # From one key frame earlier than needed: frames shown before a key frame may refer to what was before it.
        earlier = [key for key in clip.keys if key <= clip.stamps[first]][-2:]
        container.seek(min(earlier, default=clip.stamps[0]), stream=stream)
        for frame in container.decode(stream):
            if frame.pts in wanted:
                wanted.remove(frame.pts)
                yield frame
            if not wanted:
                return
    raise FileFormatError(f"{clip.path}: {len(wanted)} of frames {first} to {stop - 1} cannot be decoded")
