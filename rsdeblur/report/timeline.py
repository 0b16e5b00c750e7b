"""Plot of the blur over time, as an SVG file."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from rsdeblur.motion.triage import DECISIONS, Triage

WIDE, TALL = 960, 360
LEFT, RIGHT, TOP, BOTTOM = 56, 16, 34, 44
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
        return LEFT + (WIDE - LEFT - RIGHT) * (time - first) / ((last - first) or 1.0)

    def down(length: float) -> float:
        share = (np.log10(np.clip(length, LEAST, 10.0**high)) - low) / (high - low)
        return float(TALL - BOTTOM - (TALL - TOP - BOTTOM) * share)

    root = ElementTree.Element("svg", xmlns="http://www.w3.org/2000/svg", viewBox=f"0 0 {WIDE} {TALL}", width="100%")
    _add(root, "style").text = STYLE
    _add(root, "rect", {"class": "ground"}, width="100%", height="100%")
    for tick in 10.0 ** np.arange(low, high + 1):
        _add(root, "line", {"class": "grid"}, x1=LEFT, x2=WIDE - RIGHT, y1=down(tick), y2=down(tick))
        _add(root, "text", {"text-anchor": "end"}, x=LEFT - 6, y=down(tick) + 4).text = f"{tick:g}"
    for limit, meaning in ((triage.keep, "keep up to"), (triage.drop, "drop above")):
        if LEAST <= limit <= 10.0**high:
            place = down(limit)
            _add(root, "line", {"class": "limit"}, x1=LEFT, x2=WIDE - RIGHT, y1=place, y2=place)
            _add(root, "text", {"text-anchor": "end"}, x=WIDE - RIGHT - 6, y=place - 4).text = f"{meaning} {limit:g} px"
    for time, length, decision in zip(times, triage.lengths, triage.decisions, strict=True):
        if time is not None:
            height = down(LEAST if np.isnan(length) else length)
            _add(root, "circle", cx=across(time), cy=height, r=2.5, fill=COLOURS[decision])
    _add(root, "rect", {"class": "frame"}, x=LEFT, y=TOP, width=WIDE - LEFT - RIGHT, height=TALL - TOP - BOTTOM)
    for time in dict.fromkeys((first, last)):
        anchor = {"text-anchor": "start" if time == first else "end"}
        _add(root, "text", anchor, x=across(time), y=TALL - BOTTOM + 16).text = f"{time:.4g}"
    _add(root, "text", {"text-anchor": "middle"}, x=WIDE / 2, y=TALL - 10).text = "time, s"
    _add(root, "text", x=8, y=20).text = "longest path, px"
    for i, decision in enumerate(DECISIONS):
        _add(root, "circle", cx=LEFT + 140 + 130 * i, cy=16, r=4, fill=COLOURS[decision])
        label = _add(root, "text", x=LEFT + 150 + 130 * i, y=20)
        label.text = f"{decision}: {triage.counts[decision]}"
    drawing: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return drawing


def _add(
    parent: ElementTree.Element, tag: str, attributes: dict[str, str] | None = None, **places: object
) -> ElementTree.Element:
    texts = {name: f"{value:.1f}" if isinstance(value, float) else str(value) for name, value in places.items()}
    return ElementTree.SubElement(parent, tag, {**(attributes or {}), **texts})
