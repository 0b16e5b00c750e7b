"""Folders of loggers: find the gyro log, the capture file, and the exposure of each photo."""

import re
import zipfile
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsdeblur.choices import BATCH, SHARP
from rsdeblur.errors import FileFormatError
from rsdeblur.io.captures import open_captures
from rsdeblur.io.formats import entries_of
from rsdeblur.io.gyro_logs import detect_gyro_format
from rsdeblur.io.picture_output import KINDS
from rsdeblur.io.source import Source

PHOTOS = (*KINDS, ".heic", ".dng")


@dataclass(frozen=True, slots=True)
class SessionPhoto:
    """A photo of a session: index of its exposure in the capture file, or the reason why that is unknown."""

    path: Path
    index: int | None
    error: str | None = None


def unpacked(archive: Path, folder: Path) -> Path:
    """Unpack a session's zip archive below `folder` and return its folder; existing files of that size are kept."""
    target, source = folder / archive.stem, Source(archive, "archive")
    with source.parsing(f"unpacking it into {target}"), zipfile.ZipFile(archive) as opened:
        entries = entries_of(source, opened)
        for each in entries:
            place = target / each.filename
            if not place.is_file() or place.stat().st_size != each.file_size:
                opened.extract(each, target)  # names that lead out of the folder are changed there
    tops = {Path(each.filename).parts[0] for each in entries}
    # Some archives contain a folder with all files.
    (top,) = tops if len(tops) == 1 else (".",)
    return target / top if (target / top).is_dir() else target


def files_in(folder: Path, *, without: Path | None = None) -> list[Path]:
    """Return the files of a folder and its subfolders, sorted, but not of `without` and of folders with results."""
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
        raise FileFormatError(f"{folder}: no photo in the folder; rsdeblur video or triage take a video itself")
    return photos


def gyro_log_in(folder: Path, files: list[Path]) -> Path:
    """Return the gyro log among the files of a folder; `FileFormatError` if it is missing."""
    # Accelerometer and magnetometer are logged in the same format, so the name has to decide.
    named = [path for word in ("gyro", "imu") for path in _tables(files) if word in path.name.lower()]
    for path in named:
        with suppress(FileFormatError):
            detect_gyro_format(path)
            return path
    raise FileFormatError(f"{folder}: no gyro log in the folder (a .csv or .txt named like gyro or imu); give --gyro")


def _tables(files: list[Path]) -> list[Path]:
    return [path for path in files if path.suffix.lower() in (".csv", ".txt")]


def capture_file_in(files: list[Path]) -> Path | None:
    """Return the likeliest capture file among the files of a folder; None if there is none."""
    found = []
    for path in _tables(files):
        with suppress(FileFormatError):
            # First a file with all exposure times, then one named after its timestamps: flashes are logged like frames.
            found.append((None in open_captures(path).durations, "timestamps" not in path.name.lower(), path))
    return min(found)[2] if found else None


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


def indices_of(
    photos: list[Path], capture: Path, *, numbered_from: int | None = None, columns: str | None = None
) -> list[SessionPhoto]:
    """Return the exposure of each photo in a capture file, by the timestamps or frame numbers in the photos' names.

    A name that ends in a timestamp in ns, as OpenCamera Sensors writes it, selects the nearest capture. A name that
    ends in a frame number selects that line of the list of encoded frames (MARS logger's ``frame_timestamps.txt``) if
    there is one, else of the captures.
    """
    timestamps = open_captures(capture, columns).timestamps
    frames = encoded_timestamps(capture) or timestamps
    numbers = {path: int(digits[-1]) for path in photos if (digits := re.findall(r"\d+", path.stem))}
    # A smaller number is a frame number, a larger one a timestamp in ns.
    least_timestamp = 10**9
    counted = {number for number in numbers.values() if number < least_timestamp}
    if numbered_from is None:
        numbered_from = 0 if 0 in counted else 1 if len(frames) in counted else None

    def time_of(path: Path) -> int | str:
        """Return the timestamp of a photo, or the reason why it is unknown."""
        if path not in numbers:
            return "its name contains neither a timestamp nor a frame number"
        if (number := numbers[path]) >= least_timestamp:
            return number
        if numbered_from is None:
            return "is the first frame number 0 or 1? give --numbered-from 0 or 1"
        if not 0 <= number - numbered_from < len(frames):
            return f"there is no frame {number}; the frames are {numbered_from} to {numbered_from + len(frames) - 1}"
        return frames[number - numbered_from]

    # ns; 0.1 s where there is one capture only.
    interval = float(np.median(np.diff([time - timestamps[0] for time in timestamps]))) if len(timestamps) > 1 else 1e8
    matched = []
    for path in photos:
        if isinstance(time := time_of(path), str):
            matched.append(SessionPhoto(path, None, time))
            continue
        (nearest,) = nearest_captures(timestamps, [time])
        distance = abs(time - timestamps[nearest])
        # MARS logger cuts timestamps to us.
        error = f"the nearest capture is {1e-6 * distance:.1f} ms away" if distance > 0.5 * interval else None
        matched.append(SessionPhoto(path, None if error else nearest, error))
    return matched
