"""Folders of loggers: find the gyro log, the capture file, and the exposure of each photo."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsdeblur.choices import BATCH, SHARP
from rsdeblur.errors import FileFormatError
from rsdeblur.io.captures import CaptureFile, open_captures
from rsdeblur.io.gyro_logs import detect_gyro_format
from rsdeblur.io.picture_output import KINDS
from rsdeblur.types import FloatArray

# Accelerometer and magnetometer are logged in the same format, so the name has to decide.
LOG_NAMES = ("gyro", "imu")
TABLES = (".csv", ".txt")
PHOTOS = (*KINDS, ".heic", ".dng")
# A number in a photo's name is a timestamp in ns from here on; a smaller one is a frame number.
LEAST_TIMESTAMP = 10**9
# Largest distance of a photo's timestamp from its capture, in intervals between captures: MARS logger cuts them to us.
NEAR = 0.5
LONE_INTERVAL = 1e8  # ns, assumed where there is one capture only
UNNUMBERED = "its name contains neither a timestamp nor a frame number"


@dataclass(frozen=True, slots=True)
class SessionPhoto:
    """A photo of a session: index of its exposure in the capture file, or the reason why that is unknown."""

    path: Path
    index: int | None
    error: str | None = None


@dataclass(frozen=True, slots=True)
class Session:
    """Contents of a logger's folder.

    Parameters
    ----------
    gyro, capture : Path
        The gyro log, and the file of the exposures or at least of their timestamps.
    camera : Path or None
        The camera file, if the folder contains exactly one.
    photos : list of SessionPhoto
        The photos, sorted by name.
    """

    gyro: Path
    capture: Path
    camera: Path | None
    photos: list[SessionPhoto]


def open_session(
    folder: str | os.PathLike[str],
    *,
    gyro: Path | None = None,
    capture: Path | None = None,
    numbered_from: int | None = None,
    without: Path | None = None,
) -> Session:
    """Find log, captures, camera and photos in a folder of MARS logger, OpenCamera Sensors or DeepGyro.

    Photos are in the folder or in its subfolders. A name that ends in a timestamp in ns, as OpenCamera Sensors writes
    it, selects the nearest capture. A name that ends in a frame number selects that line of the list of encoded frames
    (MARS logger's ``frame_timestamps.txt``) if there is one, else of the captures.
    """
    folder = Path(folder)
    files = files_in(folder, without=without)
    gyro = gyro or gyro_log_in(folder, files)
    if capture is None:
        capture, file = _captures(folder, [path for path in files if path != gyro])
    else:
        file = open_captures(capture)
    photos = photos_in(folder, files)
    matched = _matched(photos, file.timestamps, encoded_timestamps(capture), numbered_from)
    if all(photo.error == UNNUMBERED for photo in matched):
        raise FileFormatError(
            f"{folder}: the names of the {len(photos)} photos contain neither timestamps nor frame numbers, so their "
            "exposures are unknown; list them in a manifest with the columns photo,index, or give --start exif"
        )
    return Session(gyro, capture, camera_in(files), matched)


def files_in(folder: Path, *, without: Path | None = None) -> list[Path]:
    """Return the files of a folder and of its subfolders, sorted.

    Files of the subfolder `without` and those of subfolders with results of a batch are left out.
    """
    results = {path.parent for path in folder.glob(f"*/{BATCH}")} | {without} - {folder}
    files = sorted([*folder.glob("*"), *folder.glob("*/*")])
    return [path for path in files if path.is_file() and path.parent not in results]


def camera_in(files: list[Path]) -> Path | None:
    """Return the camera file among the files of a folder; None if there is none, or more than one."""
    cameras = [path for path in files if path.suffix.lower() == ".toml"]
    return cameras[0] if len(cameras) == 1 else None


def photos_in(folder: Path, files: list[Path]) -> list[Path]:
    """Return the photos among the files of a folder, without results beside them; `FileFormatError` without any."""
    photos = [path for path in files if path.suffix.lower() in PHOTOS]
    results = {path.with_name(f"{path.stem}{SHARP}") for path in photos}
    photos = [path for path in photos if path.with_suffix("") not in results]
    if not photos:
        raise FileFormatError(f"{folder}: no photo in the folder; save frames of the video there as pictures")
    return photos


def gyro_log_in(folder: Path, files: list[Path]) -> Path:
    """Return the gyro log among the files of a folder; `FileFormatError` if it is missing."""
    for word in LOG_NAMES:
        for path in files:
            if word in path.name.lower() and path.suffix.lower() in TABLES and _is_log(path):
                return path
    raise FileFormatError(f"{folder}: no gyro log in the folder (a .csv or .txt named like gyro or imu); give --gyro")


def _is_log(path: Path) -> bool:
    try:
        return bool(detect_gyro_format(path))
    except FileFormatError:
        return False


def _captures_in(path: Path) -> CaptureFile | None:
    try:
        return open_captures(path)
    except FileFormatError:
        return None


def _captures(folder: Path, files: list[Path]) -> tuple[Path, CaptureFile]:
    tables = [path for path in files if path.suffix.lower() in TABLES]
    candidates = [(path, file) for path in tables if (file := _captures_in(path)) is not None]
    if not candidates:
        raise FileFormatError(
            f"{folder}: no capture file in the folder (movie_metadata.csv, ..._timestamps.csv or images.txt); "
            "give --capture, or for the photos of a camera app: rsdeblur batch --start exif"
        )
    # First a file with all exposure times, then one named after its timestamps: flashes are logged like frames.
    return min(candidates, key=lambda pair: (None in pair[1].durations, "timestamps" not in pair[0].name.lower()))


def encoded_timestamps(capture: Path) -> list[int] | None:
    """Return the timestamps of MARS logger's video frames, ns, perhaps fewer than captures; None without a list."""
    path = capture.with_name("frame_timestamps.txt")
    return open_captures(path).timestamps if path.is_file() and path != capture else None


def nearest_captures(timestamps: list[int], times: Iterable[int]) -> list[int]:
    """Return for each of `times` the index of the nearest of increasing `timestamps`, all in ns."""
    # Relative to the first timestamp, float64 represents them exactly.
    captures, targets = (
        np.array([t - timestamps[0] for t in group], dtype=np.float64) for group in (timestamps, times)
    )
    middles = 0.5 * (captures[1:] + captures[:-1])
    places: list[int] = np.searchsorted(middles, targets).tolist()
    return places


def _matched(
    photos: Iterable[Path], timestamps: list[int], encoded: list[int] | None, numbered_from: int | None
) -> list[SessionPhoto]:
    # Relative to the first timestamp, float64 represents them exactly.
    origin = timestamps[0]
    captures = np.array([timestamp - origin for timestamp in timestamps], dtype=np.float64)
    frames = timestamps if encoded is None else encoded
    numbers = {path: int(digits[-1]) for path in photos if (digits := re.findall(r"\d+", path.stem))}
    counted = {number for number in numbers.values() if number < LEAST_TIMESTAMP}
    if numbered_from is None:
        numbered_from = 0 if 0 in counted else 1 if len(frames) in counted else None
    matched = []
    for path in photos:
        number = numbers.get(path)
        if number is None:
            matched.append(SessionPhoto(path, None, UNNUMBERED))
        elif number >= LEAST_TIMESTAMP:
            matched.append(_nearest(path, number - origin, captures))
        elif numbered_from is None:
            matched.append(SessionPhoto(path, None, "is the first frame number 0 or 1? give --numbered-from 0 or 1"))
        elif not 0 <= number - numbered_from < len(frames):
            last = numbered_from + len(frames) - 1
            matched.append(
                SessionPhoto(path, None, f"there is no frame {number}; the frames are {numbered_from} to {last}")
            )
        else:
            matched.append(_nearest(path, frames[number - numbered_from] - origin, captures))
    return matched


def indices_of(photos: list[Path], capture: Path, *, numbered_from: int | None = None) -> list[SessionPhoto]:
    """Return the exposure of each photo in a capture file, by the timestamps or frame numbers in the photos' names."""
    return _matched(photos, open_captures(capture).timestamps, encoded_timestamps(capture), numbered_from)


def _nearest(path: Path, time: int, captures: FloatArray) -> SessionPhoto:
    distance = np.abs(captures - time)
    index = int(distance.argmin())
    interval = float(np.median(np.diff(captures))) if len(captures) > 1 else LONE_INTERVAL
    if distance[index] > NEAR * interval:
        return SessionPhoto(path, None, f"the nearest capture is {1e-6 * distance[index]:.1f} ms away")
    return SessionPhoto(path, index)
