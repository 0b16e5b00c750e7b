"""Handlers of the local page's requests, and its form as arguments of `rsdeblur deblur`.

Every request contains the whole form, so the page and the command line cannot disagree: crop, saved picture and copied
command come from the same arguments.
"""

import os
import shlex
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import chain, count
from pathlib import Path
from typing import Any

import click

from rsdeblur._util.files import FileState, file_state
from rsdeblur.app.crop import Basis, Crop, derive_basis, solve_crop
from rsdeblur.app.server import Uploads, plain
from rsdeblur.choices import CAMERA
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import Inputs, naming, read_recording, with_exif
from rsdeblur.cli._options import FILES, ONE_PHOTO, SOLVE, Recording, Target, flag
from rsdeblur.cli._output import capture_warnings, usage_as_input_error
from rsdeblur.cli._photo import PhotoJob, Prepared, deblur_photo, prepare
from rsdeblur.cli._types import PATH
from rsdeblur.cli.deblur import default_output
from rsdeblur.cli.demo import CAPTURE_LOG, KINDS, write_files
from rsdeblur.errors import CoverageError, InputError, OutputError, RsdeblurError
from rsdeblur.image.encoded import check_size, display_values
from rsdeblur.io.pictures import read_picture
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.report.drawings import bank_data, picture_uris
from rsdeblur.report.facts import axes_of, readout_data

# Bytes of a camera file that is kept for the next start; videos contain cameras too.
LARGEST_CAMERA = 1 << 20
# Options that have a slider; the strengths of the whole picture are derived without them, and so stay while they move.
MOVED = ("time_offset", "readout_time", "focal_length", "softness")
# Options that the page sets; "more" contains the others.
FIELDS = (*FILES, "index", "start", "start_ns", "duration", "orientation", *MOVED, "mode", "prior")

Form = Mapping[str, Any]
Action = Callable[[Form], Mapping[str, Any]]


# The page shows clipped highlights as they are: a crop does not show whether the photo has few.
@click.command("deblur", add_help_option=False, context_settings={"default_map": {"saturation": "ignore"}})
@click.argument("photo", type=PATH)
@_options.recording_options(*ONE_PHOTO, required=())
@_options.solve_options(*(name for name in SOLVE if name not in ("refine", "max_memory", "fallback")))
def _parse(photo: Path, recording: Recording, options: Options) -> tuple[Path, Recording, Options]:
    return photo, with_exif(recording, photo), options


_picture = lru_cache(maxsize=1)(lambda photo, state: read_picture(photo))


def _read(words: Sequence[str]) -> Prepared:
    """Prepare a photo as `rsdeblur deblur` does, with a picture that is kept."""
    with usage_as_input_error():
        photo, recording, options = _parse.main(list(words), "rsdeblur deblur", standalone_mode=False)
        inputs = None
        if recording.start != "exif":
            log, camera, exposure = read_recording(recording, photo)
            inputs = Inputs(_picture(photo, file_state(photo)), log, camera, exposure)
            with naming(photo):
                check_size(inputs.picture.pixels.shape, camera)
        return prepare(photo, recording, options, refine_anyway=False, inputs=inputs)


class Desk(AbstractContextManager["Desk"]):
    """Request handlers of the page, which offers `photos` and begins with the `given` options in its form.

    The last camera file is kept in the folder `settings`, and offered by the next start.
    """

    def __init__(self, photos: Sequence[str], given: Mapping[str, str], settings: Path) -> None:
        self._photos, self._given = list(photos), dict(given)
        self._cameras = settings / "last-camera"
        self.uploads = Uploads()
        # One computation at a time; it also guards the filters of warnings, which are the process's.
        self._busy = threading.Lock()
        self._basis = lru_cache(maxsize=8)(self._derived)
        self._example: dict[str, str] = {}
        self._begin()
        actions: dict[str, Action] = {
            "start": self._start,
            "example": self._made,
            "open": self._open,
            "solve": self._solve,
            "save": self._save,
            "progress": lambda form: dict(self._job),
            "cancel": self._cancel,
        }
        self.actions = {name: _plainly(action) for name, action in actions.items()}

    def __exit__(self, *_: object) -> None:
        """End the saving and remove the files that the browser sent."""
        self._cancel({})
        with self._busy:
            self.uploads.cleanup()

    def upload(self, name: str, content: bytes) -> dict[str, Any]:
        """Keep a file until the app ends, and return its path."""
        return {"path": str(self.uploads.keep(name, content))}

    def _start(self, form: Form) -> dict[str, Any]:
        camera = next(map(str, self._cameras.glob("*")), "")
        return {"photos": self._photos, "form": filled(self._given), "camera": camera}

    def _made(self, form: Form) -> dict[str, Any]:
        """Write an example, and return its form."""
        kind, folder = KINDS["capture"], self.uploads.new_folder()
        with self._busy:
            write_files("capture", (640, 480), 0, folder, force=False)
        files = {"photo": folder / "blurred.png", "gyro": folder / CAPTURE_LOG, "camera": folder / CAMERA}
        values = files | {"start": kind.start, "duration": kind.duration}
        self._example = filled({name: str(value) for name, value in values.items()})
        return {"form": self._example}

    def _open(self, form: Form) -> dict[str, Any]:
        """Read the files of a form, and describe the picture and the recording."""
        with self._busy, capture_warnings(show=False) as notes:
            ready = _read(arguments(form))
            picture, log, camera, exposure = ready.inputs
            # The overview has at most twice the pixels that the page shows of it.
            stride = max(1, max(picture.pixels.shape[:2]) // 1120)
            shown = display_values(picture.pixels[::stride, ::stride], picture.transfer)
            (overview,), _ = picture_uris({"picture": shown}, picture.icc_profile)
        photo, moment = Path(path_of(form, "photo")), {}
        if ready.recording.start == "exif":
            # The search took seconds; from now on, the moment that it found is given.
            start = exposure.epoch_ns + round(1e9 * exposure.start)
            moment = {"start": "", "start_ns": str(start), "time_offset": f"{camera.time_offset:.6f}"}
            moment |= {"readout_time": f"{camera.readout_time:.6f}"} if camera.readout_sd else {}
        self._remember(path_of(form, "camera"))
        return {
            "name": photo.name,
            "size": [camera.width, camera.height],
            "overview": overview,
            "time_offset": camera.time_offset,
            "readout_time": camera.readout_time,
            "readout_is_guess": camera.readout_sd > 0.0,
            "focal_length": camera.focal_length[0],
            "axes": axes_of(camera),
            # s after the first sample of the log.
            "start": 1e-9 * (exposure.epoch_ns - log.epoch_ns) + exposure.start - camera.time_offset - log.span[0],
            "duration": exposure.duration,
            "moment": moment,
            "output": str(self._free_name(photo)),
            "notes": notes,
        }

    def _remember(self, name: str) -> None:
        """Keep a copy of a camera file in place of the last one; that of the example is nobody's."""
        path = Path(name)
        if not name or path.parent == self._cameras or name == self._example.get("camera"):
            return
        with suppress(OSError):
            if path.stat().st_size <= LARGEST_CAMERA:
                shutil.rmtree(self._cameras, ignore_errors=True)
                self._cameras.mkdir(parents=True)
                shutil.copy(path, self._cameras)

    def _free_name(self, photo: Path) -> Path:
        """Return a path for the result that no file has: beside the photo, or in the working folder."""
        result = default_output((photo,))
        if self.uploads.has(photo):
            result = Path.cwd() / result.name
        names = chain([result.stem], (f"{result.stem}-{number}" for number in count(2)))
        return next(path for name in names if not (path := result.with_name(name + result.suffix)).exists())

    def _solve(self, form: Form) -> dict[str, Any]:
        """Deblur the crop that the form names."""
        begin = time.perf_counter()
        scale = max(0.2, min(float(form.get("scale", 1.0)), 1.0))
        with self._busy, capture_warnings(show=False) as notes:
            words, basis = self._tuned(form)
            # The options by which the command deblurs as the page does.
            chosen = any(word.startswith("--saturation") for word in words)
            as_here = ["--no-refine", *([] if chosen else ["--saturation", "ignore"])]
            ready = _read(words)
            options = replace(ready.options, check=bool(form.get("check")))
            picture, log, camera, exposure = ready.inputs
            left, top, width, height = map(int, form["box"])
            # Larger crops would be solved too slowly.
            crop = Crop(left, top, min(width, 1024), min(height, 1024)).within(camera)
            with ready.naming:
                result = solve_crop(picture.pixels, log, camera, exposure, options, basis, crop, scale=scale)
        answer = _shown(result, ready, crop, draft=scale < 1.0)
        name, value = basis.strength
        line = shlex.join(map(self._known, [*words, *as_here, "-o", path_of(form, "output")]))
        return answer | {
            "strength": {"name": name, "value": value, "power": power_of(form)},
            "check": None if result.check is None else asdict(result.check),
            "command": f"rsdeblur deblur {line}",
            # Names without folders, which the user must add.
            "bare": any(map(self.uploads.has, map(Path, words))),
            # The page chooses the scale of drafts by this; they have no check.
            "seconds": time.perf_counter() - begin - result.timings.get("check", 0.0),
            "notes": notes,
        }

    def _known(self, word: str) -> str:
        """Return a word of a command as the user would type it: files that the browser sent have no folder."""
        name = Path(word).name
        return word if not self.uploads.has(Path(word)) else f"./{name}" if name.startswith("-") else name

    def _tuned(self, form: Form) -> tuple[list[str], Basis]:
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
            change: dict[str, Any] = {name: float(strength)}
            basis = basis._replace(strengths=replace(basis.strengths, **change))
        return words, basis

    def _derived(self, words: tuple[str, ...], *_: FileState) -> Basis:
        """Derive the strengths of a whole picture; kept for each choice of files, mode and prior."""
        ready = _read(words)
        picture, log, camera, exposure = ready.inputs
        with ready.naming:
            return derive_basis(picture.pixels, log, camera, exposure, replace(ready.options, check=False))

    def _save(self, form: Form) -> dict[str, Any]:
        """Deblur and write the whole picture, as `rsdeblur deblur` does; the page asks for the progress meanwhile."""
        if not text_of(form, "output"):
            raise InputError("choose the name of the result")
        with self._busy, capture_warnings(show=False), usage_as_input_error():
            output = Path(path_of(form, "output"))
            if output.exists():
                # The page has no --force.
                raise OutputError(f"{output}: the file exists; choose another name")
            words, _ = self._tuned(form)
            self._begin()
            photo, recording, options = _parse.main(words, "rsdeblur deblur", standalone_mode=False)
            job = PhotoJob(photo=photo, recording=recording, options=options, target=Target(output))
            return deblur_photo(job, self._move)

    def _begin(self) -> None:
        # Progress of the picture that is being saved.
        self._job: dict[str, Any] = {"stage": "read", "fraction": 0.0, "cancelled": False}

    def _move(self, stage: str, fraction: float) -> None:
        """Note the progress, or end the work."""
        if self._job["cancelled"]:
            raise RsdeblurError("cancelled; nothing was written")
        self._job |= {"stage": stage, "fraction": fraction}

    def _cancel(self, form: Form) -> dict[str, Any]:
        self._job["cancelled"] = True
        return dict(self._job)


def _plainly(action: Action) -> Action:
    """Return an action whose errors and notes call the files as the user does."""

    def call(form: Form) -> Mapping[str, Any]:
        try:
            answer = action(form)
        except RsdeblurError as error:
            raise type(error)(plain(str(error))) from error
        return {**answer, "notes": [plain(note) for note in answer["notes"]]} if "notes" in answer else answer

    return call


def _shown(result: DeblurResult, ready: Prepared, crop: Crop, *, draft: bool) -> dict[str, Any]:
    """Return the crop as data of the page; a draft shows its picture only."""
    picture, _, camera, exposure = ready.inputs
    transfer = ready.options.transfer
    assert transfer != "auto"
    pictures = {"after": display_values(result.image, transfer)}
    if not draft:
        pictures["before"] = display_values(crop.cut(picture.pixels), transfer)
    uris, _ = picture_uris(pictures, picture.icc_profile)
    return {
        "size": [crop.width, crop.height],
        "box": list(crop),
        "scale": result.image.shape[1] / crop.width,
        "pictures": dict(zip(pictures, uris, strict=True)),
        "banks": {} if draft else {"PSFs": bank_data(result.psfs)},
        "motion": readout_data(camera.cropped(*crop), exposure),
    }


def filled(options: Mapping[str, str]) -> dict[str, str]:
    """Return the form that means these options and perhaps a photo, given as texts by name."""
    # No field is called "start_ns": the moment that a search found is not typed.
    fields = {name: text for name, text in options.items() if name in ("photo", *FIELDS) and name != "start_ns"}
    others = (word for name, text in options.items() if name not in fields for word in (flag(name), text))
    return fields | {"more": shlex.join(others)}


def arguments(form: Form, moved: Form | None = None) -> list[str]:
    """Return the arguments of `rsdeblur deblur` that a form means, in which `moved` texts of sliders replace others."""
    for name, label in (("photo", "photo"), ("gyro", "gyro log")):
        if not text_of(form, name):
            raise InputError(f"choose the {label}")
    words = [path_of(form, "photo")]
    form = {**form, **(moved or {})}
    for name in FIELDS:
        if text_of(form, name):
            words += [flag(name), path_of(form, name) if name in FILES else text_of(form, name)]
    try:
        return words + shlex.split(text_of(form, "more"))
    except ValueError as error:
        raise InputError(f"other options: {error}") from error


def text_of(form: Form, name: str) -> str:
    """Return a text of a form without spaces around it; empty if it is missing."""
    return str(form.get(name) or "").strip()


def path_of(form: Form, name: str) -> str:
    """Return an absolute path, with which the command works in every folder; empty if it is missing."""
    text = text_of(form, name)
    return os.path.abspath(os.path.expanduser(text)) if text else ""


def power_of(form: Form) -> float:
    """Return by how many powers of ten the strength differs from the automatic one."""
    return max(-3.0, min(float(form.get("power", 0.0)), 3.0))
