"""Reading of the picture, the log, the camera and the exposure that the options name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import click

from rsdeblur._util.files import FileState, file_state
from rsdeblur.choices import Auto, Transfer
from rsdeblur.cli import _engine as rs
from rsdeblur.cli._options import ONE_OF_MANY, Recording, flag, refuse_given
from rsdeblur.cli._output import LOG, capture_warnings, printable, progress, warn
from rsdeblur.errors import CoverageError, FileFormatError, InputError

# Frames by which telemetry and video may differ.
MOST_MISSING = 2
# Apps of the rear camera, whose accelerometers show the same sign on all devices.
REAR = "mars", "deepgyro"
# Where the bottom of the viewed picture is in the stored one, for each orientation in EXIF that does not mirror: angle
# (rad) from its bottom towards its right.
BOTTOMS = {1: 0.0, 3: math.pi, 6: math.pi / 2, 8: -math.pi / 2}


class Inputs(NamedTuple):
    """Inputs of a computation."""

    picture: rs.Picture
    log: rs.GyroLog
    camera: rs.Camera
    exposure: rs.Exposure


def read_inputs(photo: Path, recording: Recording) -> Inputs:
    """Read the picture, the log, the camera and the exposure."""
    # The small files come first, so that a wrong option shows before a large picture is read.
    log, camera, exposure = read_recording(recording, photo)
    return Inputs(rs.read_picture(photo), log, camera, exposure)


def with_exif(recording: Recording, photo: Path) -> Recording:
    """Return the recording with what a photo's EXIF block gives where no option does: the camera, and the moment."""
    start = recording.start
    if all(each is None for each in (recording.capture, start, recording.start_ns)):
        with suppress(InputError):
            rs.capture_time(_exif(photo), photo.stem)
            start = "exif"
    return replace(recording, camera=recording.camera or photo, start=start)


def photo_gravity(photo: Path, inputs: Inputs, recording: Recording) -> rs.Gravity:
    """Return the direction of gravity in a photo; warn where it contradicts the camera's axes."""
    bottom = BOTTOMS.get(rs.Exif(inputs.picture.exif).orientation)
    return _gravity_of(photo, bottom, recording, inputs.camera, [inputs.exposure])


def with_axes(name: str, inputs: Inputs, photo: Path) -> Inputs:
    """Return the inputs with the axes that fit gravity."""
    warn(f"{photo}: deblurred with the axes {name}; if it is not upright, --refine keeps those of the camera file")
    return inputs._replace(camera=replace(inputs.camera, imu_to_camera=rs.imu_to_camera(name)))


def with_offset(inputs: Inputs, photo: Path) -> Inputs:
    """Return the inputs with the time offset that the picture determines, as a time from EXIF is a second off."""
    picture, log, camera, exposure = inputs
    with progress("time") as move, naming(photo):
        found = rs.find_time_offset(
            picture.pixels, log, camera, exposure, search=exif_error(photo), transfer=picture.transfer, progress=move
        )
    check_offset(found, [photo])
    camera = found.camera
    LOG.info(
        f"{photo}: time offset {1e3 * camera.time_offset:.1f} ms (+- {1e3 * found.sd:.1f}), "
        f"readout {1e3 * camera.readout_time:.1f} ms"
    )
    return inputs._replace(camera=camera)


def exif_error(photo: Path) -> tuple[float, float]:
    """Return how far the time in a photo's EXIF block may be from the start of the exposure, s."""
    return rs.capture_time(_exif(photo), photo.stem).error


def check_offset(found: rs.OffsetSearch, photos: Sequence[Path]) -> None:
    """Raise `InputError` if the pictures do not determine the time offset."""
    if found.time_offset is None:
        what = f"{photos[0]}: the picture does" if len(photos) == 1 else f"the {len(photos)} pictures do"
        raise InputError(f"{what} not determine the time offset: {found.reason} (likeliest {1e3 * found.best:.1f} ms)")


def search_span(
    find: Any, first: float | None, last: float | None, usual: tuple[float, float] | None = None
) -> tuple[float, float]:
    """Return the first and the last time offset of a search, s: as given, otherwise the defaults of `find`."""
    early, late = usual or find.__kwdefaults__["search"]
    return early if first is None else first, late if last is None else last


def recordings_of(photos: Sequence[Path], recording: Recording) -> list[Recording]:
    """Return the recording of each photo; several photos have moments of their own, which the capture file lists."""
    if len(photos) == 1:
        refuse_given("is for several photos whose exposures are in --capture", numbered_from=recording.numbered_from)
        return [recording]
    refuse_given(ONE_OF_MANY, index=recording.index, start=recording.start, start_ns=recording.start_ns)
    if recording.capture is None:
        raise click.UsageError(
            f"{len(photos)} photos, but no exposure is given; use --capture with photos named after their timestamps "
            "or frame numbers"
        )
    return [replace(recording, index=index) for index in indices_of(photos, recording)]


def indices_of(photos: Sequence[Path], recording: Recording) -> list[int]:
    """Return the number of each photo's exposure in the capture file; raise an error if its name has none."""
    assert recording.capture is not None
    indices = []
    for match in rs.indices_of(
        list(photos), recording.capture, numbered_from=recording.numbered_from, columns=_capture_columns(recording)
    ):
        if match.index is None:
            raise FileFormatError(f"{match.path}: {match.error}")
        indices.append(match.index)
    return indices


def read_recording(recording: Recording, photo: Path | None = None) -> tuple[rs.GyroLog, rs.Camera, rs.Exposure]:
    """Read the log, the camera and the exposure that the options name; see `read_inputs`."""
    exposure = _exposure(recording, photo)
    log, camera = read_device(recording)
    _refuse_longer(recording.duration, log.span[1] - log.span[0], recording.gyro)
    if recording.start == "exif":
        if photo is None:
            raise click.UsageError("--start exif needs a photo")
        with naming(photo, recording):
            exposure = replace(exposure, epoch_ns=rs.on_clock_of(rs.capture_time(_exif(photo), photo.stem), log))
    sd = f" ± {1e3 * camera.readout_sd:.2g}" if camera.readout_sd else ""
    readout = f"readout {1e3 * camera.readout_time:.3g}{sd} ms {camera.readout_direction}"
    LOG.info(
        f"exposure: {exposure.epoch_ns} ns + {exposure.start:.6f} s, {1e3 * exposure.duration:.3g} ms; camera: "
        f"{camera.width}x{camera.height}, {camera.focal_length[0]:.1f} px, {readout}, time offset "
        f"{1e3 * camera.time_offset:.1f} ms"
    )
    return log, camera, exposure


def read_device(recording: Recording) -> tuple[rs.GyroLog, rs.Camera]:
    """Read the log and the camera that the options name; see `read_recording`."""
    camera_file = rs.open_camera(recording.camera)
    focal_length = None
    if recording.focal_length is not None:
        fx, fy = camera_file.camera.focal_length
        focal_length = recording.focal_length, recording.focal_length * fy / fx
    overrides = {"time_offset": recording.time_offset, "readout_time": recording.readout_time}
    camera = camera_file.with_overrides(**overrides, focal_length=focal_length).warn(recording.camera)
    file = read_log(recording)
    for problem in rs.axes_problems(file, camera, recording.gyro):
        warn(f"{recording.camera}: {problem}")
    first, last = file.log.span
    LOG.info(f"log: {file.format}, {len(file.log)} samples at {file.log.rate:.1f} Hz, {first:.3f} to {last:.3f} s")
    return file.log, camera


def read_log(recording: Recording) -> rs.GyroFile:
    """Read the log that the options name, without its bias, and show its warnings; the last log is kept."""
    file, messages = _known_log(recording)
    for message in messages:
        warn(message)
    return file if recording.bias is None else replace(file, log=file.log.minus_bias(recording.bias))


def _known_log(recording: Recording) -> tuple[rs.GyroFile, list[str]]:
    """Return the log with its bias, and the warnings of its reader."""
    reading = {"format": recording.gyro_format, "columns": rs.choice_for("gyro log", recording.columns)}
    reading |= {name: getattr(recording, name) for name in ("unit", "orientation", "rate")}
    return _gyro_file(recording.gyro, file_state(recording.gyro), **reading)


@lru_cache(maxsize=1)
def _gyro_file(path: Path, _: FileState, **reading: Any) -> tuple[rs.GyroFile, list[str]]:
    with capture_warnings(show=False) as messages:
        return rs.open_gyro(path, **reading), messages


def accelerometer(path: Path, columns: str | None) -> rs.AccelerationLog | None:
    """Return the accelerometer's samples in a gyro log; None if there are none that can be read."""
    return _acceleration(path, file_state(path), columns)


_acceleration = lru_cache(maxsize=1)(lambda path, state, columns: rs.accelerometer(path, columns))


def _gravity_of(
    picture: Path, bottom: float | None, recording: Recording, camera: rs.Camera, exposures: Sequence[rs.Exposure]
) -> rs.Gravity:
    """Return where the log's accelerometer sees gravity in a picture or a clip; warn if that contradicts the axes."""
    # Other axes than those of the file are the user's, and the accelerometer is read in those of the file.
    log = None if bottom is None or recording.orientation else accelerometer(recording.gyro, recording.columns)
    if log is None or bottom is None:
        return rs.Gravity()
    file, _ = _known_log(recording)
    presets = [name for name in rs.PRESETS if file.axes == "sensor" or name.startswith(file.axes)]
    kind = {"is_phone": file.axes == "phone", "is_rear": file.format in REAR}
    gravity = rs.gravity_in(log, camera, exposures, bottom=bottom, presets=presets, **kind)
    if not gravity.contradicts:
        return gravity
    doubt = {
        "edge": f"the camera would look along an edge of the phone that logged {recording.gyro}",
        "user": f"the camera would look towards the user of the app that logged {recording.gyro}",
    }.get(gravity.side, f"by the accelerometer in {recording.gyro}, gravity points to the {gravity.side} of {picture}")
    fits = f" ({' or '.join(gravity.fits)} fits)" if gravity.fits else ""
    warn(f"{doubt}: if the picture is viewed upright, imu_to_camera in {recording.camera} is wrong{fits}")
    return gravity


def read_captures(recording: Recording, duration: float | None) -> list[rs.Exposure]:
    """Return the exposures in the capture file that the options name; `duration` is that of those without one, s."""
    assert recording.capture is not None
    return rs.read_captures(recording.capture, duration=duration, columns=_capture_columns(recording))


def _capture_columns(recording: Recording) -> str | None:
    return rs.choice_for("capture file", recording.columns)


def _exposure(recording: Recording, photo: Path | None) -> rs.Exposure:
    if recording.start is not None and recording.start_ns is not None:
        raise click.UsageError("--start and --start-ns exclude each other")
    start, duration = None, recording.duration
    if recording.start_ns is not None:
        start = 0.0, recording.start_ns
    elif recording.start is not None:
        # The log decides the time zone of a time from EXIF, later.
        start = (0.0 if recording.start == "exif" else recording.start), 0
    path, columns = recording.capture, _capture_columns(recording)
    if duration is None and photo and (path is None or None in rs.open_captures(path, columns).durations):
        duration = _exif(photo).exposure
    if path is not None:
        chosen = _chosen(read_captures(recording, duration), recording)
        start = start or (chosen.start, chosen.epoch_ns)
        duration = chosen.duration if duration is None else duration
    elif recording.index is not None:
        raise click.UsageError("--index needs --capture")
    if start is None or duration is None:
        missing = [
            *(["the start: --capture FILE --index N, --start or --start-ns"] if start is None else []),
            *(["its time: --duration, which the photo's EXIF block does not contain"] if duration is None else []),
        ]
        raise click.UsageError(f"the exposure is missing; give {', and '.join(missing)}")
    with naming("the exposure"):
        return rs.Exposure(start[0], duration, start[1])


def _exif(photo: Path) -> rs.Exif:
    return rs.Exif(rs.read_header(photo)[2])


def _chosen(captures: list[rs.Exposure], recording: Recording) -> rs.Exposure:
    path, index, choices = printable(recording.capture), recording.index, f"--index 0 to {len(captures) - 1}"
    if index is None and len(captures) > 1:
        raise click.UsageError(f"{path} contains {len(captures)} exposures; choose one with {choices}")
    if index is not None and index >= len(captures):
        raise InputError(f"{path}: there is no exposure {index}; the file contains {len(captures)}: {choices}")
    return captures[index or 0]


def read_clip(path: Path, recording: Recording) -> tuple[rs.Clip, rs.GyroLog, rs.Camera, list[rs.Exposure]]:
    """Open a video, and read the log, the camera and the exposure of each frame."""
    log, camera = read_device(recording)
    clip = rs.open_clip(path)
    exposures = clip_exposures(clip, recording)
    bottom: float | None = 0.0  # without a display matrix, viewers do not turn the frames
    if clip.matrix is not None:
        (a, b), (c, d) = clip.matrix[:2], clip.matrix[3:5]
        bottom = math.atan2(b, d) if a * d - b * c > 0 else None
    _gravity_of(clip.path, bottom, recording, camera, exposures)
    return clip, log, camera, exposures


def clip_exposures(clip: rs.Clip, recording: Recording) -> list[rs.Exposure]:
    """Return the exposure of each frame of a video, which the options give."""
    if recording.start == "exif":
        raise click.UsageError("--start exif is for photos; give --capture, or the start of the first frame")
    starts = [name for name in ("capture", "start", "start_ns") if getattr(recording, name) is not None]
    if len(starts) > 1:
        raise click.UsageError(f"{' and '.join(map(flag, starts))} exclude each other")
    if recording.capture is not None:
        return rs.exposures_from_captures(
            clip, recording.capture, duration=recording.duration, columns=_capture_columns(recording)
        )
    _refuse_longer(recording.duration, float((clip.end - clip.timestamps[0]) * clip.time_base), clip.path)
    durations = recording.duration or _clip_durations(recording.gyro, clip)
    if durations is None:
        raise click.UsageError("the exposure time is not given; use --duration, or --capture FILE")
    return rs.exposures_from_timestamps(
        clip, durations, start=float(recording.start or 0.0), epoch_ns=recording.start_ns or 0
    )


def _clip_durations(log: Path, clip: rs.Clip) -> list[float] | None:
    """Return the exposure time of each frame from the telemetry of the log or of the clip; None if it has none."""
    for path in dict.fromkeys((log, Path(clip.path))):
        with suppress(FileFormatError):
            durations = rs.frame_exposures(path)
            # Telemetry often contains one value more or less than the video has frames.
            if abs(len(durations) - len(clip)) <= MOST_MISSING:
                return [*durations, *durations[-1:] * MOST_MISSING][: len(clip)]
    return None


def transfer_of(picture: rs.Picture, transfer: Transfer | Auto) -> Transfer:
    """Return how the picture encodes light; "auto" is sRGB for integers, linear for floats and raw files."""
    if transfer != "auto":
        return transfer
    rs.warn_of_encoded_floats(picture.pixels)
    return picture.transfer


@contextmanager
def naming(file: Path | str | None, recording: Recording | None = None) -> Iterator[None]:
    """Put the file at fault, `file` or a log that does not cover the exposure, before an error that lacks it."""
    try:
        yield
    except (CoverageError, InputError) as error:
        fault, hint = file, ""
        if isinstance(error, CoverageError) and recording is not None:
            fault, hint = recording.gyro, _start_hint(recording)
        name = f"{fault}: " if fault else ""
        raise type(error)(name + str(error).removeprefix(name) + hint) from error


def _refuse_longer(duration: float | None, whole: float, path: Path) -> None:
    """Refuse an exposure time that exceeds the file which must cover the exposure."""
    if duration is None or duration <= whole:
        return
    meant = {f"{duration:.10g}ms": 1e-3 * duration, f"1/{duration:.10g}": 1 / duration}
    # A shorter time was hardly meant in another unit: the file is too short. Below 0.1 ms, there is no blur.
    options = [text for text, time in meant.items() if duration >= 1 and 1e-4 <= time <= whole]
    hint = f"did you mean {' or '.join(options)}?" if options else "give a longer recording"
    raise InputError(f"--duration: {duration:g} s is longer than {path} ({whole:.3g} s); {hint}")


def _start_hint(recording: Recording) -> str:
    """Return a question, after a semicolon, if a start in another unit, or counted from the log's, lies in the log."""
    if recording.capture is not None or recording.start == "exif":
        return ""
    log = _known_log(recording)[0].log
    first, last = (log.epoch_ns * 1e-9 + t for t in log.span)
    start = recording.start or 0.0
    if recording.start_ns is not None:
        start = 1e-9 * recording.start_ns
        meant = {f"--start-ns {factor * recording.start_ns}": factor * start for factor in (10**3, 10**6, 10**9)}
    else:
        # Digits for microseconds of Unix time, and no more.
        moment = round(first + start, 6)
        meant = {f"--start {moment:.16g}, as the log begins at {round(first, 6):.16g} s": moment}
        # Further away, a moment is rather in another unit than just missed by the log.
        if start > last + 10 * (last - first):
            meant[f"--start {start:.10g}ms"] = 1e-3 * start
    option = next((option for option, moment in meant.items() if first <= moment <= last), None)
    return "" if first <= start <= last or option is None else f"; did you mean {option}?"
