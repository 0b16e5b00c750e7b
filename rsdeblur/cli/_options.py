"""Options that several commands share; a command receives each group as one value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import wraps
from pathlib import Path
from typing import Any

import click

from rsdeblur import choices
from rsdeblur.cli._output import refuse_inputs
from rsdeblur.cli._types import (
    PATH,
    POSITIVE,
    AutoType,
    Bias,
    BiasType,
    BytesType,
    DepthType,
    NumberType,
    PairType,
    SecondsType,
    Start,
    StartType,
    StrengthType,
    TransferType,
)
from rsdeblur.cli._usage import options_of
from rsdeblur.pipeline.options import Options

Command = Callable[..., Any]
Decorator = Callable[[Command], Command]


@dataclass(frozen=True, slots=True, kw_only=True)
class Moments:
    """The gyro log, and the moments of one exposure or of the frames of a clip."""

    gyro: Path
    gyro_format: str | None = None
    unit: str | None = None
    orientation: str | None = None
    rate: float | None = None
    bias: Bias | None = None
    capture: Path | None = None
    start_ns: int | None = None
    start: Start | None = None
    duration: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording(Moments):
    """Files and values that give the log, the camera and the exposure."""

    camera: Path
    index: int | None = None
    time_offset: float | None = None
    readout_time: float | None = None
    focal_length: float | None = None


@dataclass(frozen=True, slots=True)
class Track:
    """File of the camera's positions, its axes, and the depth of the scene: m, or a map's file."""

    translation: Path | None = None
    translation_axes: str = "camera"
    depth: float | Path | None = None
    drift: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Defaults:
    """Values for the items of a batch that set none of their own; the names are those of `Recording`."""

    gyro: Path | None
    camera: Path | None
    gyro_format: str | None
    unit: str | None
    orientation: str | None
    rate: float | None
    bias: Bias | None
    capture: Path | None
    start: Start | None
    duration: float | None
    time_offset: float | None
    readout_time: float | None
    focal_length: float | None


@dataclass(frozen=True, slots=True)
class Target:
    """File or folder of the result, and what the command prints."""

    output: Path
    force: bool
    as_json: bool
    dry_run: bool = False


@dataclass(frozen=True, slots=True)
class PhotoTarget:
    """File or folder of the results of `deblur`, or None for files beside the photos, and what the command prints."""

    output: Path | None
    force: bool
    as_json: bool
    dry_run: bool

    def at(self, output: Path) -> Target:
        """Return the target of one photo."""
        return Target(output, self.force, self.as_json, self.dry_run)


def gathered(name: str, kind: type, options: Sequence[Decorator]) -> Decorator:
    """Return a decorator that adds `options` and passes their values as one argument `name`, a dataclass `kind`."""
    return _gathered(name, kind, [field.name for field in fields(kind)], options)


def _gathered(name: str, make: Callable[..., Any], members: Sequence[str], options: Sequence[Decorator]) -> Decorator:
    """Return a decorator that adds `options` and passes what `make` returns for the values of `members`."""

    def decorate(function: Command) -> Command:
        @wraps(function)
        def call(**arguments: Any) -> Any:
            group = make(**{member: arguments.pop(member) for member in members if member in arguments})
            return function(**arguments, **{name: group})

        decorated: Command = call
        for option in reversed(options):
            decorated = option(decorated)
        return decorated

    return decorate


_READING = (
    click.option("--gyro-format", metavar="NAME", help="Format of the log.  [default: recognised by its content]"),
    click.option(
        "--unit",
        type=click.Choice(["rad/s", "deg/s", "mrad/s", "mdeg/s"]),
        help="Unit of the log's rates; replaces the file's.",
    ),
    click.option(
        "--orientation",
        metavar="XYZ",
        help="Axes of the log as an orientation string of Gyroflow, like YxZ; replaces the file's.",
    ),
    click.option("--rate", type=POSITIVE, metavar="HZ", help="Sampling rate of a log without timestamps."),
)
_LOG = (
    *_READING,
    click.option(
        "--bias",
        type=BiasType(),
        help="Rates of the log at rest, which are subtracted: 0.01,-0.02,0.005 in rad/s, or -1.8,0,0.1deg/s.",
    ),
)


def log_options(function: Command) -> Command:
    """Add the options for reading a gyro log."""
    for option in reversed(_READING):
        function = option(function)
    return function


_EXPOSURE = (
    click.option("--capture", type=PATH, metavar="FILE", help="Metadata file that contains the exposure."),
    click.option(
        "--index", type=click.IntRange(min=0), metavar="N", help="Number of the exposure in --capture, counted from 0."
    ),
    click.option(
        "--start-ns",
        type=int,
        metavar="NS",
        help="Timestamp in ns, camera clock: the first row's start, unless the camera file sets timestamp_marks.",
    ),
    click.option(
        "--start",
        type=StartType(),
        help="The same in seconds on the log's own clock; or exif: the time in the photo's EXIF block, "
        "which the picture then makes exact.",
    ),
    click.option(
        "--duration",
        type=SecondsType(above=0.0),
        help="Exposure time of a row: 0.05, 1/20 or 50ms.  [default: from EXIF]",
    ),
)


def _camera(*, required: bool = True) -> Decorator:
    text = "Camera file of rsdeblur, Gyroflow or Kalibr, or a photo with EXIF."
    return click.option("--camera", type=PATH, required=required, metavar="FILE", help=text)


_OVERRIDES = (
    click.option("--time-offset", type=SecondsType(), help="Camera time minus gyro time; replaces the camera file's."),
    click.option(
        "--readout-time", type=SecondsType(minimum=0.0), help="Readout time of the picture; replaces the camera file's."
    ),
    click.option(
        "--focal-length",
        type=POSITIVE,
        metavar="PX",
        help="Focal length along x in px; replaces the camera file's. That along y keeps its ratio to it.",
    ),
)


def recording_options(*, required: bool = True) -> Decorator:
    """Return a decorator that adds the options of a recording and passes them as one `recording`.

    Unless they are `required`, the command itself must refuse to go on without a log and a camera.
    """
    log = click.option("--gyro", type=PATH, required=required, metavar="LOG", help="Gyro log.")
    return gathered("recording", Recording, (log, *_LOG, _camera(required=required), *_EXPOSURE, *_OVERRIDES))


def _clip_log(*, required: bool = True) -> tuple[Decorator, ...]:
    text = "Gyro log; may be the video itself."
    return click.option("--gyro", type=PATH, required=required, metavar="LOG", help=text), *_LOG


_CLIP_TIMES = (
    click.option("--capture", type=PATH, metavar="FILE", help="Metadata file with one line per frame."),
    click.option("--start-ns", type=int, metavar="NS", help="Timestamp of the first frame in ns, camera clock."),
    click.option("--start", type=SecondsType(), help="The same in seconds on the log's own clock.  [default: 0]"),
    click.option(
        "--duration",
        type=SecondsType(above=0.0),
        help="Exposure time of a row; replaces that of --capture or of the video.",
    ),
)


def clip_options(*, required: bool = True) -> Decorator:
    """Return a decorator that adds the options of a clip's recording; see `recording_options`."""
    options = (*_clip_log(required=required), _camera(required=required), *_CLIP_TIMES, *_OVERRIDES)
    return gathered("recording", Recording, options)


calibration_options = gathered("recording", Moments, (*_clip_log(required=False), *_CLIP_TIMES))
defaults_options = gathered(
    "defaults",
    Defaults,
    (
        click.option("--gyro", type=PATH, metavar="LOG", help="Gyro log of photos that name none."),
        *_LOG,
        click.option("--camera", type=PATH, metavar="FILE", help="Camera file of photos that name none."),
        click.option("--capture", type=PATH, metavar="FILE", help="Metadata file of photos that name none."),
        click.option("--start", type=click.Choice(["exif"]), help="Take the photos' times from EXIF; see deblur."),
        click.option(
            "--duration", type=SecondsType(above=0.0), help="Exposure time of other photos.  [default: from EXIF]"
        ),
        *_OVERRIDES,
    ),
)
track_options = gathered(
    "track",
    Track,
    (
        click.option(
            "--translation",
            type=PATH,
            metavar="FILE",
            help="Track of the camera from another program, on the camera's clock: `t tx ty tz qx qy qz qw`.",
        ),
        click.option(
            "--translation-axes",
            metavar="AXES",
            default="camera",
            show_default=True,
            help="Axes of the body that --translation tracks: camera, imu, phone-portrait (ARKit, ARCore), YxZ.",
        ),
        click.option(
            "--depth",
            type=DepthType(),
            help="Distance of the scene, for --translation, or a file that maps it over the photo as stored: 16 bits "
            "in mm, floats in m.",
        ),
        click.option(
            "--drift",
            type=PairType(),
            help="Shift of the scene, in px during the exposure, that the gyro does not measure.",
        ),
    ),
)
_DEFAULTS: dict[str, Any] = {field.name: field.default for field in fields(Options)}


def _choice(name: str, values: Sequence[str], text: str, *, shown: str | bool = True) -> Decorator:
    """Return the option for a named choice of `Options`."""
    default = _DEFAULTS[name]
    return click.option(f"--{name}", type=click.Choice(values), default=default, show_default=shown, help=text)


def _auto(name: str, kind: click.ParamType[Any], text: str) -> Decorator:
    """Return the option for a number of `Options` that may be `auto`."""
    return click.option(
        f"--{name}", type=kind, metavar=kind.name, default=_DEFAULTS[name], show_default=True, help=text
    )


transfer_option = click.option(
    "--transfer",
    type=TransferType(),
    metavar="auto|linear|srgb|GAMMA",
    default=_DEFAULTS["transfer"],
    show_default=True,
    help="How pixel values encode light; auto means srgb for 8 and 16 bits, linear for floating point.",
)
# The options of `Options`, by its fields.
_SOLVE: dict[str, Decorator] = {
    "quality": _choice(
        "quality",
        tuple(choices.QUALITIES),
        "Mode and prior together: banded with wiener, or banded or rowwise with hyper-laplacian.",
    ),
    "mode": _choice(
        "mode", choices.MODES, "One PSF for the picture, one per tile, or one per row.", shown="by --quality"
    ),
    "bands": _auto("bands", AutoType(), "Number of bands, which divide the picture along the readout."),
    "strips": _auto("strips", AutoType(), "Number of strips, which divide it across the readout."),
    "motion": _choice("motion", choices.MOTIONS, "Full rotation, or small angles about x and y only."),
    "softness": click.option(
        "--softness",
        type=NumberType(0.0, 1.0),
        metavar="PX",
        default=_DEFAULTS["softness"],
        show_default=True,
        help="Blur of lens, pixels and demosaicing to undo as well: the standard deviation of a Gaussian, up to 1 px.",
    ),
    "prior": _choice(
        "prior",
        choices.PRIORS,
        "Assumption about sharp pictures; wiener is the published filter, and the fastest.",
        shown="by --quality",
    ),
    "weight": _auto(
        "weight", StrengthType(), "Weight of the prior (not wiener): a higher one gives a smoother picture."
    ),
    "exponent": click.option(
        "--exponent",
        type=NumberType(min=0.0, min_open=True, max=1.0),
        metavar="P",
        default=_DEFAULTS["exponent"],
        show_default="2/3",
        help="Exponent of the hyper-Laplacian.",
    ),
    "nsr": _auto("nsr", StrengthType(), "Noise-to-signal ratio: a higher one gives a smoother picture."),
    "noise": _auto(
        "noise", StrengthType(), "Standard deviation of the noise in linear light, where white is 1; auto estimates it."
    ),
    "chroma": _choice(
        "chroma",
        ("auto", *choices.CHROMAS),
        "Resolution of the colours: full, or half as in JPEG, in less time; auto is half for tv and "
        "hyper-laplacian, and with --quality fast, except in --mode rowwise.",
    ),
    "geometry": _choice("geometry", choices.GEOMETRIES, "Keep the rolling-shutter shape, or straighten it."),
    "border": _choice(
        "border",
        ("auto", *choices.BORDERS, *choices.BOUNDARIES),
        "Picture beyond the frame: blended, periodic or unknown; auto is unknown for --psf, otherwise blend.",
    ),
    "transfer": transfer_option,
    "normalize": click.option(
        "--normalize", is_flag=True, help="Compress light that exceeds the range into it, at the price of contrast."
    ),
    "saturation": _choice(
        "saturation",
        choices.SATURATIONS,
        "Solve without clipped highlights and add them afterwards, which leaves fewer streaks: always, or (auto) by "
        "night and where small ones cover at most 0.5% of the picture, except with --quality fast and --max-memory.",
    ),
    "threads": click.option(
        "--threads", type=click.IntRange(min=1), metavar="N", help="Number of threads.  [default: all cores]"
    ),
    "max_memory": click.option(
        "--max-memory",
        type=BytesType(),
        help="Memory for the work, without the picture and its result, like 1GiB; little memory takes longer.",
    ),
    "refine": click.option(
        "--refine",
        is_flag=True,
        help="Correct focal length, clock, readout and motion by the picture first; takes some seconds.",
    ),
    "fallback": click.option(
        "--fallback", is_flag=True, help="Blend the result towards the photo if the check finds it bad."
    ),
}
BLUR = ("mode", "bands", "strips", "motion", "softness")
SOLVER = (
    *("quality", "prior", "weight", "exponent", "nsr", "noise", "chroma"),
    *("geometry", "border", "transfer"),
)
ENGINE = ("threads",)
ONE_PICTURE = ("normalize", "saturation")
ONE_PHOTO = (*BLUR, *SOLVER, *ONE_PICTURE, *ENGINE)
ONE_RESULT = ("max_memory", "fallback")


def solve_options(*names: str) -> Decorator:
    """Return a decorator that adds the options called `names` and passes them as one `options: Options`."""
    return _gathered("options", options_of, names, [_SOLVE[name] for name in names])


force_option = click.option("--force", is_flag=True, help="Replace files that exist.")
dry_run_option = click.option("--dry-run", is_flag=True, help="Read and check all inputs, and write nothing.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


def target_options(
    metavar: str,
    text: str,
    *,
    default: Callable[..., Path] | None = None,
    force: Decorator = force_option,
    dry_run: bool = False,
) -> Decorator:
    """Return a decorator that adds --output, --force, --json and, if requested, --dry-run as one `target`.

    An output that is an input of the command is refused. `default` returns the output where none is given, from the
    other arguments of the command; without it, --output is required.
    """
    output = click.option("-o", "--output", type=PATH, required=default is None, metavar=metavar, help=text)
    dry_runs = (dry_run_option,) if dry_run else ()
    gather = gathered("target", Target, (output, force, *dry_runs, json_option))

    def decorate(function: Command) -> Command:
        @wraps(function)
        def call(target: Target, **arguments: Any) -> Any:
            if default is not None and target.output is None:
                target = replace(target, output=default(**arguments))
            refuse_inputs(target.output)
            return function(target=target, **arguments)

        return gather(call)

    return decorate


def beside(source: Path, ending: str) -> Path:
    """Return the folder beside a file or folder that has its name, without extension, and an ending."""
    if not source.name.strip("."):
        # The names of . and .. are those of the folders that they mean.
        source = source.resolve()
    return Path(f"{source if source.is_dir() else source.with_suffix('')}{ending}")


photo_target_options = gathered(
    "target",
    PhotoTarget,
    (
        click.option(
            *("-o", "--output"),
            type=PATH,
            metavar="OUT|DIR",
            help="Picture to write, or folder for the results.  [default: PHOTO-sharp beside each photo]",
        ),
        *(force_option, dry_run_option, json_option),
    ),
)
