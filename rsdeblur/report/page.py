"""The report: one page of HTML that contains everything it shows, so that it needs no network."""

from __future__ import annotations

import base64
import hashlib
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from itertools import pairwise
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsdeblur._util.atomic import atomic_write
from rsdeblur._util.one_line import one_line
from rsdeblur.choices import VERDICTS
from rsdeblur.errors import InputError
from rsdeblur.psf import PsfBank
from rsdeblur.report.bands import BandFigures
from rsdeblur.report.embed import (
    MotionPlot,
    bank_data,
    motion_data,
    picture_uris,
    script_json,
    telling_place,
    weight_map_uri,
)
from rsdeblur.report.findings import Finding

LEVELS = {"warning": "Warning", "note": "Note", "good": "Good"}
PARTS = ("page.html", "page.css", "page_shared.js", "page_viewer.js", "page_plots.js")
# Levels of the verdicts of the check; others are warnings.
VERDICT_LEVELS = {"good": "good", "cannot tell": "note", "doubtful": "note"}
STAGES = ("highlights", "tune", "align", "psfs", "plan", "apply", "rectify", "check")
TIMES, NONE = "\N{MULTIPLICATION SIGN}", "\N{EN DASH}"


@one_line()
@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Content of a report.

    Parameters
    ----------
    photo : str
        Name of the picture.
    pictures : mapping of str to ndarray
        Display values in [0, 1], all of one size; the keys are the labels, the blurred input is the first.
    banks : mapping of str to PsfBank
        The kernels of each mode.
    motion : MotionPlot
        The rates around the exposure, and the windows of the rows.
    bands : BandFigures
        Sharpness and ringing of the pictures.
    modes : mapping of str to mapping
        Results of each mode, as `rsdeblur compare` reports them.
    settings : mapping of str to mapping of str to str
        Tables of names and values, by title.
    findings : sequence of Finding
        Outcomes of the checks, warnings first.
    frames : sequence of mapping
        Frames of a burst as `rsdeblur burst` reports them, each with its `weights` at the places of the input.
    blurred : mapping, optional
        `psnr_db` and `ssim` of the input, where the true picture is known.
    icc_profile : bytes, optional
        Colour profile of the pictures.

    Raises
    ------
    InputError
        If there are fewer than two pictures, or their sizes differ.
    """

    photo: str
    pictures: Mapping[str, NDArray[np.floating]]
    banks: Mapping[str, PsfBank]
    motion: MotionPlot
    bands: BandFigures
    modes: Mapping[str, Mapping[str, Any]]
    settings: Mapping[str, Mapping[str, str]]
    findings: Sequence[Finding]
    frames: Sequence[Mapping[str, Any]] = ()
    blurred: Mapping[str, float | None] | None = None
    icc_profile: bytes | None = None

    def __post_init__(self) -> None:
        if len(self.pictures) < 2:
            raise InputError(f"a report compares at least two pictures, got {len(self.pictures)}")
        sizes = {picture.shape[:2] for picture in self.pictures.values()}
        if len(sizes) > 1:
            raise InputError(f"all pictures of a report must have one size, got {sorted(sizes)}")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures, px."""
        height, width = next(iter(self.pictures.values())).shape[:2]
        return width, height


def write_page(path: str | os.PathLike[str], page: Page) -> None:
    """Write `page` as one file of HTML, which appears whole or not at all.

    Parameters
    ----------
    path : path-like
        The file. An existing one is replaced.
    page : Page
        The content.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    text = render(page)
    with atomic_write(path) as file:
        # A file name that is not valid Unicode must not prevent the report.
        file.write(text.encode("utf-8", "replace"))


def render(page: Page) -> str:
    """Return the page as HTML. Text from files is escaped, and the page's policy forbids all scripts but its own."""
    uris, scale = picture_uris(page.pictures, page.icc_profile)
    width, height = page.size
    template, style, *scripts = map(part, PARTS)
    script = "\n".join(scripts)
    best = _best(page)
    data = {
        "size": [width, height],
        "scale": scale,
        "banks": {label: bank_data(bank) for label, bank in page.banks.items()},
        "motion": motion_data(page.motion),
        "best": best,
        "place": telling_place(page.pictures, best),
        "bands": {"edges": page.bands.edges, "sharpness": page.bands.sharpness, "ringing": page.bands.ringing},
    }
    return Template(template).substitute(
        title=escape(page.photo),
        policy=f"default-src 'none'; img-src data:; style-src {allowed_hash(style)}; script-src {allowed_hash(script)}",
        style=style,
        script=script,
        verdict=_verdict(best, page.modes.get(best, {})),
        viewer=part("page_viewer.html"),
        summary=_summary(page.findings),
        size=f"{width} {TIMES} {height} px",
        scale=_scale(scale, width, height),
        pictures="\n".join(_figure(label, uri) for label, uri in zip(page.pictures, uris, strict=True)),
        frames=_frames(page),
        modes=_modes(page),
        bands=_bands(page.bands, page.motion.axis),
        findings="\n".join(map(_finding, page.findings)),
        settings="\n".join(_settings(title, rows) for title, rows in page.settings.items()),
        data=script_json(data),
    )


def part(name: str) -> str:
    """Return the text of a file that the page is made of."""
    return files("rsdeblur.report").joinpath(name).read_text("utf-8")


def allowed_hash(text: str) -> str:
    """Return the hash by which a page's policy allows a style or a script."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _scale(scale: float, width: int, height: int) -> str:
    if scale == 1.0:
        return "Pictures are embedded as JPEG at full size."
    size = f"{round(width * scale)} {TIMES} {round(height * scale)} px"
    return (
        f"Pictures are embedded as JPEG, reduced to {scale:.1%} ({size}); the files written by compare have full size."
    )


def _best(page: Page) -> str:
    """Return the label of the best result: by PSNR if the truth is known, then by verdict, then the last one."""
    results = [label for label in page.pictures if label in page.modes] or list(page.pictures)[1:]

    def rank(label: str) -> tuple[float, int, int]:
        result = page.modes.get(label, {})
        psnr = result.get("psnr_db", 0.0)
        verdict = (result.get("check") or {}).get("verdict")
        place = VERDICTS.index(verdict) if verdict in VERDICTS else len(VERDICTS)
        return math.inf if psnr is None else psnr, -place, results.index(label)

    return max(results, key=rank)


def _verdict(label: str, result: Mapping[str, Any]) -> str:
    """Return the verdict on the best result, for the header; nothing if it was not judged."""
    verdict = (result.get("check") or {}).get("verdict")
    if verdict is None:
        return ""
    level = VERDICT_LEVELS.get(verdict, "warning")
    return f'{escape(label)}: <span class="verdict {level}">{verdict}</span> · '


def _summary(findings: Sequence[Finding]) -> str:
    count = sum(finding.level == "warning" for finding in findings)
    return "no warnings" if not count else f"{count} warning{'s' * (count > 1)}"


def _finding(finding: Finding) -> str:
    badge = f'<span class="badge">{LEVELS[finding.level]}</span>'
    text = f"<span><strong>{escape(finding.subject)}.</strong> {escape(finding.text)}</span>"
    return f'<li class="{finding.level}">{badge}{text}</li>'


def _figure(label: str, uri: str) -> str:
    name = escape(label)
    return f'<figure><img src="{uri}" alt="{name}" data-label="{name}"><figcaption>{name}</figcaption></figure>'


def _modes(page: Page) -> str:
    has_truth = page.blurred is not None
    stages = [stage for stage in STAGES if any(stage in result["timings"] for result in page.modes.values())]
    header = ["mode", "PSFs", "PSF px", "NSR", "weight", "time s", *(f"{stage} s" for stage in stages), "peak MiB"]
    header += ["PSNR dB", "SSIM"] * has_truth
    rows = []
    if page.blurred is not None:
        rows.append([next(iter(page.pictures)), *[""] * (len(header) - 3), *_similarity(page.blurred)])
    for mode, result in page.modes.items():
        memory = result["peak_memory_mib"]
        rows.append(
            [
                mode,
                f"{result['bands']} {TIMES} {result['strips']}",
                f" {TIMES} ".join(map(str, result["psf_px"])),
                f"{result['nsr']:.3g}",
                NONE if result["weight"] is None else f"{result['weight']:.3g}",
                f"{result['seconds']:.2f}",
                *(f"{result['timings'].get(stage, 0.0):.2f}" for stage in stages),
                NONE if memory is None else f"{memory:.0f}",
                *(_similarity(result) if has_truth else []),
            ]
        )
    return _table("Modes, strengths, times and memory", header, rows)


def _frames(page: Page) -> str:
    """Return the section about the frames of a burst; nothing if there was one picture."""
    if not page.frames:
        return ""
    header = ["frame", "share", "fits %", "blur px", "shift px", "brightness", "noise"]
    rows = [
        [
            str(use["frame"]),
            f"{use['share']:.2f}",
            f"{100 * use['support']:.0f}",
            *(f"{use[name]:.1f}" for name in ("blur", "shift")),
            f"{use['gain']:.2f}",
            f"{use['noise']:.4f}",
        ]
        for use in page.frames
    ]
    picture = next(iter(page.pictures.values()))
    maps = "\n".join(_figure(f"frame {use['frame']}", weight_map_uri(picture, use["weights"])) for use in page.frames)
    table = _table("Frames and what they contribute", header, rows)
    return Template(part("page_frames.html")).substitute(table=table, maps=maps)


def _similarity(result: Mapping[str, Any]) -> list[str]:
    return ["∞" if result["psnr_db"] is None else f"{result['psnr_db']:.2f}", f"{result['ssim']:.3f}"]


def _bands(bands: BandFigures, axis: str) -> str:
    lines = "rows" if axis == "y" else "columns"
    labels = [f"{a} to {b - 1}" for a, b in pairwise(bands.edges)]
    tables = []
    for title, figures in (
        (f"Sharpness, {TIMES} the input's", bands.sharpness),
        ("Ringing, % of contrast", bands.ringing),
    ):
        rows = [
            [label, *(NONE if values[i] is None else f"{values[i]:.2f}" for values in figures.values())]
            for i, label in enumerate(labels)
        ]
        tables.append(_table(title, [lines, *figures], rows))
    return "\n".join(tables)


def _settings(title: str, rows: Mapping[str, str]) -> str:
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in rows.items())
    return f"<section><h3>{escape(title)}</h3><dl>{items}</dl></section>"


def _table(caption: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in header)
    body = "".join(
        f'<tr><th scope="row">{escape(first)}</th>{"".join(f"<td>{escape(cell)}</td>" for cell in rest)}</tr>'
        for first, *rest in rows
    )
    table = f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    # A wide table scrolls inside its region, which `tabindex` makes possible with the keyboard too.
    return f'<div class="wide" tabindex="0" role="region" aria-label="{escape(caption)}">{table}</div>'
