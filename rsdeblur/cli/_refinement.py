"""The option to correct a recording by its picture, and what commands report about a correction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli._output import level
from rsdeblur.cli._usage import usage_errors

if TYPE_CHECKING:
    from rsdeblur.estimate.refine import Refinement
    from rsdeblur.pipeline.options import Options

option = click.option(
    "--refine/--no-refine",
    default=None,
    help="Correct focal length, clock, readout and motion by the picture first; takes some seconds.  [default: yes, "
    "unless --quality is fast or --max-memory is given]",
)


def with_refinement(options: Options, asked: bool | None) -> Options:
    """Return the options of photos, which are refined unless that would be slow or impossible, or as asked."""
    if asked is None:
        asked = options.quality != "fast" and options.max_memory is None
    with usage_errors():
        return replace(options, refine=asked)


def refinement_facts(refinement: Refinement) -> dict[str, Any]:
    """Return the facts about a correction of the recording, for JSON."""
    return {
        "accepted": refinement.accepted,
        "reason": refinement.reason,
        "values": asdict(refinement.values),
        "sd": asdict(refinement.sd),
        "confidence": refinement.confidence,
        "gain": refinement.gain,
        "fall": refinement.fall,
        "regions": None if refinement.regions is None else refinement.regions.tolist(),
    }


def correction_lines(facts: Mapping[str, Any] | None, *, asked: bool) -> list[str]:
    """Return a line about the correction of the recording, if there is one or it was asked for."""
    if facts is None or not (asked or facts["accepted"] or level() > 0):
        return []
    return ["  " + correction_text(facts)]


def correction_text(facts: Mapping[str, Any]) -> str:
    """Return a sentence about a correction of the recording, of which `refinement_facts` are given."""
    if not facts["accepted"]:
        reason = facts["reason"]
        return f"Recording not corrected: {reason}{'' if reason.endswith('?') else '.'}"
    values = facts["values"]
    drift, acceleration = ((values[f"{name}_x"], values[f"{name}_y"]) for name in ("drift", "acceleration"))
    regions = facts["regions"]
    near = f" (x {min(map(min, regions)):g} to {max(map(max, regions)):g} by region)" if regions else ""
    numbers = {
        f"focal length x {math.exp(values['scale']):.3f}": values["scale"],
        "drift {:+.1f} and {:+.1f} px".format(*drift) + near: any(drift),
        "acceleration {:+.0f} and {:+.0f} px/s²".format(*acceleration): any(acceleration),
        f"time offset {1e3 * values['offset']:+.1f} ms": values["offset"],
        f"readout time x {math.exp(values['readout']):.2f}": values["readout"],
        f"roll bias {values['roll']:+.3f} rad/s": values["roll"],
    }
    return f"Recording corrected: {', '.join(text for text, changed in numbers.items() if changed)}."
