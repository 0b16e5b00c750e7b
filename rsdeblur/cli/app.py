"""`rsdeblur app`: a local page that deblurs a crop while its sliders move.

Every request of the page contains the whole form, so the page and the command line cannot disagree: crop, saved picture
and copied command come from the same arguments of `rsdeblur deblur`, parsed by the same options.
"""

from __future__ import annotations

import shlex
import signal
import threading
import time
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import chain, count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import click
from click.core import ParameterSource

from rsdeblur.choices import SHARP
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import (
    Inputs,
    display_values,
    naming,
    read_recording,
    transfer_of,
    with_offset,
)
from rsdeblur.cli._items import result_name
from rsdeblur.cli._options import FILES, MANY, MANY_RESULTS, ONE_PHOTO, Command, Recording, flag, option
from rsdeblur.cli._output import capture_warnings, file_state, say, usage_as_input_error
from rsdeblur.cli._photo import PhotoJob, Prepared, deblur_photo, prepare
from rsdeblur.cli._types import PATH
from rsdeblur.errors import CoverageError, InputError, OutputError, RsdeblurError
from rsdeblur.pipeline.options import Options

# Options that have a slider; the strengths of the whole picture are derived without them, and so stay while they move.
MOVED = ("time_offset", "readout_time", "focal_length", "softness")
FORM = (*MANY, "mode", "prior", "softness")
Request: TypeAlias = "tuple[Path, Recording, Options]"

EXAMPLES = """\b
Examples:
  rsdeblur app photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4
  rsdeblur app --camera phone.toml
"""


@click.command("app", cls=Command, epilog=EXAMPLES)
@click.argument("photos", metavar="[PHOTO]...", nargs=-1, type=PATH)
@_options.recording_options(*MANY, required=())
@option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page.  [default: a free one]")
@option("--no-browser", is_flag=True, help="Print the address, and open no browser.")
def command(photos: tuple[Path, ...], recording: Recording, port: int, no_browser: bool) -> None:
    """Open a page that deblurs while its sliders move.

    The page is served to this machine only, and requests nothing from the network. It opens photo, log and camera,
    shows a crop with its PSFs and the check's verdict, copies the command for `rsdeblur deblur`, and saves the full
    picture with the same code. Ctrl-C ends it.
    """
    with Desk([str(photo.absolute()) for photo in photos], _given(click.get_current_context())) as desk:
        try:
            server = rs.LocalServer(rs.app_page(), desk.actions, desk.upload, port)
        except OSError as error:
            raise InputError(f"--port {port}: {error.strerror}; leave the option out to take a free port") from error
        with server:
            _serve(server, browser=not no_browser)


def _serve(server: rs.LocalServer, *, browser: bool) -> None:
    say(f"{server.url}", "Open this address in a browser of this machine; Ctrl-C ends the app.")
    if browser:
        webbrowser.open(server.url)
    try:
        server.serve_forever()
    except KeyboardInterrupt as interrupt:
        # Ctrl-C is the usual way to end the app; other signals are reported as for every command.
        if interrupt.args[:1] not in ((), (signal.SIGINT,)):
            raise


def _given(ctx: click.Context) -> dict[str, str]:
    """Return the options of the recording that the command line gives, as text."""

    def text(value: Any) -> str:
        if isinstance(value, Path):
            return str(value.absolute())
        return ",".join(map(repr, value)) if isinstance(value, tuple) else str(value)

    return {
        name: text(value)
        for name, value in ctx.params.items()
        if name in MANY and ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE
    }


# The page shows clipped highlights as they are: a crop does not show whether the photo has few.
@click.command("deblur", add_help_option=False, context_settings={"default_map": {"saturation": "ignore"}})
@click.argument("photo", type=PATH)
@_options.recording_options(*ONE_PHOTO)
@_options.solve_options(*MANY_RESULTS)
def _parse(photo: Path, recording: Recording, options: Options) -> Request:
    return photo, recording, options


@dataclass(slots=True)
class Job:
    """Progress of the picture that is being saved."""

    stage: str = "read"
    fraction: float = 0.0
    cancelled: bool = False

    def move(self, stage: str, fraction: float) -> None:
        """Note the progress, or end the work."""
        if self.cancelled:
            raise RsdeblurError("cancelled; nothing was written")
        self.stage, self.fraction = stage, fraction


class Desk:
    """Request handlers of the page, which offers `photos` and begins with the `given` values in its form."""

    def __init__(self, photos: Sequence[str], given: Mapping[str, str]) -> None:
        self._start = {"photos": list(photos), "form": dict(given)}
        self._folder = TemporaryDirectory(prefix="rsdeblur-app-")
        # One computation at a time; it also guards the filters of warnings, which are the process's.
        self._busy, self._saving = threading.Lock(), threading.Lock()
        self._basis = lru_cache(maxsize=8)(_basis)
        self._job = Job()
        self.actions = {
            "start": lambda form: self._start,
            "open": self._open,
            "solve": self._solve,
            "save": self._save,
            "progress": lambda form: asdict(self._job),
            "cancel": self._cancel,
        }

    def __enter__(self) -> Desk:
        """Return the desk, which removes the files that it received at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the saving and remove the files that the browser sent."""
        self._job.cancelled = True
        with self._busy:
            self._folder.cleanup()

    def upload(self, name: str, content: bytes) -> dict[str, Any]:
        """Keep a file until the app ends, and return its path."""
        # Only the last part of a name, without anything that a system treats specially.
        clean = "".join(c for c in name.replace("\\", "/").rpartition("/")[2] if c.isprintable() and c not in '<>:"|?*')
        if not clean.strip(". ") or len(clean.encode()) > 200:
            raise InputError("the file has no usable name; rename it")
        path = Path(self._folder.name) / clean
        path.write_bytes(content)
        return {"path": str(path)}

    def _open(self, form: Mapping[str, Any]) -> dict[str, Any]:
        """Read the files of a form, and describe the picture and the camera."""
        with self._busy, capture_warnings(show=False) as notes:
            photo, *_ = request = _request(arguments(form))
            picture, _, camera, exposure = _ready(request).inputs
            # The overview has at most twice the pixels that the page shows of it.
            stride = max(1, max(picture.pixels.shape[:2]) // 1120)
            shown = display_values(picture.pixels[::stride, ::stride], picture.transfer)
            (overview,), _ = rs.picture_uris({"picture": shown}, picture.icc_profile)
        return {
            "name": photo.name,
            "size": [camera.width, camera.height],
            "overview": overview,
            "time_offset": camera.time_offset,
            "readout_time": camera.readout_time,
            "focal_length": camera.focal_length[0],
            "duration": exposure.duration,
            "output": str(self._free_name(photo)),
            "notes": notes,
        }

    def _free_name(self, photo: Path) -> Path:
        folder = Path.cwd() if photo.parent == Path(self._folder.name) else photo.parent
        stem, suffix = photo.stem + SHARP, result_name(photo).suffix
        names = chain([stem], (f"{stem}-{number}" for number in count(2)))
        return next(path for name in names if not (path := folder / (name + suffix)).exists())

    def _solve(self, form: Mapping[str, Any]) -> dict[str, Any]:
        """Deblur the crop that the form names."""
        begin = time.perf_counter()
        scale = max(0.2, min(float(form.get("scale", 1.0)), 1.0))
        with self._busy, capture_warnings(show=False) as notes:
            words, basis = self._tuned(form)
            # The options by which the command deblurs as the page does.
            chosen = any(word.startswith("--saturation") for word in words)
            as_here = ["--no-refine", *([] if chosen else ["--saturation", "ignore"])]
            ready = _ready(_request(words))
            options = replace(ready.options, check=bool(form.get("check")))
            picture, log, camera, exposure = ready.inputs
            left, top, width, height = map(int, form["box"])
            # Larger crops would be solved too slowly.
            crop = rs.Crop(left, top, min(width, 1024), min(height, 1024)).within(camera)
            with ready.naming:
                result = rs.solve_crop(picture.pixels, log, camera, exposure, options, basis, crop, scale=scale)
        answer = _shown(result, ready, crop, draft=scale < 1.0)
        name, value = basis.strength
        return answer | {
            "strength": {"name": name, "value": value, "power": power_of(form)},
            "check": None if result.check is None else asdict(result.check),
            "command": shlex.join(["rsdeblur", "deblur", *words, *as_here, "-o", path_of(form, "output")]),
            # The page chooses the scale of drafts by this; they have no check.
            "seconds": time.perf_counter() - begin - result.timings.get("check", 0.0),
            "notes": notes,
        }

    def _tuned(self, form: Mapping[str, Any]) -> tuple[list[str], rs.Basis]:
        """Return the arguments that a form means, and the strengths that they choose."""
        states = [file_state(Path(path_of(form, name))) for name in ("photo", *FILES)]
        words = arguments(form, {name: form.get("moved", {}).get(name) or form.get(name) for name in MOVED})
        try:
            basis = self._basis(tuple(arguments(form)), *states)
        except CoverageError:
            # The slider may be what brings the exposure into the log.
            basis = self._basis(tuple(words), *states)
        if power_of(form):
            name, value = basis.strength
            strength = f"{value * 10 ** power_of(form):.3g}"
            words += [f"--{name}", strength]
            basis = basis.with_strength(float(strength))
        return words, basis

    def _save(self, form: Mapping[str, Any]) -> dict[str, Any]:
        """Deblur and write the whole picture, as `rsdeblur deblur` does; the page asks for the progress meanwhile."""
        if not text_of(form, "output"):
            raise InputError("choose the name of the result")
        if not self._saving.acquire(blocking=False):
            raise InputError("a picture is being saved")
        try:
            with self._busy, capture_warnings(show=False):
                photo, recording, options = _request(self._tuned(form)[0])
                output = Path(path_of(form, "output"))
                if output.exists():
                    # The page has no --force.
                    raise OutputError(f"{output}: the file exists; choose another name")
                self._job = Job()
                job = PhotoJob(photo=photo, recording=recording, options=options, output=output)
                with usage_as_input_error():
                    return deblur_photo(job, self._job.move)
        finally:
            self._saving.release()

    def _cancel(self, form: Mapping[str, Any]) -> dict[str, Any]:
        self._job.cancelled = True
        return asdict(self._job)


def _request(words: Sequence[str]) -> Request:
    """Parse arguments as the command line does."""
    with usage_as_input_error():
        request: Request = _parse.main(list(words), prog_name="rsdeblur deblur", standalone_mode=False)
    return request


def _ready(request: Request) -> Prepared:
    """Prepare a photo as `rsdeblur deblur` does, with pictures and times that are kept."""
    photo, recording, options = request
    with usage_as_input_error():
        log, camera, exposure = read_recording(recording, photo)
        picture = _picture(photo, file_state(photo))
        with naming(photo):
            rs.check_size(picture.pixels.shape, camera)
        inputs = Inputs(picture, log, camera, exposure)
        if recording.start == "exif":
            inputs = _timed(photo, tuple(map(file_state, (photo, recording.gyro, recording.camera))), recording)
        return prepare(photo, recording, options, inputs=inputs)


@lru_cache(maxsize=2)
def _timed(photo: Path, states: tuple[tuple[int, ...] | None, ...], recording: Recording) -> Inputs:
    """Return the inputs of a photo whose time is that of its EXIF block; kept, because the search takes seconds."""
    log, camera, exposure = read_recording(recording, photo)
    return with_offset(Inputs(_picture(photo, states[0]), log, camera, exposure), photo)


@lru_cache(maxsize=1)
def _picture(photo: Path, _: tuple[int, ...] | None) -> rs.Picture:
    """Read a photo; kept for the next request."""
    return rs.read_picture(photo)


def _basis(words: tuple[str, ...], *_: tuple[int, ...] | None) -> rs.Basis:
    """Derive the strengths of a whole picture; kept for each choice of files, mode and prior."""
    ready = _ready(_request(words))
    picture, log, camera, exposure = ready.inputs
    with ready.naming:
        return rs.derive_basis(picture.pixels, log, camera, exposure, replace(ready.options, check=False))


def _shown(result: rs.DeblurResult, ready: Prepared, crop: rs.Crop, *, draft: bool) -> dict[str, Any]:
    """Return the crop as data of the page; a draft shows its picture only."""
    inputs, transfer = ready.inputs, transfer_of(ready.inputs.picture, ready.options.transfer)
    pictures = {"result": display_values(result.image, transfer)}
    if not draft:
        pictures["input"] = display_values(crop.cut(inputs.picture.pixels), transfer)
    uris, _ = rs.picture_uris(pictures, inputs.picture.icc_profile)
    return {
        "size": [crop.width, crop.height],
        "box": list(crop),
        "scale": result.image.shape[1] / crop.width,
        "pictures": dict(zip(pictures, uris, strict=True)),
        "banks": {} if draft else {"PSFs": rs.bank_data(result.psfs)},
        "motion": rs.readout_data(inputs.camera.cropped(*crop), inputs.exposure),
    }


def arguments(form: Mapping[str, Any], moved: Mapping[str, Any] | None = None) -> list[str]:
    """Return the arguments of `rsdeblur deblur` that a form means, with automatic strengths.

    Empty texts are left out; `moved` are texts of sliders, which replace those of the form.
    """
    for name, label in (("photo", "photo"), ("gyro", "gyro log"), ("camera", "camera file")):
        if not text_of(form, name):
            raise InputError(f"choose the {label}")
    words = [path_of(form, "photo")]
    form = {**form, **(moved or {})}
    for name in FORM:
        if text_of(form, name):
            words += [flag(name), path_of(form, name) if name in FILES else text_of(form, name)]
    try:
        return words + shlex.split(text_of(form, "more"))
    except ValueError as error:
        raise InputError(f"other options: {error}") from error


def text_of(form: Mapping[str, Any], name: str) -> str:
    """Return a text of a form without spaces around it; empty if it is missing."""
    return str(form.get(name) or "").strip()


def path_of(form: Mapping[str, Any], name: str) -> str:
    """Return an absolute path, with which the command works in every folder."""
    text = text_of(form, name)
    return str(Path(text).expanduser().absolute()) if text else ""


def power_of(form: Mapping[str, Any]) -> float:
    """Return by how many powers of ten the strength differs from the automatic one."""
    return max(-3.0, min(float(form.get("power", 0.0)), 3.0))
