"""Properties and frames of a video, and the exposures of its frames."""

import os
import struct
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.files import checked_path, ffmpeg_input, open_file
from rsdeblur._util.validate import missing
from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io.captures import open_captures
from rsdeblur.io.formats import mistaken
from rsdeblur.io.sessions import encoded_timestamps, nearest_captures
from rsdeblur.io.source import Source
from rsdeblur.motion.exposure import Exposure

try:
    import av as av
except ModuleNotFoundError:
    raise InputError(missing("videos need PyAV", "video")) from None

__all__ = ["Clip", "exposures_from_captures", "exposures_from_timestamps", "open_clip"]

# FFmpeg's default rounding would darken pictures by a level.
SCALING = av.video.reformatter.Interpolation.BICUBIC | av.video.reformatter.Interpolation.ACCURATE_RND
# 16 bits are enough for the RGB values of 8, 10 and 12 bits of YCbCr.
RGB = "rgb48le"
FULL_RANGE, LIMITED_RANGE = av.video.reformatter.ColorRange.JPEG, av.video.reformatter.ColorRange.MPEG


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
    time_base : Fraction
        Unit of the timestamps, s.
    codec, pixels : str
        FFmpeg's names of the codec and of the pixel format.
    transfer : int
        FFmpeg's number of the transfer characteristic.
    matrix : tuple of 9 int, or None
        How players turn the frames, as FFmpeg's display matrix.
    """

    path: Path
    width: int
    height: int
    timestamps: tuple[int, ...]
    end: int
    time_base: Fraction
    codec: str
    pixels: str
    transfer: int
    matrix: tuple[int, ...] | None

    def __len__(self) -> int:
        return len(self.timestamps)

    @property
    def times(self) -> list[float]:
        """Presentation times of the frames, s after the first one."""
        return [float((timestamp - self.timestamps[0]) * self.time_base) for timestamp in self.timestamps]


@contextmanager
def reading(path: Path) -> Iterator[Any]:
    """Open a video that is a regular file; FFmpeg's errors in the block become a `FileFormatError` that names it."""
    # FFmpeg would wait for the writer of a pipe.
    open_file(path, "video").close()
    try:
        with av.open(**ffmpeg_input(path)) as container:
            yield container
    except av.error.FFmpegError as error:
        reason = f"cannot read the video: {error.strerror}"
        if isinstance(error, av.error.ArgumentError):
            reason = "not a video in a container that is read; convert it to MP4, MOV, Matroska, WebM, AVI or MPEG-TS"
        raise mistaken(Source(path, "video")) or FileFormatError(f"{path}: {reason}") from error


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
        If the video is interlaced.
    """
    path = checked_path(path)
    with reading(path) as container:
        if not container.streams.video:
            raise FileFormatError(f"{path}: the file has no video stream")
        stream = container.streams.video[0]
        shown, end, first = set(), 0, None
        for packet in container.demux(stream):
            if first is None:
                first = next(iter(packet.decode()), None)
            if not packet.size or packet.is_discard:
                continue
            if packet.pts is None:
                raise FileFormatError(f"{path}: the frames have no timestamps; convert it to MP4 or Matroska first")
            shown.add(packet.pts)
            end = max(end, packet.pts + max(packet.duration or 0, 1))
        if first is None or not shown:
            raise FileFormatError(f"{path}: no frame of the video can be decoded")
        # PyAV 18 iterates over data, 19 over types.
        data = {each.type.name: each for each in (first.side_data[n] for n in range(len(first.side_data)))}
        if first.interlaced_frame:
            _warn(f"{path}: it is interlaced: its fields are deblurred as one frame and marked as progressive")
        return Clip(
            path=path,
            width=first.width,
            height=first.height,
            timestamps=tuple(sorted(shown)),
            end=end,
            time_base=stream.time_base,
            codec=stream.codec_context.name,
            pixels=first.format.name,
            transfer=int(stream.codec_context.color_trc),
            matrix=struct.unpack("9i", bytes(data["DISPLAYMATRIX"])) if "DISPLAYMATRIX" in data else None,
        )


def _warn(text: str) -> None:
    warnings.warn(text, RsdeblurWarning, stacklevel=3)


def frames(clip: Clip, first: int, stop: int) -> Iterator[Any]:
    """Decode the frames with the numbers `first` to `stop - 1`; raise `FileFormatError` if one cannot be decoded."""
    remaining, start = set(clip.timestamps[first:stop]), clip.timestamps[first]
    # From a second earlier, because frames shown before a key frame may refer to frames before it. Seeking in MPEG-TS
    # may end behind the place; then from the beginning.
    for place in (max(start - int(1 / clip.time_base), clip.timestamps[0]), None):
        with reading(clip.path) as container:
            stream = container.streams.video[0]
            stream.thread_type = "AUTO"
            if place is not None:
                container.seek(place, stream=stream)
            for frame in container.decode(stream):
                if start in remaining and place is not None and (frame.pts is None or frame.pts > start):
                    break
                if frame.pts in remaining:
                    remaining.remove(frame.pts)
                    yield frame
                if not remaining:
                    return
    raise FileFormatError(f"{clip.path}: {len(remaining)} of frames {first} to {stop - 1} cannot be decoded")


def values_of(frame: Any) -> NDArray[np.uint16]:
    """Return a frame of PyAV as RGB, shape (H, W, 3), decoded as its tags say; FFmpeg may refuse its colours."""
    # Frames without a tag have the limited range.
    own = frame.color_range or LIMITED_RANGE
    try:
        rgb = frame.reformat(format=RGB, src_color_range=own, dst_color_range=FULL_RANGE, interpolation=SCALING)
    except av.error.FFmpegError as error:
        raise InputError(
            f"frames of {frame.format.name} with FFmpeg's colour matrix {int(frame.colorspace)} cannot be converted to "
            f"RGB ({error.strerror}); convert the video first"
        ) from error
    values: NDArray[np.uint16] = rgb.to_ndarray()
    return values


def exposures_from_timestamps(
    clip: Clip, duration: float | Sequence[float], *, start: float = 0.0, epoch_ns: int = 0
) -> list[Exposure]:
    """Return the exposure of each frame from the video's own timestamps; the frame rate need not be constant.

    Parameters
    ----------
    clip : Clip
        The video.
    duration : float or sequence of float
        Exposure time in s, one for all frames or one for each.
    start, epoch_ns
        Timestamp of the first frame, see :class:`rsdeblur.Exposure`.
    """
    durations = duration if isinstance(duration, Iterable) else [duration] * len(clip)
    return [Exposure(start + time, each, epoch_ns) for time, each in zip(clip.times, durations, strict=False)]


def exposures_from_captures(
    clip: Clip, path: str | os.PathLike[str], *, duration: float | None = None, columns: str | None = None
) -> list[Exposure]:
    """Return the exposure of each frame from a logger's file with a line for each frame.

    MARS logger's ``movie_metadata.csv`` may list more frames than the video has. ``frame_timestamps.txt`` beside it
    lists those that were encoded.

    Parameters
    ----------
    clip : Clip
        The video.
    path : path-like
        The capture file.
    duration : float, optional
        Exposure time in s; replaces the file's.
    columns : str, optional
        Columns of the file, see :func:`rsdeblur.read_captures`.

    Raises
    ------
    FileFormatError
        If the file lists fewer frames than the video has.
    InputError
        If neither the file nor `duration` gives the exposure time.

    Warns
    -----
    RsdeblurWarning
        If the file lists more frames, or its times differ from those of the video by half a frame interval or more.
    """
    path = checked_path(path)
    file, count = open_captures(path, columns), len(clip)
    listed = encoded_timestamps(path) or file.timestamps
    if len(listed) < count:
        raise FileFormatError(
            f"{path}: the file lists {len(listed)} frames, but {clip.path} has {count}; give that of this video"
        )
    encoded = listed[:count]
    difference = np.abs(1e-9 * np.array([time - encoded[0] for time in encoded], np.float64) - clip.times).max()
    interval = np.median(np.diff(clip.times)) if count > 1 else np.inf
    if len(listed) > count or 2 * difference > interval:
        _warn(
            f"{path}: the file lists {len(listed)} frames, {clip.path} has {count}, and their timestamps differ by up "
            f"to {1e3 * difference:.1f} ms; the first {count} are used in order"
        )
    exposures = []
    for index in nearest_captures(file.timestamps, encoded):
        time = file.durations[index] if duration is None else duration
        if time is None:
            raise InputError(
                f"{path}: the file contains timestamps without exposure times; give the exposure time (--duration)"
            )
        exposures.append(Exposure(0.0, time, file.timestamps[index]))
    return exposures
