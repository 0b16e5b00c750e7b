"""Gyro data inside pictures and videos: the GYRODATA trailer of a JPEG, and telemetry tracks."""

import contextlib
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from rsdeblur._util.validate import missing
from rsdeblur.errors import FileFormatError
from rsdeblur.io._sensor import AVIF_BRANDS, BRANDS
from rsdeblur.io.formats import Format
from rsdeblur.io.samples import GYRO, AnySensor, Samples, vectors
from rsdeblur.io.source import Source

# Four-character codes of GoPro that telemetry-parser does not name: readout time (ms), electronic stabilisation.
GOPRO_READOUT, GOPRO_STABILISED, GOPRO_STABILISER = "0x53524f54", "0x45495345", "0x45495341"
# The diagonal field of view in degrees (ZFOV).
GOPRO_VIEW = "0x5a464f56"


SAMPLE = np.dtype([("ns", "<i8"), ("rates", "<f4", 3), ("extra", "<i4")])
# The last 16 KiB of the file: a header, then a ring of samples, the oldest at `oldest`.
TRAILER = np.dtype(
    [
        *(("mark", "S16"), ("capture_ns", "<i8"), ("total", "<u4"), ("oldest", "<u4"), ("command_ns", "<i8")),
        ("ring", SAMPLE, 681),
    ]
)


def trailer_of(source: Source) -> Any:
    """Return the GYRODATA trailer of a JPEG as a `TRAILER`; None if the file has none."""
    end = source.data[-TRAILER.itemsize :] if source.head.startswith(b"\xff\xd8") else b""
    return np.frombuffer(end, TRAILER)[0] if len(end) == TRAILER.itemsize and end.startswith(b"GYRODATA\0") else None


def _read_trailer(source: Source, _: AnySensor) -> Samples:
    trailer = trailer_of(source)
    ordered = np.roll(trailer["ring"][: trailer["total"]], -int(trailer["oldest"]))
    # Unused places of a ring that never filled up contain zeros.
    used = ordered[ordered["ns"] > 0]
    return Samples(
        source.path,
        used["ns"].astype(np.int64),
        used["rates"].astype(np.float64),
        facts={"capture_ns": int(trailer["capture_ns"]), "shutter_command_ns": int(trailer["command_ns"])},
    )


def is_video(source: Source) -> bool:
    """Whether the file is a video of a kind that may contain telemetry."""
    # MP4 and related formats, Blackmagic's included, begin with a box of one of these names; RED's files with RE. HEIC
    # and AVIF pictures begin like MP4.
    head = source.head
    if head[4:8] == b"ftyp":
        return head[8:12] not in (*BRANDS, *AVIF_BRANDS)
    return head[4:8] in (b"moov", b"mdat", b"wide", b"skip", b"free") or head[4:6] == b"RE"


Blocks = list[Mapping[str, Any]]


def telemetry_of(source: Source) -> tuple[str, Blocks, Blocks]:
    """Return the camera of a video, all blocks of its telemetry, of about a second, and the samples of the IMU."""
    try:
        import telemetry_parser
    except ModuleNotFoundError:
        raise source.error(missing("reading the gyro data of a video needs telemetry-parser", "telemetry")) from None
    try:
        parser = telemetry_parser.Parser(str(source.path))
        blocks, samples = parser.telemetry(human_readable=False), parser.normalized_imu()
    except (OSError, ValueError, RuntimeError) as error:
        raise source.error(
            f"the video contains no gyro data that telemetry-parser can read: {error}; phones write none into their "
            "videos, a logger app writes a log"
        ) from error
    except BaseException as error:
        # Its native code panics on some damaged files; the exception for that derives from BaseException only.
        if type(error).__name__ != "PanicException":
            raise
        raise source.error(f"the video is damaged: {error}") from error
    return f"{parser.camera or 'camera'} {parser.model or ''}".strip(), blocks, samples


def frame_exposures(path: str | os.PathLike[str]) -> list[float]:
    """Return the exposure times of the frames of a video in s; none if they are missing or damaged."""
    source = Source(path, "video")
    camera, blocks, _ = telemetry_of(source) if is_video(source) else ("", [], [])
    exposures = [entry for block in blocks for entry in block.get("Exposure", {}).get("Data", [])]
    if camera.startswith("Insta360"):
        # Pairs, as KanDao's, whose unit nothing public documents. `t` counts from the first frame of the video; the
        # camera measures before it starts to record. `v` is in s.
        exposures = [entry["v"] for entry in exposures if entry["t"] is not None and entry["t"] >= 0]
    return exposures if all(isinstance(seconds, float) and 0 < seconds < np.inf for seconds in exposures) else []


def _read_video(source: Source, sensor: AnySensor) -> Samples:
    camera, blocks, samples = telemetry_of(source)
    times, values = vectors(samples, "gyro")
    if not len(times):
        raise source.error(f"the video of this {camera} has no gyro samples")
    if sensor is not GYRO:
        _, values = vectors(samples, "accl")
        if not len(values) or len(times) < 2:
            raise source.error(f"the video of this {camera} has no samples of an accelerometer")
        # telemetry-parser puts both sensors' samples side by side by their number, whatever their rates; they span the
        # same time.
        times = np.linspace(times[0], times[-1], len(values))
    unit, facts, cautions = "deg/s" if sensor is GYRO else sensor.unit, _facts(camera, blocks), []
    if "stabilised" in facts:
        cautions.append(
            f"the camera stabilised the video itself ({facts['stabilised']}): its picture does not move as the camera "
            "did, so its blur cannot be computed from the gyro alone; record without stabilisation"
        )
    return Samples.of_ms(source.path, times, values, unit=unit, facts=facts, cautions=cautions)


def other_logs(source: Source) -> Iterator[Format[Samples]]:
    """Yield the format of a log that only telemetry-parser knows, such as Betaflight's; nothing if it fails too."""
    with contextlib.suppress(FileFormatError):
        samples = _read_video(source, GYRO)
        yield Format("telemetry", "log that telemetry-parser reads", lambda _: True, lambda *_: samples)


def _facts(camera: str, blocks: Blocks) -> dict[str, Any]:
    first = blocks[0].get("Default", {}) if blocks else {}
    facts: dict[str, Any] = {"camera": camera}
    for name, code, scale in (("readout_time_s", GOPRO_READOUT, 1e3), ("field_of_view_deg", GOPRO_VIEW, 1.0)):
        with contextlib.suppress(TypeError, ValueError, KeyError):
            facts[name] = float(first[code]) / scale
    if first.get(GOPRO_STABILISED) == "Y":
        facts["stabilised"] = first.get(GOPRO_STABILISER, "yes")
    return facts


JPEG = Format("gyrodata", "JPEG with a GYRODATA trailer", lambda source: trailer_of(source) is not None, _read_trailer)
VIDEO = Format("video", "video with a telemetry track: GoPro, DJI, Sony, Insta360", is_video, _read_video)
