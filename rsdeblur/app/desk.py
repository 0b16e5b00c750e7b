"""Handlers of the page's requests.

Every request contains the whole form, so the page and the command line cannot disagree: crop, saved picture and copied
command come from the same arguments of `rsdeblur deblur`.
"""

from __future__ import annotations

import os
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.files import FileState, file_state, read_file
from rsdeblur.app.crop import Basis, Crop, derive_basis, solve_crop
from rsdeblur.app.form import FILES, MOVED, Form, arguments, filled, path_of, power_of, shell_line, text_of
from rsdeblur.app.uploads import Uploads, plain
from rsdeblur.errors import CoverageError, InputError, OutputError, RsdeblurError, RsdeblurWarning
from rsdeblur.image.encoded import display_values
from rsdeblur.motion.axes import PRESETS, imu_to_camera
from rsdeblur.motion.camera import Camera
from rsdeblur.pipeline.options import Options
from rsdeblur.pipeline.plan import DeblurResult
from rsdeblur.report.drawings import bank_data, picture_uris
from rsdeblur.report.facts import readout_data
from rsdeblur.types import Progress

# Bytes of a camera file that is kept for the next start; videos contain cameras too.
LARGEST_CAMERA = 1 << 20

Action = Callable[[Form], Mapping[str, Any]]


class Ready(Protocol):
    """A photo that is read and ready to be planned."""

    @property
    def inputs(self) -> Any:
        """The picture, the log, the camera and the exposure."""

    @property
    def options(self) -> Options:
        """The options, with a known transfer."""

    @property
    def naming(self) -> AbstractContextManager[None]:
        """Context that names the file at fault in errors."""

    @property
    def recording(self) -> Any:
        """What the arguments say about log, camera and exposure."""


class Engine(NamedTuple):
    """Functions of the command line, which the page uses so that both agree; arguments are those of `deblur`.

    Parameters
    ----------
    read
        Reads the files that arguments name.
    save
        Deblurs the photo of arguments, writes it to a path, and returns the facts about the result.
    result
        Returns the usual path of the result of photos, here one.
    example
        Writes an example to a folder, and returns the path of its photo and its options.
    """

    read: Callable[[Sequence[str]], Ready]
    save: Callable[[Sequence[str], Path, Progress], dict[str, Any]]
    result: Callable[[tuple[Path, ...]], Path]
    example: Callable[[Path], dict[str, str]]


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
    """Request handlers of the page, which offers `photos` and begins with the `given` options in its form.

    The last camera file is kept in the folder `settings`, and offered by the next start.
    """

    def __init__(self, engine: Engine, photos: Sequence[str], given: Mapping[str, str], settings: Path) -> None:
        self._engine, self._photos, self._given = engine, list(photos), dict(given)
        self._cameras = settings / "last-camera"
        self.uploads = Uploads()
        # One computation at a time; it also guards the filters of warnings, which are the process's.
        self._busy, self._saving = threading.Lock(), threading.Lock()
        self._basis = lru_cache(maxsize=8)(self._derived)
        self._example: dict[str, str] = {}
        self._job = Job()
        actions: dict[str, Action] = {
            "start": self._start,
            "example": self._made,
            "open": self._open,
            "solve": self._solve,
            "save": self._save,
            "progress": lambda form: asdict(self._job),
            "cancel": self._cancel,
        }
        self.actions = {name: _plainly(action) for name, action in actions.items()}

    def __enter__(self) -> Desk:
        """Return the desk, which removes the files that it received at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the saving and remove the files that the browser sent."""
        self._job.cancelled = True
        with self._busy:
            self.uploads.close()

    def upload(self, name: str, content: bytes) -> dict[str, Any]:
        """Keep a file until the app ends, and return its path."""
        return {"path": str(self.uploads.keep(name, content))}

    def _start(self, form: Form) -> dict[str, Any]:
        camera = ""
        with suppress(OSError):
            camera = next(map(str, self._cameras.iterdir()), "")
        return {"photos": self._photos, "form": filled(self._given), "camera": camera}

    def _made(self, form: Form) -> dict[str, Any]:
        """Write an example, and return its form."""
        with self._busy:
            self._example = filled(self.uploads.fill("the example", self._engine.example))
        return {"form": self._example}

    def _open(self, form: Form) -> dict[str, Any]:
        """Read the files of a form, and describe the picture and the recording."""
        with self._busy, _warnings() as notes:
            ready = self._engine.read(arguments(form))
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
        self._remember(path_of(form, "camera"))
        return {
            "name": photo.name,
            "size": [camera.width, camera.height],
            "overview": overview,
            "time_offset": camera.time_offset,
            "readout_time": camera.readout_time,
            "readout_is_guess": camera.readout_sd > 0.0,
            "focal_length": camera.focal_length[0],
            "axes": _axes_of(camera),
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
        with suppress(OSError, RsdeblurError):
            content = read_file(path, "camera file", size=LARGEST_CAMERA + 1)
            if len(content) <= LARGEST_CAMERA:
                self._cameras.mkdir(parents=True, exist_ok=True)
                others = [other for other in self._cameras.iterdir() if other.name != path.name]
                with atomic_write(self._cameras / path.name) as file:
                    file.write(content)
                for other in others:
                    other.unlink()

    def _free_name(self, photo: Path) -> Path:
        """Return a path for the result that no file has: beside the photo, or in the working folder."""
        result = self._engine.result((photo,))
        if self.uploads.has(photo):
            folder = Path(os.path.expanduser("~"))
            with suppress(FileNotFoundError):  # it was deleted
                folder = Path.cwd()
            result = folder / result.name
        names = chain([result.stem], (f"{result.stem}-{number}" for number in count(2)))
        return next(path for name in names if not (path := result.with_name(name + result.suffix)).exists())

    def _solve(self, form: Form) -> dict[str, Any]:
        """Deblur the crop that the form names."""
        begin = time.perf_counter()
        scale = max(0.2, min(float(form.get("scale", 1.0)), 1.0))
        with self._busy, _warnings() as notes:
            words, basis = self._tuned(form)
            # The options by which the command deblurs as the page does.
            chosen = any(word.startswith("--saturation") for word in words)
            as_here = ["--no-refine", *([] if chosen else ["--saturation", "ignore"])]
            ready = self._engine.read(words)
            options = replace(ready.options, check=bool(form.get("check")))
            picture, log, camera, exposure = ready.inputs
            left, top, width, height = map(int, form["box"])
            # Larger crops would be solved too slowly.
            crop = Crop(left, top, min(width, 1024), min(height, 1024)).within(camera)
            with ready.naming:
                result = solve_crop(picture.pixels, log, camera, exposure, options, basis, crop, scale=scale)
        answer = _shown(result, ready, crop, draft=scale < 1.0)
        name, value = basis.strength
        line = shell_line([*map(self._known, [*words, *as_here, "-o", path_of(form, "output")])])
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
            basis = basis.with_strength(float(strength))
        return words, basis

    def _derived(self, words: tuple[str, ...], *_: FileState) -> Basis:
        """Derive the strengths of a whole picture; kept for each choice of files, mode and prior."""
        ready = self._engine.read(words)
        picture, log, camera, exposure = ready.inputs
        with ready.naming:
            return derive_basis(picture.pixels, log, camera, exposure, replace(ready.options, check=False))

    def _save(self, form: Form) -> dict[str, Any]:
        """Deblur and write the whole picture, as `rsdeblur deblur` does; the page asks for the progress meanwhile."""
        if not text_of(form, "output"):
            raise InputError("choose the name of the result")
        if not self._saving.acquire(blocking=False):
            raise InputError("a picture is being saved")
        try:
            with self._busy, _warnings():
                output = Path(path_of(form, "output"))
                if output.exists():
                    # The page has no --force.
                    raise OutputError(f"{output}: the file exists; choose another name")
                words, _ = self._tuned(form)
                self._job = Job()
                return self._engine.save(words, output, self._job.move)
        finally:
            self._saving.release()

    def _cancel(self, form: Form) -> dict[str, Any]:
        self._job.cancelled = True
        return asdict(self._job)


def _plainly(action: Action) -> Action:
    """Return an action whose errors and notes call the files as the user does."""

    def call(form: Form) -> Mapping[str, Any]:
        try:
            answer = action(form)
        except RsdeblurError as error:
            raise type(error)(plain(str(error))) from error
        except OSError as error:
            raise OutputError(plain(f"{error.filename or 'a file'}: {error.strerror or error}")) from error
        return {**answer, "notes": [plain(note) for note in answer["notes"]]} if "notes" in answer else answer

    return call


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collect the texts of the package's warnings, which are complete after the block."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RsdeblurWarning)
        yield texts
        own = (str(each.message) for each in caught if issubclass(each.category, RsdeblurWarning))
        texts += dict.fromkeys(own)


def _axes_of(camera: Camera) -> str:
    """Return the name of the axes of the log in this camera, empty if they have none."""
    # Phones come before Gyroflow's axes, which equal those of a phone held sideways.
    known = {"camera": np.eye(3)} | {name: imu_to_camera(name) for name in reversed(PRESETS)}
    return next((name for name, matrix in known.items() if np.allclose(matrix, camera.imu_to_camera)), "")


def _shown(result: DeblurResult, ready: Ready, crop: Crop, *, draft: bool) -> dict[str, Any]:
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
