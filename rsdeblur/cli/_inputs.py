"""Reading of the picture, the log, the camera and the exposure that the options name."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rsdeblur.cli._output import printable
from rsdeblur.errors import CoverageError, InputError, RsdeblurWarning

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.choices import Auto, Transfer
    from rsdeblur.cli._options import ClipLog, Recording, Track
    from rsdeblur.io.pictures import Picture
    from rsdeblur.io.samples import GyroFile
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.motion.gyro import GyroLog
    from rsdeblur.pipeline.options import Options
    from rsdeblur.video.clip import Clip


class Inputs(NamedTuple):
    """Inputs of a computation."""

    picture: Picture
    log: GyroLog
    camera: Camera
    exposure: Exposure


def read_inputs(photo: Path, recording: Recording, *, in_place: bool = False) -> Inputs:
    """Read the picture, or map its file if `in_place` is set, and read the log, the camera and the exposure.

    Raises
    ------
    RsdeblurError
        If a file is refused, or the capture file has no exposure of that index.
    click.UsageError
        If the options do not give the exposure.
    """
    from rsdeblur.io.pictures import read_picture

    # The small files come first, so that a wrong option shows before a large picture is read.
    log, camera, exposure = read_recording(recording, photo)
    return Inputs(read_picture(photo, in_place=in_place), log, camera, exposure)


def read_recording(recording: Recording, photo: Path | None = None) -> tuple[GyroLog, Camera, Exposure]:
    """Read the log, the camera and the exposure that the options name; see `read_inputs`."""
    exposure = _exposure(recording, photo)
    return *read_device(recording), exposure


def read_device(recording: Recording) -> tuple[GyroLog, Camera]:
    """Read the log and the camera that the options name; see `read_inputs`."""
    from rsdeblur.io import open_camera

    file = open_camera(recording.camera)
    focal_length = None
    if recording.focal_length is not None:
        fx, fy = file.camera.focal_length
        focal_length = recording.focal_length, recording.focal_length * fy / fx
    overrides = {"time_offset": recording.time_offset, "readout_time": recording.readout_time}
    camera = file.with_overrides(**overrides, focal_length=focal_length).warn(recording.camera)
    gyro = read_log(recording)
    _check_axes(gyro, camera, recording)
    return gyro.log, camera


def read_log(recording: Recording | ClipLog) -> GyroFile:
    """Read the log that the options name, without its bias, and show its warnings; see `read_inputs`."""
    reading = recording.gyro_format, recording.unit, recording.orientation, recording.rate
    file, messages = _gyro_file(recording.gyro, _state(recording.gyro), *reading)
    for message in messages:
        warnings.warn(message, RsdeblurWarning, stacklevel=2)
    return file if recording.bias is None else replace(file, log=file.log.minus_bias(recording.bias))


@lru_cache(maxsize=1)
def _gyro_file(
    path: Path,
    _: tuple[int, ...] | None,
    format: str | None,
    unit: str | None,
    orientation: str | None,
    rate: float | None,
) -> tuple[GyroFile, list[str]]:
    """Read a log and collect its warnings; kept for the next photo, as a long log takes longer than deblurring."""
    from rsdeblur.io import open_gyro

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RsdeblurWarning)
        file = open_gyro(path, format, unit=unit, orientation=orientation, rate=rate)
    return file, [str(warning.message) for warning in caught]


def _state(path: Path) -> tuple[int, ...] | None:
    """Return numbers that change when a file does; None if there is no such file, which its reader reports."""
    try:
        facts = path.stat()
    except (OSError, ValueError):
        return None
    return facts.st_dev, facts.st_ino, facts.st_size, facts.st_mtime_ns


def _check_axes(file: GyroFile, camera: Camera, recording: Recording) -> None:
    """Warn if the camera file contradicts the axes of the log, where those are known."""
    import numpy as np

    from rsdeblur.motion.axes import imu_to_camera

    matrix = camera.imu_to_camera
    if file.axes == "sensor":
        return
    if np.array_equal(matrix, np.eye(3)):
        problem = "imu_to_camera is the identity"
    elif file.axes == "gyroflow" and np.array_equal(matrix, imu_to_camera("phone-portrait")):
        problem = "imu_to_camera is that of a phone's axes"
    else:
        return
    expected = "phone-portrait or phone-landscape" if file.axes == "phone" else "gyroflow"
    warnings.warn(
        f"{recording.camera}: {problem}, but {recording.gyro} is in {file.axes} axes; "
        f"imu_to_camera should be {expected}",
        RsdeblurWarning,
        stacklevel=2,
    )


def with_translation(options: Options, track: Track, camera: Camera, exposure: Exposure) -> Options:
    """Return the options with the translation that other options name, if they name one.

    Raises
    ------
    RsdeblurError
        If the file is refused or does not cover the exposure.
    click.UsageError
        If the file or the depth is given without the other.
    """
    if track.translation is None and track.depth is None:
        return options
    if track.translation is None or track.depth is None:
        raise _usage("--translation and --depth are needed together")

    from rsdeblur.io import read_trajectory

    trajectory = read_trajectory(track.translation)
    try:
        translation = trajectory.translation(exposure, camera, track.depth, axes=track.translation_axes)
    except CoverageError as error:
        raise type(error)(f"{track.translation}: {error}") from error
    return replace(options, translation=translation)


def _exposure(recording: Recording, photo: Path | None) -> Exposure:
    from rsdeblur.io import read_captures
    from rsdeblur.io.captures import open_captures
    from rsdeblur.motion.exposure import Exposure

    if recording.start is not None and recording.start_ns is not None:
        raise _usage("--start and --start-ns exclude each other")
    start = None if recording.start is None else (recording.start, 0)
    if recording.start_ns is not None:
        start = (0.0, recording.start_ns)
    duration = recording.duration
    if recording.capture is not None:
        if duration is None and None in open_captures(recording.capture).durations:
            duration = _exif_exposure(photo)
        chosen = _chosen(read_captures(recording.capture, duration=duration), recording)
        start = start or (chosen.start, chosen.epoch_ns)
        duration = chosen.duration if duration is None else duration
    elif recording.index is not None:
        raise _usage("--index needs --capture")
    elif duration is None:
        duration = _exif_exposure(photo)
    if start is None or duration is None:
        raise _usage(
            "the exposure is not given; use --capture FILE --index N, or --start or --start-ns together with "
            "--duration, which may be left out if the photo's EXIF block contains it"
        )
    return Exposure(start[0], duration, start[1])


def _exif_exposure(photo: Path | None) -> float | None:
    """Return the exposure time in the picture's EXIF block; None if there is none."""
    if photo is None:
        return None
    from rsdeblur.io.exif import Exif
    from rsdeblur.io.pictures import read_header

    return Exif(read_header(photo)[2]).exposure


def _chosen(captures: list[Exposure], recording: Recording) -> Exposure:
    last = len(captures) - 1
    if recording.index is None and last > 0:
        raise _usage(f"{recording.capture} contains {len(captures)} exposures; choose one with --index 0 to {last}")
    index = recording.index or 0
    if index > last:
        raise InputError(
            f"{recording.capture}: there is no exposure {index}; the file contains {len(captures)}: --index 0 to {last}"
        )
    return captures[index]


def clip_exposures(clip: Clip, recording: Recording | ClipLog) -> list[Exposure]:
    """Return the exposure of each frame of a video, which the options give.

    Raises
    ------
    RsdeblurError
        If the capture file is refused.
    click.UsageError
        If the options do not give the exposures.
    """
    from rsdeblur.video.times import exposures_from_captures, exposures_from_stamps

    starts = [name for name in ("capture", "start", "start_ns") if getattr(recording, name) is not None]
    if len(starts) > 1:
        options = " and ".join("--" + name.replace("_", "-") for name in starts)
        raise _usage(f"{options} exclude each other")
    if recording.capture is not None:
        return exposures_from_captures(clip, recording.capture, duration=recording.duration)
    if recording.duration is None:
        raise _usage("the exposure time is not given; use --duration, or --capture FILE")
    start = recording.start or 0.0
    return exposures_from_stamps(clip, recording.duration, start=start, epoch_ns=recording.start_ns or 0)


def _usage(message: str) -> click.UsageError:
    # The workers of a batch have no context.
    return click.UsageError(printable(message), ctx=click.get_current_context(silent=True))


def transfer_of(picture: Picture, transfer: Transfer | Auto) -> Transfer:
    """Return how the picture encodes light; "auto" is sRGB for integers, linear for floats and raw files."""
    return picture.transfer if transfer == "auto" else transfer


def display_values(values: NDArray[Any], transfer: Transfer) -> NDArray[Any]:
    """Return values for display, clipped to [0, 1]; linear light is encoded as sRGB."""
    import numpy as np

    from rsdeblur.image.transfer import from_linear

    clipped = np.clip(values, 0.0, 1.0)
    return from_linear(clipped, "srgb") if transfer == "linear" else clipped


def unit_range(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return pixels as float32 with integers mapped to [0, 1]."""
    import numpy as np

    scale = np.iinfo(pixels.dtype).max if pixels.dtype.kind == "u" else 1.0
    return pixels.astype(np.float32) / np.float32(scale)


@contextmanager
def naming(file: Path | None, recording: Recording | ClipLog | None = None) -> Iterator[None]:
    """Put the name of the file at fault before errors of a computation."""
    try:
        yield
    except CoverageError as error:
        raise type(error)(f"{recording.gyro}: {error}" if recording else str(error)) from error
    except InputError as error:
        raise InputError(f"{file}: {error}" if file else str(error)) from error
