"""Plot of the blur over time, as an SVG file."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rsdeblur.motion.triage import DECISIONS, Triage

LEAST = 0.1  # px, where the logarithmic axis starts; shorter paths are drawn there
COLOURS: dict[str, str] = dict(zip(DECISIONS, ("#2a9d5c", "#2b7bba", "#c8443c", "#8a8a8a"), strict=True))
STYLE = (
    "text{font:12px sans-serif;fill:#333}.ground{fill:#fff}.frame{fill:none;stroke:#999}.grid{stroke:#ddd}"
    ".limit{stroke:#333;stroke-dasharray:5 4}"
    "@media(prefers-color-scheme:dark){text{fill:#ddd}.ground{fill:#15171a}.frame{stroke:#777}.grid{stroke:#363b42}"
    ".limit{stroke:#ddd}}"
)


def timeline_svg(times: Sequence[float | None], triage: Triage) -> bytes:
    """Return an SVG file of the blur of exposures over time, in s, coloured by decision, with both thresholds.

    Exposures whose time is None are not drawn; an unknown blur is drawn at the lower end of the axis.
    """
    left, top, right, bottom = 56, 34, 944, 316  # of the plot in a drawing of 960 x 360 px
    lengths = np.nan_to_num(triage.lengths, nan=LEAST).clip(LEAST)
    most = 10.0 ** np.ceil(np.log10(max([1.0, 2 * triage.keep, *lengths])))
    known = [time for time in times if time is not None] or [0.0]
    ends = min(known), max(max(known), min(known) + 1e-9)
    radius = 3.5 if len(known) < 100 else 2.5

    def down(length: float) -> float:
        return float(np.interp(np.log10(length), np.log10([LEAST, most]), [bottom, top]))

    def across(time: float) -> float:
        # The first and the last dot are inside the frame.
        return float(np.interp(time, ends, [left + 10, right - 10]))

    def text(x: float, y: float, words: str, anchor: str = "start") -> str:
        return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'

    def line(kind: str, length: float) -> str:
        return f'<path class="{kind}" d="M{left} {down(length):.1f}H{right}"/>'

    def dot(x: float, y: float, r: float, decision: str) -> str:
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{r}" fill="{COLOURS[decision]}"/>'

    parts = [f"<style>{STYLE}</style>", '<rect class="ground" width="100%" height="100%"/>']
    for tick in 10.0 ** np.arange(np.log10(LEAST), np.log10(most) + 1):
        parts += [line("grid", tick), text(left - 6, down(tick) + 4, f"{tick:g}", "end")]
    for limit, meaning in ((triage.keep, "keep up to"), (triage.drop, "drop above")):
        if LEAST <= limit <= most:
            parts += [line("limit", limit), text(right - 6, down(limit) - 4, f"{meaning} {limit:g} px", "end")]
    for time, length, decision in zip(times, lengths, triage.decisions, strict=True):
        if time is not None:
            parts.append(dot(across(time), down(length), radius, decision))
    parts.append(f'<path class="frame" d="M{left} {top}H{right}V{bottom}H{left}Z"/>')
    parts += [text(across(tick), bottom + 16, f"{tick:.3g}", "middle") for tick in np.linspace(*ends, 5)]
    parts += [text((left + right) / 2, bottom + 34, "time, s", "middle"), text(8, 20, "longest path, px")]
    for i, decision in enumerate(DECISIONS):
        x, label = left + 140 + 130 * i, f"{decision}: {triage.counts[decision]}"
        parts += [dot(x, 16, 4, decision), text(x + 10, 20, label)]
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 360" width="100%">'
    return f"{head}{''.join(parts)}</svg>\n".encode()
