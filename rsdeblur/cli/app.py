"""`rsdeblur app`: a local page that deblurs a crop while its sliders move."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import click
import platformdirs
from click.core import ParameterSource

from rsdeblur._util.files import file_state
from rsdeblur.choices import CAMERA
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import Inputs, naming, read_recording, with_exif
from rsdeblur.cli._options import MANY, MANY_RESULTS, ONE_PHOTO, Command, Recording, option
from rsdeblur.cli._output import say, usage_as_input_error
from rsdeblur.cli._photo import PhotoJob, Prepared, deblur_photo, prepare
from rsdeblur.cli._types import PATH
from rsdeblur.cli.deblur import default_output
from rsdeblur.cli.demo import CAPTURE_LOG, KINDS, write_files
from rsdeblur.pipeline.options import Options

EXAMPLES = """\b
Examples:
  rsdeblur app photo.jpg --gyro gyro.csv
  rsdeblur app
"""


@click.command("app", cls=Command, epilog=EXAMPLES)
@click.argument("photos", metavar="[PHOTO]...", nargs=-1, type=PATH)
@_options.recording_options(*MANY, required=())
@option("--port", type=click.IntRange(0, 65535), default=0, help="Port of the page.  [default: a free one]")
@option("--no-browser", is_flag=True, help="Print the address, and open no browser.")
def command(photos: tuple[Path, ...], recording: Recording, port: int, no_browser: bool) -> None:
    """Open a page that deblurs while its sliders move.

    The page is served to this machine only, and requests nothing from the network. It opens a photo and its gyro log,
    shows a crop with its PSFs and the check's verdict, copies the command for `rsdeblur deblur`, and saves the full
    picture with the same code. Ctrl-C ends it.
    """
    names, settings = [str(photo.absolute()) for photo in photos], platformdirs.user_config_path("rsdeblur")
    with (
        rs.Desk(engine(), names, _given(click.get_current_context()), settings) as desk,
        rs.LocalServer(rs.app_page(), desk.actions, desk.upload, port) as server,
    ):
        say(server.url, "Open this address in a browser of this machine; Ctrl-C ends the app.")
        if not no_browser:
            desk.uploads.browse(server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt as interrupt:
            # Ctrl-C is the usual way to end the app; other signals are reported as for every command.
            if interrupt.args[:1] not in ((), (signal.SIGINT,)):
                raise


def engine() -> rs.Engine:
    """Return what the page needs of `rsdeblur deblur` and `rsdeblur demo`."""
    return rs.Engine(_read, _save, default_output, _example)


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
@_options.recording_options(*ONE_PHOTO, required=())
@_options.solve_options(*MANY_RESULTS)
def _parse(photo: Path, recording: Recording, options: Options) -> tuple[Path, Recording, Options]:
    return photo, with_exif(recording, photo), options


_picture = lru_cache(maxsize=1)(lambda photo, state: rs.read_picture(photo))


def _read(words: Sequence[str]) -> Prepared:
    """Prepare a photo as `rsdeblur deblur` does, with a picture that is kept."""
    with usage_as_input_error():
        photo, recording, options = _parse.main(list(words), "rsdeblur deblur", standalone_mode=False)
        inputs = None
        if recording.start != "exif":
            log, camera, exposure = read_recording(recording, photo)
            inputs = Inputs(_picture(photo, file_state(photo)), log, camera, exposure)
            with naming(photo):
                rs.check_size(inputs.picture.pixels.shape, camera)
        return prepare(photo, recording, options, refine_anyway=False, inputs=inputs)


def _save(words: Sequence[str], output: Path, move: rs.Progress) -> dict[str, Any]:
    with usage_as_input_error():
        photo, recording, options = _parse.main(list(words), "rsdeblur deblur", standalone_mode=False)
        return deblur_photo(PhotoJob(photo=photo, recording=recording, options=options, output=output), move)


def _example(folder: Path) -> dict[str, str]:
    kind = KINDS["capture"]
    write_files("capture", (640, 480), 0, folder, force=False)
    files = {"photo": folder / "blurred.png", "gyro": folder / CAPTURE_LOG, "camera": folder / CAMERA}
    moment = {"start": str(kind.start), "duration": str(kind.duration)}
    return {name: str(path) for name, path in files.items()} | moment
