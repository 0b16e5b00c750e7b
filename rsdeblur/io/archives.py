"""Gyro data that an app exports as one file of several sensors: zip archives, and Sensor Logger's JSON."""

from __future__ import annotations

import zipfile
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from rsdeblur.io.formats import Format
from rsdeblur.io.samples import Samples
from rsdeblur.io.source import Source

# A day of text at 8 kHz; a member that claims more is a bomb.
MEMBER_LIMIT = 2**33


def members_of(source: Source) -> list[Source]:
    """Return the files in a zip archive, a phone's gyro first; just the file itself if it is none.

    Raises
    ------
    FileFormatError
        If the archive is damaged, encrypted or empty.
    """
    if not source.head.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        return [source]
    try:
        with zipfile.ZipFile(BytesIO(source.data)) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir() and "__MACOSX" not in entry.filename]
            if any(entry.file_size > MEMBER_LIMIT for entry in entries):
                raise source.error("a file of the archive claims more than 8 GB")
            members = [
                Source(source.path / entry.filename, source.what, archive.read(entry))
                for entry in sorted(entries, key=lambda entry: _preference(entry.filename))
                if Path(entry.filename).suffix.lower() in (".csv", ".json", ".txt", ".gcsv", ".tsv")
            ]
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError, OSError) as error:
        raise source.error(f"the archive is damaged or encrypted: {error}") from error
    if not members:
        raise source.error(f"the archive holds no {source.what}")
    return members


def _preference(name: str) -> tuple[bool, bool, str]:
    stem = Path(name).stem.lower()
    return "gyro" not in stem, "uncalibrated" in stem, name


def facts_beside(members: list[Source]) -> dict[str, Any]:
    """Return what Sensor Logger's `Metadata.csv`, if it is among the files, says of the device."""
    for member in members:
        if member.path.name.lower() == "metadata.csv" and member.looks_like_text:
            lines = member.text.lines[:2]
            if len(lines) == 2:
                table = dict(zip(lines[0].strip().split(","), lines[1].strip().split(","), strict=False))
                return {key: table[key] for key in ("device name", "platform", "appVersion") if table.get(key)}
    return {}


def _sniff_json(source: Source) -> bool:
    # Looking for the name first spares parsing large files of other kinds.
    if not source.looks_like_json or b'"sensor"' not in source.head:
        return False
    return isinstance(source.json, list)


def _read_json(source: Source) -> Samples:
    entries = source.json
    if not isinstance(entries, list):
        raise source.error("not a Sensor Logger export: a list of samples expected")
    by_sensor: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        if isinstance(entry, dict):
            by_sensor.setdefault(str(entry.get("sensor")), []).append(entry)
    sensor = next((name for name in ("Gyroscope", "GyroscopeUncalibrated") if name in by_sensor), None)
    if sensor is None:
        raise source.error(f"the file holds no samples of the gyroscope, only of {', '.join(sorted(by_sensor))[:200]}")
    chosen = by_sensor[sensor]
    try:
        ns = np.array([int(entry["time"]) for entry in chosen], dtype=np.int64)
        rates = np.array([[float(entry[axis]) for axis in "xyz"] for entry in chosen])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise source.error(f"a sample of {sensor} lacks a number: {error!r}") from error
    if not np.isfinite(rates).all():
        raise source.error(f"sample {np.argwhere(~np.isfinite(rates))[0][0]} of {sensor} is not finite")
    device = next((entry for entry in by_sensor.get("Metadata", [])), {})
    facts = {"sensor": sensor} | {
        key: device[key] for key in ("device name", "platform", "appVersion") if key in device
    }
    return Samples(ns, rates, lambda message, i: source.error(f"sample {i} of {sensor}: {message}"), facts=facts)


FORMATS: tuple[Format[Samples], ...] = (
    Format("sensorlogger-json", "Sensor Logger JSON export", _sniff_json, _read_json),
)
