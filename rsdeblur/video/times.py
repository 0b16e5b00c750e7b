"""When each frame of a video was exposed."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from rsdeblur.errors import FileFormatError, InputError, RsdeblurWarning
from rsdeblur.io.captures import open_captures
from rsdeblur.io.sessions import encoded_stamps, nearest_captures
from rsdeblur.motion.exposure import Exposure
from rsdeblur.video.clip import Clip

# The video's own stamps and the logger's may differ by this part of the interval between frames before it is said.
NEAR = 0.5


def exposures_from_stamps(clip: Clip, duration: float, *, start: float = 0.0, epoch_ns: int = 0) -> list[Exposure]:
    """Return the exposures of all frames by the video's own stamps, be its rate constant or not.

    Parameters
    ----------
    clip : Clip
        The video.
    duration : float
        Exposure time in s, that of all frames.
    start, epoch_ns
        Stamp of the first frame, see :class:`rsdeblur.Exposure`.
    """
    return [Exposure(start + time, duration, epoch_ns) for time in clip.times]


def exposures_from_captures(clip: Clip, path: Path, *, duration: float | None = None) -> list[Exposure]:
    """Return the exposures of all frames by a logger's file, which has a line for each frame.

    MARS logger's ``movie_metadata.csv`` may have more: ``frame_timestamps.txt`` beside it tells which were encoded.

    Parameters
    ----------
    clip : Clip
        The video.
    path : Path
        The capture file.
    duration : float, optional
        Exposure time in s, replaces the file's.

    Raises
    ------
    FileFormatError
        If the file has fewer lines than the video frames.
    InputError
        If nothing tells the exposure time.
    """
    file = open_captures(path)
    encoded = encoded_stamps(path)
    stamps = file.stamps if encoded is None else encoded
    if len(stamps) < len(clip):
        raise FileFormatError(f"{path}: tells of {len(stamps)} frames, but {clip.path} has {len(clip)}")
    _compare(clip, path, stamps)
    exposures = []
    for stamp, index in zip(stamps[: len(clip)], nearest_captures(file.stamps, stamps[: len(clip)]), strict=True):
        time = file.durations[index] if duration is None else duration
        if time is None:
            raise InputError(
                f"{path}: the file contains stamps without exposure times; give the exposure time (--duration)"
            )
        exposures.append(Exposure(0.0, time, stamp if encoded is None else file.stamps[index]))
    return exposures


def _compare(clip: Clip, path: Path, stamps: list[int]) -> None:
    """Warn if the file's stamps and the video's are not those of the same frames."""
    told = 1e-9 * np.array([stamp - stamps[0] for stamp in stamps[: len(clip)]], dtype=np.float64)
    shown = np.array(clip.times)
    interval = float(np.median(np.diff(shown))) if len(shown) > 1 else np.inf
    apart = float(np.abs(told - shown).max())
    if len(stamps) > len(clip) or apart > NEAR * interval:
        warnings.warn(
            f"{path}: tells of {len(stamps)} frames, {clip.path} has {len(clip)}, and their stamps come apart by up to "
            f"{1e3 * apart:.1f} ms; the first {len(clip)} are taken in order",
            RsdeblurWarning,
            stacklevel=3,
        )
