"""Gyro data in exports of several sensors: zip archives, and Sensor Logger's JSON."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from rsdeblur.errors import FileFormatError
from rsdeblur.io.samples import GYRO, AnySensor, Samples
from rsdeblur.io.source import Format, Source, unpacked_limit

# What `zipfile` raises on damaged or encrypted archives.
DAMAGE = (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, OSError, ValueError, LookupError, struct.error)
# What reports say of a Sensor Logger export.
FACTS = ("device name", "platform", "appVersion")
# Its names of the sensors; its "Accelerometer" is without gravity.
GYROS = ("Gyroscope", "GyroscopeUncalibrated")
ACCELEROMETERS = ("TotalAcceleration", "AccelerometerUncalibrated", "Accelerometer")


def order(name: str, sensor: AnySensor) -> tuple[bool, bool, str]:
    """Sort key of file names: first a gyro without its bias, or an accelerometer with gravity, last other sensors."""
    stem = Path(name).stem.lower()
    if sensor is GYRO:
        return "gyro" not in stem, "uncalibrated" in stem, name
    return "totalacc" not in stem, "acc" not in stem, name


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


def members_of(source: Source, order: Callable[[str], tuple[bool, bool, str]]) -> list[Source]:
    """Return the text files of a zip archive, in the order of this key; any other file is returned alone."""
    if not is_archive(source):
        return [source]
    try:
        with zipfile.ZipFile(BytesIO(source.data)) as archive:
            entries = [
                entry
                for entry in archive.infolist()
                if entry.filename.lower().endswith((".csv", ".json", ".txt", ".gcsv", ".tsv"))
                and "__MACOSX" not in entry.filename
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


def _is_json(source: Source) -> bool:
    # Searching the start for the key avoids parsing large JSON files of other kinds.
    return source.looks_like_json and b'"sensor"' in source.head and isinstance(source.json, list)


def _read_json(source: Source, sensor: AnySensor) -> Samples:
    """Read the likeliest log of the sensor in a JSON export of Sensor Logger."""
    entries = source.json
    if not isinstance(entries, list):
        raise source.error("not a Sensor Logger export: expected a list of samples")
    by_sensor: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        if isinstance(entry, dict):
            by_sensor.setdefault(str(entry.get("sensor")), []).append(entry)
    names = GYROS if sensor is GYRO else ACCELEROMETERS
    name = next((each for each in names if each in by_sensor), None)
    if name is None:
        found = ", ".join(sorted(by_sensor))[:200]
        raise source.error(f"the file contains no samples of the {names[0].lower()}, only of {found}")
    readings = by_sensor[name]
    try:
        ns = np.array([int(entry["time"]) for entry in readings], dtype=np.int64)
        values = np.array([[float(entry[axis]) for axis in "xyz"] for entry in readings])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise source.error(f"a sample of {name} lacks a number: {error!r}") from error
    if not np.isfinite(values).all():
        raise source.error(f"sample {np.argwhere(~np.isfinite(values))[0][0]} of {name} is not finite")
    device = next(iter(by_sensor.get("Metadata", [])), {})
    facts = {"sensor": name} | {key: device[key] for key in FACTS if key in device}
    return Samples(
        ns, values, lambda message, i: source.error(f"sample {i} of {name}: {message}"), unit=sensor.unit, facts=facts
    )


def formats(sensor: AnySensor) -> tuple[Format[Samples], ...]:
    """Return the formats of a sensor's logs."""
    return (Format("sensorlogger-json", "Sensor Logger JSON export", _is_json, partial(_read_json, sensor=sensor)),)
