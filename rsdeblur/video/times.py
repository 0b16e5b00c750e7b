"""Exposures of the frames of a video, from its own timestamps or from a capture file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from rsdeblur._util.files import checked_path
from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io.captures import open_captures
from rsdeblur.io.sessions import encoded_timestamps, nearest_captures
from rsdeblur.motion.exposure import Exposure
from rsdeblur.video.clip import Clip

# The timestamps of the video and of the logger may differ by this fraction of the frame interval without a warning.
NEAR = 0.5


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

    Returns
    -------
    list of Exposure
        One for each frame.

    Raises
    ------
    InputError
        If the number of exposure times is not that of the frames.
    """
    durations = list(duration) if isinstance(duration, Iterable) else [duration] * len(clip)
    if len(durations) != len(clip):
        raise InputError(f"{clip.path}: {len(clip)} frames, but {len(durations)} exposure times")
    return [Exposure(start + time, each, epoch_ns) for time, each in zip(clip.times, durations, strict=True)]


def exposures_from_captures(
    clip: Clip, path: str | os.PathLike[str], *, duration: float | None = None
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

    Returns
    -------
    list of Exposure
        One for each frame.

    Raises
    ------
    FileFormatError
        If the file lists fewer frames than the video has.
    InputError
        If neither the file nor `duration` gives the exposure time.
    """
    path = checked_path(path)
    file = open_captures(path)
    encoded = encoded_timestamps(path)
    timestamps = file.timestamps if encoded is None else encoded
    if len(timestamps) < len(clip):
        raise FileFormatError(
            f"{path}: the file lists {len(timestamps)} frames, but {clip.path} has {len(clip)}; give that of this video"
        )
    _compare(clip, path, timestamps)
    exposures = []
    for timestamp, index in zip(
        timestamps[: len(clip)], nearest_captures(file.timestamps, timestamps[: len(clip)]), strict=True
    ):
        time = file.durations[index] if duration is None else duration
        if time is None:
            raise InputError(
                f"{path}: the file contains timestamps without exposure times; give the exposure time (--duration)"
            )
        exposures.append(Exposure(0.0, time, timestamp if encoded is None else file.timestamps[index]))
    return exposures


def _compare(clip: Clip, path: Path, timestamps: list[int]) -> None:
    """Warn if the timestamps of the file and of the video do not seem to belong to the same frames."""
    listed = 1e-9 * np.array([timestamp - timestamps[0] for timestamp in timestamps[: len(clip)]], dtype=np.float64)
    shown = np.array(clip.times)
    interval = float(np.median(np.diff(shown))) if len(shown) > 1 else np.inf
    difference = float(np.abs(listed - shown).max())
    if len(timestamps) > len(clip) or difference > NEAR * interval:
        warnings.warn(
            f"{path}: the file lists {len(timestamps)} frames, {clip.path} has {len(clip)}, and their timestamps "
            f"differ by up to {1e3 * difference:.1f} ms; the first {len(clip)} are used in order",
            RsdeblurWarning,
            stacklevel=3,
        )
