"""Wrong usage: options that exclude each other, or that have no effect with a mode or prior."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.errors import InputError, RsdeblurWarning
from rsdeblur.pipeline.options import Options

if TYPE_CHECKING:
    from rsdeblur.choices import Mode

# Options that have no effect with a mode.
UNUSED: dict[Mode, tuple[str, ...]] = {
    "global": ("bands", "strips"),
    "banded": (),
    "rowwise": ("bands",),
}


def options_of(**values: Any) -> Options:
    """Return the options of a solver; those that contradict each other or have no effect are wrong usage.

    A command without the option `mode` among them calls `refuse_unused` itself.
    """
    with usage_errors():
        options = Options(**values)
    if "mode" in values:
        refuse_unused(options, [options.mode_in_effect])
    if "prior" in values and options.nsr != "auto":
        _warn_of_nsr(options)
    return options


@contextmanager
def usage_errors() -> Iterator[None]:
    """Turn a refusal of `Options` into wrong usage, in the words of the command line."""
    try:
        yield
    except InputError as error:
        keyword = r'\b([a-z_]+)=(?:"([^"]*)"|True)'
        text = re.sub(keyword, lambda match: f"{_flag(match[1])} {match[2] or ''}".rstrip(), str(error))
        raise click.UsageError(text.replace("max_memory", "--max-memory")) from error


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def refuse_unused(options: Options, modes: Sequence[Mode]) -> None:
    """Raise `click.UsageError` if an option is set that none of the modes uses."""
    for name in ("bands", "strips"):
        if getattr(options, name) != "auto" and all(name in UNUSED[mode] for mode in modes):
            used = " or ".join(f"--mode {mode}" for mode, unused in UNUSED.items() if name not in unused)
            raise click.UsageError(f"{_flag(name)} has no effect with --mode {' and '.join(modes)}; use {used}")


def _warn_of_nsr(options: Options) -> None:
    """Warn if the noise-to-signal ratio, which is set, is not the strength of the prior."""
    if options.prior_in_effect != "wiener":
        prior = options.prior_name
        warnings.warn(
            f"--nsr is the strength of --prior wiener; with {prior} it only smooths: set --weight instead",
            RsdeblurWarning,
            stacklevel=2,
        )
