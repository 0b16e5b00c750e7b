"""`rsdeblur app`: a local page that deblurs a crop while its sliders move."""

import signal
from pathlib import Path
from typing import Any

import click
import platformdirs
from click.core import ParameterSource

from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._options import MANY, Command, Recording, option
from rsdeblur.cli._output import say
from rsdeblur.cli._types import PATH

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
        rs.Desk(names, _given(click.get_current_context()), settings) as desk,
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
