"""Gyro data in exports of several sensors: zip archives, and Sensor Logger's JSON."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from rsdeblur.errors import FileFormatError
from rsdeblur.io.samples import Samples
from rsdeblur.io.source import Format, Source, unpacked_limit

SUFFIXES = (".csv", ".json", ".txt", ".gcsv", ".tsv")

# What reports say of a Sensor Logger export.
FACTS = ("device name", "platform", "appVersion")

# Errors that `zipfile` raises on damaged or encrypted archives.
DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError, OSError),
    *(ValueError, LookupError, struct.error),
)


def gyro_first(name: str) -> tuple[bool, bool, str]:
    """Sort key of file names that puts gyro files first, and those with a bias after the others."""
    stem = Path(name).stem.lower()
    return "gyro" not in stem, "uncalibrated" in stem, name


def several(archive: Path, what: str, members: list[Source]) -> FileFormatError:
    """Return the error for an archive of which two members may be meant."""
    first, second = (each.path.relative_to(archive).as_posix() for each in members[:2])
    return FileFormatError(
        f"{archive}: the archive contains more than one {what}, {first} and {second}; extract the one of your photo or "
        "video, and give that"
    )


def is_archive(source: Source) -> bool:
    """Whether the file is a zip archive."""
    return source.head.startswith((b"PK\x03\x04", b"PK\x05\x06"))


def members_of(source: Source, order: Callable[[str], tuple[bool, bool, str]] = gyro_first) -> list[Source]:
    """Return the text files of a zip archive, in the order of this key; any other file is returned alone."""
    if not is_archive(source):
        return [source]
    try:
        with zipfile.ZipFile(BytesIO(source.data)) as archive:
            entries = [
                entry
                for entry in archive.infolist()
                if entry.filename.lower().endswith(SUFFIXES) and "__MACOSX" not in entry.filename
            ]
            size, limit = sum(entry.file_size for entry in entries), unpacked_limit(len(source.data))
            if size > limit:
                raise source.error(
                    f"the archive claims to contain {size} bytes of text, the limit is {limit}; "
                    "extract it and give the gyro's file"
                )
            entries.sort(key=lambda entry: order(entry.filename))
            members = [_member(source, archive, entry) for entry in entries]
    except FileFormatError:
        raise
    except DAMAGE as error:
        raise source.error(f"the archive is damaged or encrypted: {error}") from error
    if not members:
        # A spreadsheet is an archive, too.
        sheet = b"[Content_Types].xml" in source.head or b"mimetypeapplication/vnd.oasis" in source.head
        raise source.error("a spreadsheet; save it as CSV" if sheet else f"the archive contains no {source.what}")
    return members


def _member(source: Source, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Source:
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise source.error(
            f"{entry.filename!r} is compressed by a method other than deflate; extract it and give the gyro's file"
        )
    with archive.open(entry) as file:
        # A damaged member may unpack to more than its entry claims; the rest is not read.
        content = file.read(entry.file_size)
    # Joined as text: an absolute name that is joined as a path would replace the archive's path.
    return Source(f"{source.path}/{entry.filename}", source.what, content)


def facts_beside(members: list[Source]) -> dict[str, Any]:
    """Return device and app from Sensor Logger's `Metadata.csv`; empty if it is not among the files."""
    for member in members:
        if member.path.name.lower() == "metadata.csv" and member.looks_like_text:
            lines = member.text.lines[:2]
            if len(lines) == 2:
                table = dict(zip(lines[0].strip().split(","), lines[1].strip().split(","), strict=False))
                return {key: table[key] for key in FACTS if table.get(key)}
    return {}


def is_sensorlogger_json(source: Source) -> bool:
    """Whether the file is a JSON export of Sensor Logger."""
    # Searching the start for the key avoids parsing large JSON files of other kinds.
    if not source.looks_like_json or b'"sensor"' not in source.head:
        return False
    return isinstance(source.json, list)


def read_sensorlogger_json(source: Source, sensors: tuple[str, ...], unit: str) -> Samples:
    """Read the first of `sensors` that a JSON export of Sensor Logger contains."""
    entries = source.json
    if not isinstance(entries, list):
        raise source.error("not a Sensor Logger export: expected a list of samples")
    by_sensor: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        if isinstance(entry, dict):
            by_sensor.setdefault(str(entry.get("sensor")), []).append(entry)
    sensor = next((name for name in sensors if name in by_sensor), None)
    if sensor is None:
        raise source.error(
            f"the file contains no samples of the {sensors[0].lower()}, only of {', '.join(sorted(by_sensor))[:200]}"
        )
    readings = by_sensor[sensor]
    try:
        ns = np.array([int(entry["time"]) for entry in readings], dtype=np.int64)
        values = np.array([[float(entry[axis]) for axis in "xyz"] for entry in readings])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise source.error(f"a sample of {sensor} lacks a number: {error!r}") from error
    if not np.isfinite(values).all():
        raise source.error(f"sample {np.argwhere(~np.isfinite(values))[0][0]} of {sensor} is not finite")
    device = next(iter(by_sensor.get("Metadata", [])), {})
    facts = {"sensor": sensor} | {key: device[key] for key in FACTS if key in device}
    return Samples(
        ns, values, lambda message, i: source.error(f"sample {i} of {sensor}: {message}"), unit=unit, facts=facts
    )


FORMATS: tuple[Format[Samples], ...] = (
    Format(
        "sensorlogger-json",
        "Sensor Logger JSON export",
        is_sensorlogger_json,
        lambda source: read_sensorlogger_json(source, ("Gyroscope", "GyroscopeUncalibrated"), "rad/s"),
    ),
)
