"""Options that several commands share, made of one table: the fields of `Options` and `Recording`.

A command receives each group as one value, so that a new field is an option of every command that takes the group.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from functools import wraps
from pathlib import Path
from typing import Any, Literal

import click

from rsdeblur.choices import Mode
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _types
from rsdeblur.cli._output import LEVEL, be_verbose, print_json, refuse_inputs, say, warn
from rsdeblur.errors import InputError
from rsdeblur.pipeline.options import BLUR, COMPUTING, SOLVER, Options

Function = Callable[..., Any]
Decorator = Callable[[Function], Function]

RECORDING, OUTPUT = "Recording", "Output"
# Sections of the help in their order; options of a command's own come first.
SECTIONS = ("Options", RECORDING, BLUR, SOLVER, COMPUTING, OUTPUT)
# Options of the short help; of the section "Options", it lists those that are not special.
BASIC = {"gyro", "camera", "capture", "index", "start", "duration", "psf", "quality", "mode", "modes", "output"}
BASIC |= {"force", "report", "help_all"}
SPECIAL = {"readout_direction", "timestamp_marks", "distortion_model", "distortion", "format", "fps"}
# Key of the context's `meta` that lists all options.
ALL = "rsdeblur.all"
# Why options are refused.
ONE_OF_MANY = "is one moment, but each photo has its own; leave it out"
FOR_PHOTOS = "is for photos; the frames of a video are counted from its first one"


class Option(click.Option):
    """An option with its section of the help."""

    def __init__(self, *args: Any, section: str = "Options", **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.section = section

    @property
    def is_basic(self) -> bool:
        """Whether the short help lists the option."""
        return self.name in BASIC or (self.section == "Options" and self.name not in SPECIAL)


def option(*flags: str, section: str = "Options", **facts: Any) -> Decorator:
    """Return a decorator that adds an option of a section."""
    return click.option(*flags, cls=Option, section=section, **facts)


def together(*options: Decorator) -> Decorator:
    """Return a decorator that adds several options in their order."""

    def decorate(function: Function) -> Function:
        for each in reversed(options):
            function = each(function)
        return function

    return decorate


def _set_level(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        level = 1 if param.name == "verbose" else -1
        if ctx.meta.setdefault(LEVEL, level) != level:
            raise click.UsageError("--quiet and --verbose exclude each other", ctx)
        if level > 0:
            be_verbose(ctx)


def _show_all(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        ctx.meta[ALL] = True
        say(*ctx.get_help().splitlines())
        ctx.exit()


class Command(click.Command):
    """A command with --quiet and --verbose. The help of one with many options lists the basic ones only."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        shared: dict[str, Any] = {"section": OUTPUT, "is_flag": True, "expose_value": False}
        quiet, verbose = "Print errors only, and JSON.", "Print the inputs and the stages of the work too."
        for flags, text in ((("-q", "--quiet"), quiet), (("-v", "--verbose"), verbose)):
            self.params.append(Option(flags, callback=_set_level, help=text, **shared))
        self._has_many = len(self.params) > 15
        if self._has_many:
            text = f"Show all {sum(isinstance(each, Option) for each in self.params)} options."
            self.params.append(Option(("--help-all",), is_eager=True, callback=_show_all, help=text, **shared))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the basic options with the first sentences of their helps, or all in sections."""
        if self._has_many and ALL not in ctx.meta:
            rows = []
            for each in self.params:
                if isinstance(each, Option) and each.is_basic and (record := each.get_help_record(ctx)):
                    rows.append((record[0], f"{str(each.help).partition('. ')[0].rstrip('.')}."))
            with formatter.section("Options"):
                formatter.write_dl(rows, col_max=22)
            return
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in SECTIONS}
        for each in self.get_params(ctx):
            if (record := each.get_help_record(ctx)) is not None:
                sections[each.section if isinstance(each, Option) else OUTPUT].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def _given(kind: click.ParamType[Any] | None, text: str, **facts: Any) -> Any:
    """Return a field of `Recording` with the type and the help of its option."""
    return field(default=None, metadata={"section": RECORDING, "help": text, "type": kind, **facts})


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """Files and values that give the log, the camera and the exposure; what is not given is None."""

    gyro: Path = _given(_types.PATH, "Gyro log; that of a video may be the video itself.", metavar="LOG")
    gyro_format: str | None = _given(None, "Format of the log.  [default: recognised by its content]", metavar="NAME")
    unit: str | None = _given(
        click.Choice(["rad/s", "deg/s", "mrad/s", "mdeg/s"]), "Unit of the log's rates; replaces the file's."
    )
    orientation: str | None = _given(
        None, "Axes of the log as an orientation string of Gyroflow, like YxZ; replaces the file's.", metavar="XYZ"
    )
    columns: str | None = _given(
        None,
        "Columns of a table by names or numbers, with units: `t=time:us,gx=3,gy=4,gz=5` of the log; after a semicolon "
        "`t,exposure` of --capture.",
        metavar="T=COLUMN,...",
    )
    rate: float | None = _given(_types.POSITIVE, "Sampling rate of a log without timestamps.", metavar="HZ")
    bias: tuple[float, float, float] | None = _given(
        _types.RATES,
        "Rates of the log at rest, which are subtracted: 0.01,-0.02,0.005 in rad/s, or -1.8,0,0.1deg/s.",
    )
    camera: Path = _given(
        _types.PATH,
        "Camera file, or a photo with EXIF. Files of Gyroflow and Kalibr are read too.",
        metavar="FILE",
    )
    capture: Path | None = _given(_types.PATH, "Metadata file that contains the exposures.", metavar="FILE")
    index: int | None = _given(_types.INDEX, "Number of the exposure in --capture, counted from 0.")
    numbered_from: int | None = _given(
        click.IntRange(0, 1), "Number of the first frame in the photos' names.  [default: derived from the names]"
    )
    start: float | Literal["exif"] | None = _given(
        _types.START,
        "Start of the first row on the log's clock, or exif. In s, in videos that of the first frame; exif is the time "
        "in the photo's EXIF block, which the picture then makes exact.",
    )
    start_ns: int | None = _given(
        _types.NANOSECONDS,
        "The same as a timestamp in ns, camera clock, unless the camera file sets timestamp_marks.",
    )
    duration: float | None = _given(
        _types.DURATION,
        "Exposure time of a row: 0.05, 1/20 or 50ms.  [default: from the metadata or EXIF]",
    )
    time_offset: float | None = _given(_types.SECONDS, "Camera time minus gyro time; replaces the camera file's.")
    readout_time: float | None = _given(_types.READOUT, "Readout time of the picture; replaces the camera file's.")
    focal_length: float | None = _given(
        _types.POSITIVE,
        "Focal length along x in px; replaces the camera file's. That along y keeps its ratio to it.",
        metavar="PX",
    )
    drift: tuple[float, float] | None = _given(
        _types.PAIR, "Shift of the scene, in px during the exposure, that the gyro does not measure."
    )


FILES = ("gyro", "camera", "capture")
READING = ("gyro_format", "unit", "orientation", "columns", "rate")
ONE_PHOTO = tuple(each.name for each in fields(Recording) if each.name != "numbered_from")
# Options of commands for several photos or frames, which have moments of their own.
MANY = tuple(name for name in ONE_PHOTO if name != "drift")
SERIES = (*MANY, "numbered_from")
FOLDER = tuple(name for name in SERIES if name != "index")
CLIP = tuple(name for name in MANY if name != "index")
SOLVE = tuple(each.name for each in fields(Options) if each.metadata.get("help"))


def flag(name: str) -> str:
    """Return the option of a name of Python."""
    return f"--{name.replace('_', '-')}"


def _option_of(each: Field[Any], *, required: bool) -> Decorator:
    """Return the option of a field of the table."""
    facts = each.metadata
    if isinstance(each.default, bool):
        return option(flag(each.name), section=facts["section"], is_flag=True, help=facts["help"])
    kind = click.Choice(facts["choices"]) if "choices" in facts else facts.get("type")
    return option(
        flag(each.name),
        section=facts["section"],
        type=_types.KINDS[facts["kind"]] if "kind" in facts else kind,
        metavar=facts.get("metavar"),
        required=required,
        # With any default, even None, click takes an option for given.
        **({} if each.default is None else {"default": each.default}),
        show_default=facts.get("shown", each.default is not None),
        help=facts["help"],
    )


def _options_of(table: Any, names: Sequence[str], required: Sequence[str] = ()) -> dict[str, Decorator]:
    return {name: _option_of(table.__dataclass_fields__[name], required=name in required) for name in names}


def _gathered(
    argument: str, options: Mapping[str, Decorator], make: Callable[[dict[str, Any], dict[str, Any]], Any]
) -> Decorator:
    """Return a decorator that adds options, and passes what `make` returns for their values and the other arguments."""

    def decorate(function: Function) -> Function:
        @wraps(function)
        def call(**others: Any) -> Any:
            values = {name: others.pop(name) for name in options}
            return function(**others, **{argument: make(values, others)})

        return together(*options.values())(call)

    return decorate


def recording_options(*names: str, required: Sequence[str] = ("gyro", "camera")) -> Decorator:
    """Return a decorator that adds the options called `names` and passes them as one `recording: Recording`."""
    return _gathered("recording", _options_of(Recording, names, required), lambda values, _: Recording(**values))


def solve_options(*names: str) -> Decorator:
    """Return a decorator that adds the options called `names` and passes them as one `options: Options`."""
    return _gathered("options", _options_of(Options, names), _checked)


def _checked(values: dict[str, Any], _: Any) -> Options:
    options = changed(Options(), **values)
    if "mode" in values:
        refuse_unused(options, [options.mode_in_effect])
    if "prior" in values and options.nsr != "auto" and options.prior_in_effect != "wiener":
        warn(
            f"--nsr is the strength of --prior wiener; with {options.prior_name} it only smooths: set --weight instead"
        )
    return options


def changed(options: Options, **values: Any) -> Options:
    """Return other options; those that contradict each other are wrong usage."""
    try:
        return replace(options, **values)
    except InputError as error:
        raise click.UsageError(f"{flag(error.argument)}: {error}" if error.argument else str(error)) from error


def refuse_unused(options: Options, modes: Sequence[Mode]) -> None:
    """Raise `click.UsageError` if an option is set that none of the modes uses."""
    for each in fields(Options):
        used = each.metadata.get("modes", modes)
        if getattr(options, each.name) != each.default and set(used).isdisjoint(modes):
            raise click.UsageError(
                f"{flag(each.name)} has no effect with --mode {' and '.join(modes)}; use --mode {' or '.join(used)}"
            )


def refuse_given(why: str, **values: object) -> None:
    """Raise `click.UsageError` if one of these options is given: it would have no effect, and `why` says so."""
    for name, value in values.items():
        if value is not None:
            raise click.UsageError(f"{flag(name)} {why}")


def require(recording: Recording, *names: str) -> None:
    """Raise `click.UsageError` if options of the recording are missing."""
    missing = [flag(name) for name in names if getattr(recording, name) is None]
    if missing:
        raise click.UsageError(
            f"{' and '.join(missing)} missing: give a gyro log" + " and a camera" * ("camera" in names)
        )


transfer_option = _option_of(Options.__dataclass_fields__["transfer"], required=False)
refine_option = option(
    "--refine/--no-refine",
    section=BLUR,
    default=None,
    help="Correct focal length, clock, readout and motion by the picture first; takes some seconds.  [default: yes, "
    "unless --quality is fast or --max-memory is given]",
)


def jobs_option(what: str, default: str) -> Decorator:
    """Return the option of the number of processes or frames, with a description of its default."""
    return option(
        "--jobs",
        section=COMPUTING,
        type=_types.COUNT,
        metavar="N",
        help=f"Number of {what}; --threads applies to each of them.  [default: {default}]",
    )


def shared_threads(jobs: int | None, threads: int | None, *, least: int = 2) -> tuple[int, int]:
    """Return the number of tasks at a time and of threads in each, `least` or more: as given, else to use all cores."""
    cores = rs.thread_count(None)
    jobs = jobs or max(1, cores // (threads or least))
    return jobs, threads or max(1, cores // jobs)


def with_refinement(options: Options, asked: bool | None) -> Options:
    """Return the options of photos, which are refined unless that would be slow or impossible, or as asked."""
    if asked is None:
        asked = options.quality != "fast" and options.max_memory is None
    return changed(options, refine=asked)


@dataclass(frozen=True, slots=True)
class Target:
    """File or folder of the result, None where nothing is written, and what the command prints."""

    output: Path
    force: bool = False
    as_json: bool = False
    dry_run: bool = False

    def show(self, facts: Any, *lines: object) -> None:
        """Print facts as JSON if that was asked for, otherwise lines."""
        if self.as_json:
            print_json(facts)
        else:
            say(*lines)


def target_options(
    metavar: str | None = None, text: str = "", *, default: Callable[..., Path] | None = None, dry_run: bool = False
) -> Decorator:
    """Return a decorator that adds --json, and of commands that write --output, --force and --dry-run, as one `target`.

    An output that is an input of the command is refused. `default` returns the output where none is given, from the
    other arguments of the command.
    """
    options = {"as_json": option("--json", "as_json", section=OUTPUT, is_flag=True, help="Print JSON.")}
    if metavar is not None:
        output = option("-o", "--output", section=OUTPUT, type=_types.PATH, metavar=metavar, help=text)
        force = option("--force", section=OUTPUT, is_flag=True, help="Replace files that exist.")
        options = {"output": output, "force": force} | options
    if dry_run:
        text = "Read and check all inputs, and write nothing."
        options["dry_run"] = option("--dry-run", section=OUTPUT, is_flag=True, help=text)

    def make(values: dict[str, Any], others: dict[str, Any]) -> Target:
        output = values.pop("output", None)
        if output is None and default is not None:
            output = default(**others)
        if output is not None:
            refuse_inputs(output)
        return Target(output, **values)

    return _gathered("target", options, make)


def beside(source: Path, ending: str) -> Path:
    """Return the path beside a file or folder that has its name, without extension, and an ending."""
    if not source.name.strip("."):
        # The names of . and .. are those of the folders that they mean.
        source = source.resolve()
    return Path(f"{source if source.is_dir() else source.with_suffix('')}{ending}")
