"""Reading of the picture, the log, the camera and the exposure that the options name."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from rsdeblur.cli._hints import refuse_longer, start_hint
from rsdeblur.cli._output import printable, progress, say_detail
from rsdeblur.errors import CoverageError, FileFormatError, InputError, RsdeblurWarning

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.choices import Auto, Transfer
    from rsdeblur.cli._options import Moments, Recording, Track
    from rsdeblur.estimate.time_offset import OffsetSearch
    from rsdeblur.io.exif import CaptureTime
    from rsdeblur.io.pictures import Picture
    from rsdeblur.io.samples import Axes, GyroFile
    from rsdeblur.motion.camera import Camera
    from rsdeblur.motion.exposure import Exposure
    from rsdeblur.motion.gyro import GyroLog
    from rsdeblur.pipeline.options import Options
    from rsdeblur.video.clip import Clip


# Options that mean one moment, so that several photos cannot share them.
ONE_MOMENT = ("index", "start", "start_ns")
# Frames by which telemetry and video may differ.
MOST_MISSING = 2


class Inputs(NamedTuple):
    """Inputs of a computation."""

    picture: Picture
    log: GyroLog
    camera: Camera
    exposure: Exposure


def read_inputs(
    photo: Path, recording: Recording, *, in_place: bool = False, search: bool = True, is_scene: bool = False
) -> Inputs:
    """Read the picture, or map its file if `in_place` is set, and read the log, the camera and the exposure.

    A time from EXIF is a second off, so the picture determines the camera's time offset, unless `search` is unset. If
    `is_scene` is set, the camera did not take the picture, so its directions have no relation to the recording.

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
    inputs = Inputs(read_picture(photo, in_place=in_place), log, camera, exposure)
    if not is_scene:
        warn_of_photo_gravity(photo, inputs, recording)
    return with_offset(inputs, photo) if search and recording.start == "exif" else inputs


def warn_of_photo_gravity(photo: Path, inputs: Inputs, recording: Recording) -> None:
    """Warn where the log's accelerometer contradicts the camera's axes."""
    from rsdeblur.cli._gravity import bottom_of_photo

    picture, _, camera, exposure = inputs
    _warn_of_gravity(photo, bottom_of_photo(picture.exif), recording, camera, [exposure])


def warn_of_clip_gravity(clip: Clip, recording: Recording, camera: Camera, exposures: Sequence[Exposure]) -> None:
    """Warn where the accelerometer contradicts the camera's axes on average over frames of a video."""
    from rsdeblur.cli._gravity import bottom_of_clip, some_frames

    _warn_of_gravity(clip.path, bottom_of_clip(clip.matrix), recording, camera, some_frames(exposures))


def _warn_of_gravity(
    picture: Path, bottom: float | None, recording: Recording, camera: Camera, exposures: Sequence[Exposure]
) -> None:
    from rsdeblur.cli._gravity import gravity_problem

    problem = gravity_problem(picture, bottom, recording, camera, exposures)
    if problem is not None:
        warnings.warn(problem, RsdeblurWarning, stacklevel=3)


def with_offset(inputs: Inputs, photo: Path) -> Inputs:
    """Return the inputs with the time offset that the picture determines.

    Raises
    ------
    InputError
        If it determines none.
    """
    from rsdeblur.estimate.time_offset import find_time_offset
    from rsdeblur.io.exif import EXIF_ERROR

    picture, log, camera, exposure = inputs
    with progress("time") as move, naming(photo):
        found = find_time_offset(
            picture.pixels, log, camera, exposure, search=EXIF_ERROR, transfer=picture.transfer, progress=move
        )
    check_offset(found, [photo])
    assert found.time_offset is not None
    say_detail(f"{photo}: time offset {1e3 * found.time_offset:.1f} ms (+- {1e3 * found.sd:.1f})")
    return inputs._replace(camera=replace(camera, time_offset=found.time_offset))


def check_offset(found: OffsetSearch, photos: Sequence[Path]) -> None:
    """Raise `InputError` if the pictures do not determine the time offset."""
    if found.time_offset is None:
        what = f"{photos[0]}: the picture does" if len(photos) == 1 else f"the {len(photos)} pictures do"
        raise InputError(f"{what} not determine the time offset: {found.reason} (likeliest {1e3 * found.best:.1f} ms)")


def recordings_of(photos: Sequence[Path], recording: Recording, numbered_from: int | None) -> list[Recording]:
    """Return the recording of each photo; several photos need moments of their own.

    Raises
    ------
    click.UsageError
        If the options give one moment for all of them, or a first number that no name is counted from.
    FileFormatError
        If the name of a photo does not determine its exposure in the capture file.
    """
    if numbered_from is not None and (len(photos) == 1 or recording.capture is None or recording.start == "exif"):
        raise _usage("--numbered-from is for several photos whose exposures are in --capture")
    if len(photos) == 1:
        return [recording]
    given = [f"--{name.replace('_', '-')}" for name in ONE_MOMENT if getattr(recording, name) not in (None, "exif")]
    if given or (recording.capture is None and recording.start is None):
        found = f"{', '.join(given)} is one moment" if given else "no exposure is given"
        raise _usage(
            f"{len(photos)} photos, but {found}; use --start exif, --capture with photos named after their "
            "timestamps or frame numbers, or a manifest: rsdeblur batch"
        )
    if recording.capture is None or recording.start == "exif":
        return [recording] * len(photos)
    from rsdeblur.io.sessions import indices_of

    matches = indices_of(list(photos), recording.capture, numbered_from=numbered_from)
    for match in matches:
        if match.error is not None:
            raise FileFormatError(f"{match.path}: {match.error}")
    return [replace(recording, index=match.index) for match in matches]


def read_recording(
    recording: Recording, photo: Path | None = None, *, known_axes: bool = True
) -> tuple[GyroLog, Camera, Exposure]:
    """Read the log, the camera and the exposure that the options name; see `read_inputs`.

    Unless the axes of the camera file should be known, nothing is said of them.
    """
    exposure = _exposure(recording, photo)
    log, camera = read_device(recording, known_axes=known_axes)
    refuse_longer(recording.duration, log.span[1] - log.span[0], recording.gyro)
    if recording.start == "exif":
        from rsdeblur.io.exif import on_clock_of

        with naming(photo, recording):
            exposure = replace(exposure, epoch_ns=on_clock_of(_exif_time(photo), log))
    say_detail(
        f"exposure: {exposure.epoch_ns} ns + {exposure.start:.6f} s, {1e3 * exposure.duration:.3g} ms; camera: "
        f"{camera.width}x{camera.height}, {camera.focal_length[0]:.1f} px, readout {1e3 * camera.readout_time:.3g} ms "
        f"{camera.readout_direction}, time offset {1e3 * camera.time_offset:.1f} ms"
    )
    return log, camera, exposure


def read_device(recording: Recording, *, known_axes: bool = True) -> tuple[GyroLog, Camera]:
    """Read the log and the camera that the options name; see `read_recording`."""
    from rsdeblur.io import open_camera

    camera_file = open_camera(recording.camera)
    focal_length = None
    if recording.focal_length is not None:
        fx, fy = camera_file.camera.focal_length
        focal_length = recording.focal_length, recording.focal_length * fy / fx
    overrides = {"time_offset": recording.time_offset, "readout_time": recording.readout_time}
    camera = camera_file.with_overrides(**overrides, focal_length=focal_length).warn(recording.camera)
    file = read_log(recording)
    if known_axes:
        _check_axes(file, camera, recording)
    first, last = file.log.span
    say_detail(f"log: {file.format}, {len(file.log)} samples at {file.log.rate:.1f} Hz, {first:.3f} to {last:.3f} s")
    return file.log, camera


def read_log(recording: Moments) -> GyroFile:
    """Read the log that the options name, without its bias, and show its warnings; see `read_inputs`."""
    file, messages = _known_log(recording)
    for message in messages:
        warnings.warn(message, RsdeblurWarning, stacklevel=2)
    return file if recording.bias is None else replace(file, log=file.log.minus_bias(recording.bias))


def log_format(recording: Moments) -> str:
    """Return the name of the format of the log that the options name."""
    return _known_log(recording)[0].format


def log_axes(recording: Moments) -> Axes:
    """Return the frame of the rates of the log that the options name."""
    return _known_log(recording)[0].axes


def _known_log(recording: Moments) -> tuple[GyroFile, list[str]]:
    """Return the log that the options name, with its bias, and the warnings of its reader."""
    reading = recording.gyro_format, recording.unit, recording.orientation, recording.rate
    return _gyro_file(recording.gyro, file_state(recording.gyro), *reading)


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


def file_state(path: Path) -> tuple[int, ...] | None:
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
    if file.axes == "phone" and camera.readout_time == 0:
        warnings.warn(
            f"{recording.camera}: the readout time is 0, as of a global shutter, but {recording.gyro} is the log of a "
            "phone, whose shutter rolls; give --readout-time",
            RsdeblurWarning,
            stacklevel=2,
        )
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
    from rsdeblur.motion.translation import Translation

    translation = options.translation
    if (track.translation is None) != (track.depth is None):
        raise _usage("--translation and --depth are needed together")
    if track.translation is None and track.translation_axes != "camera":
        raise _usage("--translation-axes belongs to --translation")
    if track.translation is not None and track.depth is not None:
        from rsdeblur.io import read_depths, read_trajectory

        trajectory = read_trajectory(track.translation)
        depth = read_depths(track.depth) if isinstance(track.depth, Path) else track.depth
        try:
            translation = trajectory.translation(exposure, camera, depth, axes=track.translation_axes)
        except CoverageError as error:
            raise type(error)(f"{track.translation}: {error}") from error
    if track.drift is not None:
        try:
            translation = Translation.drift(track.drift, camera, exposure, known=translation)
        except InputError as error:
            raise InputError(f"--drift: {error}") from error
    return replace(options, translation=translation)


def _exposure(recording: Recording, photo: Path | None) -> Exposure:
    from rsdeblur.io import read_captures
    from rsdeblur.io.captures import open_captures
    from rsdeblur.motion.exposure import Exposure

    if recording.start is not None and recording.start_ns is not None:
        raise _usage("--start and --start-ns exclude each other")
    # The log decides the time zone of a time from EXIF, later.
    seconds = 0.0 if recording.start == "exif" else recording.start
    start = None if seconds is None else (seconds, 0)
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
        raise _usage(_missing(start is None, duration is None, photo))
    try:
        return Exposure(start[0], duration, start[1])
    except InputError as error:
        # The message begins with the name of the argument.
        raise _usage(f"--{error}".replace("--epoch_ns", "--start-ns")) from error


def _missing(start: bool, duration: bool, photo: Path | None) -> str:
    """Return what to give where the start, the exposure time or both are unknown."""
    if not start:
        searched = "" if photo is None else " (the photo's EXIF block does not contain it)"
        return f"the exposure time is missing: give --duration{searched}"
    time = "" if duration else "the start of "
    from_exif = "" if photo is None else " (exif: the time in the photo's EXIF block)"
    return f"{time}the exposure is missing: give --capture FILE --index N, or --start{from_exif} or --start-ns" + (
        " together with --duration, which may be left out if the photo's EXIF block contains it" if duration else ""
    )


def _exif_exposure(photo: Path | None) -> float | None:
    """Return the exposure time in the picture's EXIF block, or None."""
    if photo is None:
        return None
    from rsdeblur.io.exif import Exif
    from rsdeblur.io.pictures import read_header

    return Exif(read_header(photo)[2]).exposure


def _exif_time(photo: Path | None) -> CaptureTime:
    """Return the time in the picture's EXIF block."""
    if photo is None:
        raise _usage("--start exif needs a photo")
    from rsdeblur.io.exif import Exif, capture_time
    from rsdeblur.io.pictures import read_header

    with naming(photo):
        return capture_time(Exif(read_header(photo)[2]))


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


def clip_exposures(clip: Clip, recording: Moments) -> list[Exposure]:
    """Return the exposure of each frame of a video, which the options give.

    Raises
    ------
    RsdeblurError
        If the capture file is refused.
    click.UsageError
        If the options do not give the exposures.
    """
    from rsdeblur.video.times import exposures_from_captures, exposures_from_timestamps

    starts = [name for name in ("capture", "start", "start_ns") if getattr(recording, name) is not None]
    if len(starts) > 1:
        options = " and ".join("--" + name.replace("_", "-") for name in starts)
        raise _usage(f"{options} exclude each other")
    if recording.capture is not None:
        return exposures_from_captures(clip, recording.capture, duration=recording.duration)
    refuse_longer(recording.duration, float((clip.end - clip.timestamps[0]) * clip.time_base), clip.path)
    durations = recording.duration or _clip_durations(recording.gyro, clip)
    if durations is None:
        raise _usage("the exposure time is not given; use --duration, or --capture FILE")
    start = float(recording.start or 0.0)
    return exposures_from_timestamps(clip, durations, start=start, epoch_ns=recording.start_ns or 0)


def _clip_durations(log: Path, clip: Clip) -> list[float] | None:
    """Return the exposure time of each frame from the telemetry of the log or of the clip; None if it has none."""
    from rsdeblur.io.gyro_binary import frame_exposures

    for path in dict.fromkeys((log, Path(clip.path))):
        with suppress(FileFormatError):
            durations = frame_exposures(path)
            # Telemetry often contains one value more or less than the video has frames.
            if abs(len(durations) - len(clip)) <= MOST_MISSING:
                return [*durations, *durations[-1:] * MOST_MISSING][: len(clip)]
    return None


def _usage(message: str) -> click.UsageError:
    # The workers of a batch have no context.
    return click.UsageError(printable(message), ctx=click.get_current_context(silent=True))


def transfer_of(picture: Picture, transfer: Transfer | Auto) -> Transfer:
    """Return how the picture encodes light; "auto" is sRGB for integers, linear for floats and raw files."""
    if transfer != "auto":
        return transfer
    from rsdeblur.image.encoded import warn_of_encoded_floats

    warn_of_encoded_floats(picture.pixels)
    return picture.transfer


def display_values(pixels: NDArray[Any], transfer: Transfer) -> NDArray[Any]:
    """Return values for display, integers divided by their full scale, clipped to [0, 1]; linear light becomes sRGB."""
    from rsdeblur.image.encoded import as_float
    from rsdeblur.image.transfer import from_linear

    clipped = as_float(pixels).clip(0.0, 1.0)
    return from_linear(clipped, "srgb") if transfer == "linear" else clipped


@contextmanager
def naming(file: Path | str | None, recording: Moments | None = None) -> Iterator[None]:
    """Put the name of the file at fault before errors of a computation, unless they name it already."""

    def named(fault: Path | str | None, error: Exception) -> str:
        name = f"{fault}: " if fault else ""
        return name + str(error).removeprefix(name)

    try:
        yield
    except CoverageError as error:
        hint = ""
        # A clip may start at the log's zero unless the user says another moment.
        if recording is not None and recording.capture is None and recording.start != "exif":
            hint = start_hint(recording.start or 0.0, recording.start_ns, _known_log(recording)[0].log)
        raise type(error)(named(recording.gyro if recording else None, error) + hint) from error
    except InputError as error:
        raise InputError(named(file, error)) from error
