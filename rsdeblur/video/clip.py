"""Properties and frames of a video."""

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
    stamps : tuple of int
        Presentation times of the frames, in units of `time_base`, increasing.
    end : int
        End of the last frame, in the same units.
    keys : tuple of int
        Stamps of the frames at which decoding can start.
    time_base : Fraction
        Unit of the stamps, s.
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
        """Presentation times of the frames, s after the first one."""
        return [float((stamp - self.stamps[0]) * self.time_base) for stamp in self.stamps]


@contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open a video for reading.

    Parameters
    ----------
    path : Path
        The video.

    Raises
    ------
    FileFormatError
        If FFmpeg cannot read the file, now or later in the block.
    """
    try:
        with av.open(os.fspath(path)) as container:
            yield container
    except av.error.FFmpegError as error:
        raise FileFormatError(f"{path}: cannot read the video: {error.strerror}") from error


def open_clip(path: str | os.PathLike[str]) -> Clip:
    """Read the properties of a video; the whole file is scanned, but only its first frame is decoded.

    Parameters
    ----------
    path : path-like
        The video.

    Raises
    ------
    FileFormatError
        If the file is not a video, has no video stream, or its frames have no stamps.
    """
    path = Path(path)
    with opened(path) as container:
        if not container.streams.video:
            raise FileFormatError(f"{path}: the file has no video stream")
        stream = container.streams.video[0]
        shown, keys, end = set(), set(), 0
        for packet in container.demux(stream):
            if not packet.size or packet.is_discard:
                continue
            if packet.pts is None:
                raise FileFormatError(f"{path}: the frames have no stamps; convert it to MP4 or Matroska first")
            shown.add(packet.pts)
            end = max(end, packet.pts + max(packet.duration or 0, 1))
            if packet.is_keyframe:
                keys.add(packet.pts)
        if not shown:
            raise FileFormatError(f"{path}: the video has no frames")
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
    """Decode the frames with the numbers `first` to `stop - 1`.

    Parameters
    ----------
    clip : Clip
        The video.
    first, stop : int
        Numbers of the first frame and of the one after the last, from 0.

    Raises
    ------
    FileFormatError
        If a frame cannot be decoded.
    """
    remaining = set(clip.stamps[first:stop])
    with opened(clip.path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        # One key frame earlier than needed: frames shown before a key frame may refer to frames before it.
        earlier = [key for key in clip.keys if key <= clip.stamps[first]][-2:]
        container.seek(min(earlier, default=clip.stamps[0]), stream=stream)
        for frame in container.decode(stream):
            if frame.pts in remaining:
                remaining.remove(frame.pts)
                yield frame
            if not remaining:
                return
    raise FileFormatError(f"{clip.path}: {len(remaining)} of frames {first} to {stop - 1} cannot be decoded")
