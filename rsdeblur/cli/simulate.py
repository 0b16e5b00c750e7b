"""`rsdeblur simulate`: blur a sharp picture."""

from pathlib import Path

import click

from rsdeblur.choices import Auto, Transfer
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import naming, read_inputs, transfer_of
from rsdeblur.cli._options import MANY, Command, Recording, Target, option
from rsdeblur.cli._output import prepare_folder, progress
from rsdeblur.cli._types import NOT_NEGATIVE, PATH

EXAMPLES = """\b
Examples:
  rsdeblur simulate sharp.png --gyro gyro.csv --camera phone.toml --start 1.0 --duration 1/20 --noise 0.01
"""


@click.command("simulate", cls=Command, epilog=EXAMPLES)
@click.argument("sharp", type=PATH)
@_options.recording_options(*MANY)
@_options.transfer_option
@option(
    "--noise",
    type=NOT_NEGATIVE,
    default=0.0,
    show_default=True,
    help="Standard deviation of the noise, in linear light from 0 to 1.",
)
@option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the noise.")
@option("--bits", type=click.Choice(["8", "16"]), default="8", show_default=True, help="Bits per channel.")
@_options.target_options(
    "DIR",
    "Folder to write to; by default SHARP-simulated beside the picture.",
    default=lambda sharp, **_: _options.beside(sharp, "-simulated"),
)
def command(
    sharp: Path, recording: Recording, transfer: Transfer | Auto, noise: float, seed: int, bits: str, target: Target
) -> None:
    """Blur SHARP as a shaking rolling-shutter camera would.

    The camera's picture is the middle of SHARP, which may be larger, so that the scene extends beyond the frame. Writes
    to DIR blurred.png and two sharp references: rectified.png (all rows at one time, the truth for --geometry rectify)
    and rolling.png (each row at its own time, the truth for --geometry keep).
    """
    paths = [target.output / f"{name}.png" for name in ("blurred", "rectified", "rolling")]
    prepare_folder(target.output, [path.name for path in paths], force=target.force)
    picture, log, camera, exposure = read_inputs(sharp, recording)

    encoding = transfer_of(picture, transfer)
    # PNG files are for display, so linear light is encoded.
    written: Transfer = "srgb" if encoding == "linear" else encoding
    light = rs.to_linear(rs.as_float(picture.pixels), encoding)
    with progress("simulate"), naming(sharp, recording):
        pictures = rs.simulate(light, log, camera, exposure, noise=noise, seed=seed)
    for path, values in zip(paths, pictures, strict=True):
        rs.write_picture(path, rs.from_linear(values.clip(0.0, 1.0), written), bits=int(bits), force=target.force)
    facts = {"outputs": [str(path) for path in paths], "size_px": [camera.width, camera.height]}
    target.show(facts, f"{', '.join(map(str, paths))}: {camera.width} x {camera.height} px")
