"""`rsdeblur info`: what files are and hold."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._output import print_json
from rsdeblur.errors import CoverageError, FileFormatError, RsdeblurWarning

if TYPE_CHECKING:
    from rsdeblur.exposure import Exposure

# EXIF tags: the block of camera settings, and the exposure time in it.
EXIF_IFD, EXPOSURE_TIME = 0x8769, 0x829A

# Of a long list, as of exposures or gaps, the text shows this many; JSON shows all.
SHOWN = 12

AXES = {
    "phone": "phone: x right, y up, z out of the screen",
    "gyroflow": "Gyroflow: x up, y left, z back",
    "sensor": "the sensor's own",
}

EXAMPLES = """\b
Examples:
  rsdeblur info gyro.csv phone.toml frames.csv photo.jpg
  rsdeblur info --gyro gyro.csv --camera phone.toml --capture frames.csv
"""


@click.command("info", epilog=EXAMPLES)
@click.argument("files", type=_options.PATH, nargs=-1)
@click.option("--gyro", type=_options.PATH, metavar="LOG", help="Gyro log, to check the exposures of --capture.")
@_options.log_options
@click.option("--camera", type=_options.PATH, metavar="TOML", help="Camera file, likewise.")
@click.option("--capture", type=_options.PATH, metavar="FILE", help="Metadata file that holds the exposures.")
@click.option("--time-offset", type=_options.SecondsType(), help="Camera time minus gyro time; replaces the camera's.")
@_options.json_option
def command(
    files: tuple[Path, ...],
    gyro: Path | None,
    camera: Path | None,
    capture: Path | None,
    time_offset: float | None,
    as_json: bool,
    **reading: str | None,
) -> None:
    """Say what FILES are and hold: gyro logs, camera files, capture files, pictures.

    With --gyro, --camera and --capture together: whether the log covers each exposure.
    """
    together = [gyro, camera, capture]
    if any(together) and not all(together):
        raise click.UsageError("--gyro, --camera and --capture are needed together", ctx=click.get_current_context())
    if not files and not any(together):
        raise click.UsageError("name a file, or --gyro, --camera and --capture", ctx=click.get_current_context())
    found = []
    for entry in _entries(files, gyro, camera, capture, time_offset, reading):
        found.append(entry)
        if not as_json:
            _print(entry)
    if as_json:
        print_json(found)
    reasons = [entry["reason"] for entry in found if "reason" in entry]
    if reasons:
        raise FileFormatError("; ".join(reasons))


def _entries(
    files: tuple[Path, ...],
    gyro: Path | None,
    camera: Path | None,
    capture: Path | None,
    time_offset: float | None,
    reading: dict[str, str | None],
) -> Iterator[dict[str, Any]]:
    for path in files:
        try:
            yield {"file": str(path)} | _description(path, reading)
        except FileFormatError as error:
            # The other files, of a folder perhaps, are told about nevertheless.
            yield {"file": str(path), "kind": "not understood", "reason": str(error)}
    if gyro and camera and capture:
        coverage = _coverage(gyro, camera, capture, time_offset, reading)
        yield {"file": str(gyro), "kind": f"coverage of {capture}", "exposures": coverage}


def _keywords(reading: dict[str, str | None]) -> dict[str, Any]:
    return {"format": reading["gyro_format"], "unit": reading["unit"], "orientation": reading["orientation"]}


def _description(path: Path, reading: dict[str, str | None]) -> dict[str, Any]:
    from rsdeblur.io.gyro_logs import detect_gyro_format
    from rsdeblur.io.pictures import KINDS

    if not path.is_file():
        raise FileFormatError(f"{path}: there is no such file")
    if path.suffix.lower() == ".toml":
        return _camera(path)
    if path.suffix.lower() in KINDS:
        return _picture(path)
    try:
        if reading["gyro_format"] is None:
            detect_gyro_format(path)
    except FileFormatError:
        try:
            return _captures(path)
        except FileFormatError as error:
            raise FileFormatError(f"{error}; nor is it a gyro log, a camera file or a picture") from error
    return _gyro(path, reading)


def _gyro(path: Path, reading: dict[str, str | None]) -> dict[str, Any]:
    import numpy as np

    from rsdeblur.io import open_gyro

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RsdeblurWarning)
        file = open_gyro(path, **_keywords(reading))
    log = file.log
    return {
        "kind": "gyro log",
        "format": file.format,
        "samples": len(log),
        "rate_hz": log.rate,
        "epoch_ns": log.epoch_ns,
        "span_s": list(log.span),
        "units_in_file": f"{file.time_unit}, {file.rate_unit}",
        "axes": AXES[file.axes],
        **file.facts,
        "gaps_s": log.gaps().tolist(),
        "rms_rad_s": np.sqrt(np.mean(log.omega**2, axis=0)).tolist(),
        "peak_rad_s": np.abs(log.omega).max(axis=0).tolist(),
        "remarks": [str(warning.message) for warning in caught],
    }


def _camera(path: Path) -> dict[str, Any]:
    from rsdeblur.io import read_camera

    camera = read_camera(path)
    return {
        "kind": "camera",
        "size_px": [camera.width, camera.height],
        "focal_px": list(camera.focal),
        "principal_px": list(camera.principal),
        "readout_s": camera.readout,
        "readout_direction": camera.readout_direction,
        "imu_to_camera": camera.imu_to_camera.tolist(),
        "time_offset_s": camera.time_offset,
    }


def _captures(path: Path) -> dict[str, Any]:
    from rsdeblur.io import read_captures

    captures = read_captures(path)
    return {"kind": "captures", "count": len(captures), "exposures": [_times(exposure) for exposure in captures]}


def _times(exposure: Exposure) -> dict[str, Any]:
    start_ns = exposure.epoch_ns + round(exposure.start * 1e9)
    return {"start_ns": start_ns, "duration_s": exposure.duration}


def _picture(path: Path) -> dict[str, Any]:
    from rsdeblur.io.pictures import read_picture

    picture = read_picture(path)
    height, width = picture.pixels.shape[:2]
    return {
        "kind": "picture",
        "size_px": [width, height],
        "channels": 1 if picture.pixels.ndim == 2 else picture.pixels.shape[2],
        "values": str(picture.pixels.dtype),
        "exif_exposure_s": _exif_exposure(picture.exif),
        "icc_profile": picture.icc_profile is not None,
    }


def _exif_exposure(block: bytes | None) -> float | None:
    from PIL import Image

    if block is None:
        return None
    exif = Image.Exif()
    exif.load(block)
    try:
        return float(exif.get_ifd(EXIF_IFD)[EXPOSURE_TIME])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        # Absent, or one of the many ways in which cameras write it wrongly.
        return None


def _coverage(
    gyro: Path, camera_file: Path, capture: Path, time_offset: float | None, reading: dict[str, str | None]
) -> list[dict[str, Any]]:
    from rsdeblur.io import read_camera, read_captures, read_gyro

    log, camera = read_gyro(gyro, **_keywords(reading)), read_camera(camera_file)
    if time_offset is not None:
        camera = replace(camera, time_offset=time_offset)
    report = []
    for exposure in read_captures(capture):
        opens, closes = exposure.span(camera)
        try:
            log.covering(opens - camera.time_offset, closes - camera.time_offset, exposure.epoch_ns)
            state = "covered"
        except CoverageError as error:
            state = str(error)
        report.append(_times(exposure) | {"coverage": state})
    return report


def _print(entry: dict[str, Any]) -> None:
    click.echo(f"{entry['file']}: {entry['kind']}")
    for key, value in entry.items():
        if key in ("file", "kind", "reason") or value in ([], None):
            continue
        if isinstance(value, list) and isinstance(value[0], (dict, list, str)):
            click.echo(f"  {key}:")
            for i, item in enumerate(value[:SHOWN]):
                click.echo(f"    {i}: {_cell(item)}")
            if len(value) > SHOWN:
                click.echo(f"    ... {len(value) - SHOWN} more, see --json")
        else:
            click.echo(f"  {key}: {_cell(value)}")


def _cell(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_cell(item)}" for key, item in value.items())
    if isinstance(value, list):
        return "  ".join(map(_cell, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)
