"""Plot of the blur over time, as an SVG file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsdeblur.motion.triage import DECISIONS, Triage

WIDE, TALL = 960, 360
LEFT, RIGHT, TOP, BOTTOM = 56, 944, 34, 316
# px: the axis is logarithmic and ends here; shorter paths are drawn at its lower end.
LEAST, MOST = 0.1, 1000.0
COLOURS = {"keep": "#2a9d5c", "deblur": "#2b7bba", "drop": "#c8443c", "unknown": "#8a8a8a"}
STYLE = (
    "text{font:12px sans-serif;fill:#333}.ground{fill:#fff}.frame{fill:none;stroke:#999}.grid{stroke:#ddd}"
    ".limit{stroke:#333;stroke-dasharray:5 4}"
    "@media(prefers-color-scheme:dark){text{fill:#ddd}.ground{fill:#15171a}.frame{stroke:#777}.grid{stroke:#363b42}"
    ".limit{stroke:#ddd}}"
)


def timeline_svg(times: Sequence[float | None], triage: Triage) -> bytes:
    """Draw the blur of exposures over time, coloured by decision, with both thresholds.

    Parameters
    ----------
    times : sequence of float or None
        Time of each exposure, s; those without one are not drawn.
    triage : Triage
        Their blur; those whose blur is unknown are drawn at the lower end of the axis.

    Returns
    -------
    bytes
        An SVG file.
    """
    known = triage.lengths[np.isfinite(triage.lengths)]
    low, high = np.log10(LEAST), np.ceil(np.log10(np.clip(max([*known, 2 * triage.keep]), 1.0, MOST)))
    known_times = [time for time in times if time is not None]
    first, last = min(known_times, default=0.0), max(known_times, default=0.0)

    def across(time: float) -> float:
        return LEFT + (RIGHT - LEFT) * (time - first) / ((last - first) or 1.0)

    def down(length: float) -> float:
        share = (np.log10(np.clip(length, LEAST, 10.0**high)) - low) / (high - low)
        return float(BOTTOM - (BOTTOM - TOP) * share)

    def text(x: float, y: float, words: str, anchor: str = "start") -> str:
        return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'

    def line(kind: str, length: float) -> str:
        return f'<line class="{kind}" x1="{LEFT}" x2="{RIGHT}" y1="{down(length):.1f}" y2="{down(length):.1f}"/>'

    def dot(x: float, y: float, r: float, decision: str) -> str:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{COLOURS[decision]}"/>'

    parts = [f"<style>{STYLE}</style>", '<rect class="ground" width="100%" height="100%"/>']
    for tick in 10.0 ** np.arange(low, high + 1):
        parts += [line("grid", tick), text(LEFT - 6, down(tick) + 4, f"{tick:g}", "end")]
    for limit, meaning in ((triage.keep, "keep up to"), (triage.drop, "drop above")):
        if LEAST <= limit <= 10.0**high:
            parts += [line("limit", limit), text(RIGHT - 6, down(limit) - 4, f"{meaning} {limit:g} px", "end")]
    for time, length, decision in zip(times, triage.lengths, triage.decisions, strict=True):
        if time is not None:
            parts.append(dot(across(time), down(LEAST if np.isnan(length) else length), 2.5, decision))
    parts.append(f'<rect class="frame" x="{LEFT}" y="{TOP}" width="{RIGHT - LEFT}" height="{BOTTOM - TOP}"/>')
    for time in dict.fromkeys((first, last)):
        parts.append(text(across(time), BOTTOM + 16, f"{time:.4g}", "start" if time == first else "end"))
    parts += [text(WIDE / 2, TALL - 10, "time, s", "middle"), text(8, 20, "longest path, px")]
    for i, decision in enumerate(DECISIONS):
        label = f"{decision}: {triage.counts[decision]}"
        parts += [dot(LEFT + 140 + 130 * i, 16, 4, decision), text(LEFT + 150 + 130 * i, 20, label)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDE} {TALL}" width="100%">'
    return f"{head}{''.join(parts)}</svg>\n".encode()
