"""Commands whose help lists options in sections, and which can say less (--quiet) or more (--verbose)."""

from __future__ import annotations

from typing import Any

import click

from rsdeblur.cli._output import LEVEL

# Section of options that no other section lists; it comes first.
REST = "Options"
SECTIONS = {
    "Recording": (
        *("gyro", "gyro_format", "unit", "orientation", "rate", "bias", "camera", "capture", "index", "start_ns"),
        *(
            "start",
            "duration",
            "time_offset",
            "readout_time",
            "focal_length",
            "translation",
            "translation_axes",
            "depth",
            "drift",
        ),
        *("numbered_from", "psf"),
    ),
    "Blur": ("mode", "bands", "strips", "motion", "softness", "geometry", "refine"),
    "Solver": (
        *("quality", "prior", "weight", "exponent", "nsr", "noise", "chroma", "border"),
        *("transfer", "normalize", "saturation", "fallback"),
    ),
    "Computing": ("threads", "max_memory", "jobs", "scheduler"),
    "Output": (
        *(
            "output",
            "force",
            "dry_run",
            "sign",
            "sign_key",
            "sign_time",
            "json",
            "report",
            "report_paths",
            "codec",
            "crf",
            "quiet",
            "verbose",
            "help",
        ),
    ),
}
# A shorter list of options needs no sections.
LEAST_OPTIONS = 12


def _set_level(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        level = 1 if param.name == "verbose" else -1
        if ctx.meta.setdefault(LEVEL, level) != level:
            raise click.UsageError("--quiet and --verbose exclude each other", ctx)


class Command(click.Command):
    """A command with --quiet and --verbose."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        quiet, verbose = "Print errors only, and JSON.", "Print the inputs and the stages of the work too."
        for flags, text in ((("-q", "--quiet"), quiet), (("-v", "--verbose"), verbose)):
            self.params.append(click.Option(flags, is_flag=True, expose_value=False, callback=_set_level, help=text))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options in sections."""
        options = [param for param in self.get_params(ctx) if isinstance(param, click.Option)]
        titles = {name: title for title, names in SECTIONS.items() for name in names}
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in (REST, *SECTIONS)}
        for option in options:
            record = option.get_help_record(ctx)
            if record is not None:
                name = max(option.opts, key=len).lstrip("-").replace("-", "_")
                title = REST if len(options) < LEAST_OPTIONS else titles.get(name, REST)
                sections[title].append(record)
        for title, records in sections.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)
