"""Pages of HTML that contain everything they show, so that they need no network: the report and the list of a batch."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, NamedTuple
from urllib.parse import quote

from numpy.typing import NDArray
from PIL import Image, ImageOps

from rsdeblur._util.files import atomic_write
from rsdeblur.choices import VERDICTS, Transfer
from rsdeblur.config import show_config
from rsdeblur.io.metadata import Exif
from rsdeblur.io.pictures import Picture
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.pipeline.options import Options
from rsdeblur.psf import PsfBank
from rsdeblur.report.drawings import bank_data, picture_uris, telling_place, thumbnail_uri, weight_map_uri
from rsdeblur.report.facts import (
    LEVELS,
    VERDICT_LEVELS,
    Finding,
    Level,
    correction_text,
    findings,
    motion_data,
    plain,
)

STAGES = ("highlights", "tune", "align", "psfs", "plan", "apply", "rectify", "check")
TIMES = "\N{MULTIPLICATION SIGN}"
# Verdicts on the items of a batch, the worst first.
ORDER = ("failed", *reversed(VERDICTS), "not checked")


class Page(NamedTuple):
    """Content of a report: a photo and its results."""

    report: dict[str, Any]  # facts as `rsdeblur compare` writes them
    picture: Picture
    log: GyroLog
    camera: Camera
    exposure: Exposure
    shown: dict[str, NDArray[Any]]  # display values in [0, 1] by label, the blurred input first
    banks: Mapping[str, PsfBank]  # PSFs by mode
    transfer: Transfer  # of the photo
    unseen: float = 0.0  # fraction of the pixels that were never exposed
    recorded: PsfBank | None = None  # PSFs before a correction
    frames: Sequence[Mapping[str, Any]] = ()  # facts of the frames of a burst, each with its `weights`
    settings: Mapping[str, Mapping[str, str]] = {}  # tables of names and values by title
    remarks: Sequence[Finding] = ()  # beside those that the content gives

    @property
    def findings(self) -> list[Finding]:
        """Outcomes of all checks, warnings first."""
        modes = self.report["modes"].items()
        tall, wide = (max(sides) for sides in zip(*(bank.size for bank in self.banks.values()), strict=True))
        outcomes = findings(
            *(self.picture.pixels, self.log, self.camera, self.exposure),
            psf=(tall, wide),
            checks={mode: facts["check"] for mode, facts in modes if facts.get("check") is not None},
            unseen=self.unseen,
            can_split=not any("highlights" in facts["timings"] for _, facts in modes),
        )
        return sorted([*self.remarks, *outcomes], key=lambda finding: LEVELS.index(finding.level))

    @property
    def best(self) -> str:
        """Label of the best result: by PSNR if the truth is known, then by verdict, then the last one."""
        modes = self.report["modes"]
        results = [label for label in self.shown if label in modes] or list(self.shown)[1:]

        def rank(label: str) -> tuple[float, int, int]:
            psnr, verdict = modes.get(label, {}).get("psnr_db", 0.0), _verdict(modes.get(label, {}))
            place = VERDICTS.index(verdict) if verdict in VERDICTS else len(VERDICTS)
            return math.inf if psnr is None else psnr, -place, results.index(label)

        return max(results, key=rank)

    def completed(self, recording: Mapping[str, Any], options: Options, texts: Sequence[str]) -> Page:
        """Return the page with settings and warnings; it names files without their folders, which may be private."""
        paths = [Path(self.report["photo"]), *(value for value in recording.values() if isinstance(value, Path))]
        remarks = []
        for text in texts:
            for path in sorted(paths, key=lambda path: len(str(path)), reverse=True):
                text = text.replace(str(path), path.name)
            remarks.append(Finding("warning", "Remark", text))
        if correction := self.report.get("refinement"):
            level: Level = "good" if correction["accepted"] else "note"
            remarks.append(Finding(level, "Motion", correction_text(correction)))
        tables = {
            title: {name.replace("_", " "): text for name, value in rows.items() if (text := plain(value, 9))}
            for title, rows in self._settings(recording, options).items()
        }
        return self._replace(settings=tables, remarks=remarks)

    def _settings(self, recording: Mapping[str, Any], options: Options) -> dict[str, Mapping[str, Any]]:
        report, picture, log, camera, exposure, *_ = self
        orientation = Exif(picture.exif).orientation
        return {
            "Picture": {
                "photo": Path(report["photo"]),
                "truth": Path(report["truth"]) if "truth" in report else None,
                "stored as": f"{picture.pixels.dtype}, {(*picture.pixels.shape, 1)[2]} channels",
                "transfer": self.transfer,
                "EXIF orientation": None if orientation == 1 else f"{orientation}, not applied: shown as stored",
                "report made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            },
            "Recording": recording,
            "Blur and solver": options.recorded | {"mode": ", ".join(report["modes"]), "transfer": self.transfer},
            "Exposure": {"start, s": exposure.start, "duration, s": exposure.duration, "origin, ns": exposure.epoch_ns},
            "Gyro log": {"samples": len(log), "rate, Hz": log.rate, "span, s": log.span, "origin, ns": log.epoch_ns},
            "Camera": {each.name: getattr(camera, each.name) for each in fields(camera)}
            | {"imu_to_camera": camera.imu_to_camera.tolist()},
            "Software": show_config(mode="dict"),
        }


def write_page(path: str | os.PathLike[str], page: Page) -> None:
    """Write a report as one file of HTML, which appears whole or not at all; an existing one is replaced."""
    _write(path, render(page))


def _write(path: str | os.PathLike[str], text: str) -> None:
    with atomic_write(path) as file:
        # A file name that is not valid Unicode must not prevent the page.
        file.write(text.encode("utf-8", "replace"))


def document(
    *, kind: str, title: str, facts: str, main: str, style: str = "", script: str = "", allowed: str = ""
) -> str:
    """Return a page as HTML, whose policy forbids every script and style but its own.

    `facts` and `main` are HTML, in which text from files must be escaped; `title` is text. `script` is a module that
    follows `main`, `style` follows that of all pages, and `allowed` is added to the policy.
    """
    styles = part("page.css") + style
    hashes = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (styles, script))
    policy = "default-src 'none'; img-src data:; style-src 'sha256-{}'; script-src 'sha256-{}'".format(*hashes)
    module = f'<script type="module">{script}</script>' if script else ""
    return Template(part("page_shell.html")).substitute(
        kind=kind, title=escape(title), facts=facts, main=main, style=styles, policy=policy + allowed, scripts=module
    )


def part(name: str) -> str:
    """Return the text of a file that pages are made of."""
    return files("rsdeblur.report").joinpath(name).read_text("utf-8")


def render(page: Page) -> str:
    """Return a report as HTML."""
    # Linear light is encoded as sRGB for display; stored values keep their profile.
    is_stored = page.transfer != "linear" and page.picture.pixels.ndim == 3
    uris, scale = picture_uris(page.shown, page.picture.icc_profile if is_stored else None)
    height, width = next(iter(page.shown.values())).shape[:2]
    best, outcomes, modes = page.best, page.findings, page.report["modes"]
    banks = dict(page.banks) | ({"as recorded": page.recorded} if page.recorded else {})
    data = {
        "size": [width, height],
        "scale": scale,
        "banks": {label: bank_data(bank) for label, bank in banks.items()},
        "motion": motion_data(page.log, page.camera, page.exposure),
        "best": best,
        "place": telling_place(next(iter(page.shown.values())), page.shown[best]),
    }
    warnings = sum(finding.level == "warning" for finding in outcomes)
    summary = f"{warnings or 'no'} warning{'s' * (warnings != 1)}"
    badge = f"{escape(best)}: {_badge(modes[best])} · " if modes[best].get("check") else ""
    main = Template(part("page.html")).substitute(
        viewer=part("page_viewer.html"),
        scale=_scale(scale, width, height),
        pictures="\n".join(_figure(label, uri) for label, uri in zip(page.shown, uris, strict=True)),
        frames=_frames(page),
        modes=_modes(page),
        findings="\n".join(map(_finding, outcomes)),
        settings="\n".join(_settings(title, rows) for title, rows in page.settings.items()),
        data=script_json(data),
    )
    return document(
        kind="rsdeblur report",
        title=Path(page.report["photo"]).name,
        facts=f'{badge}{width} {TIMES} {height} px · <a href="#findings">{summary}</a>',
        main=main,
        script=part("page_viewer.js") + part("page_plots.js"),
    )


def script_json(payload: Any) -> str:
    """Return JSON that is safe in a script element: no text in it can end the element or open a comment."""
    text = json.dumps(payload, separators=(",", ":"), allow_nan=False)
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


def _verdict(facts: Mapping[str, Any]) -> str:
    """Return the verdict on a result: that of the check, "failed" or "not checked"."""
    return "failed" if "error" in facts else str((facts.get("check") or {}).get("verdict", "not checked"))


def _badge(facts: Mapping[str, Any]) -> str:
    verdict = _verdict(facts)
    return f'<span class="verdict {VERDICT_LEVELS.get(verdict, "warning")}">{verdict}</span>'


def _scale(scale: float, width: int, height: int) -> str:
    if scale == 1.0:
        return "Pictures are embedded as JPEG at full size."
    size = f"{round(width * scale)} {TIMES} {round(height * scale)} px"
    return (
        f"Pictures are embedded as JPEG, reduced to {scale:.1%} ({size}); the files written by compare have full size."
    )


def _finding(finding: Finding) -> str:
    badge = f'<span class="badge">{finding.level.capitalize()}</span>'
    text = f"<span><strong>{escape(finding.subject)}.</strong> {escape(finding.text)}</span>"
    return f'<li class="{finding.level}">{badge}{text}</li>'


def _figure(label: str, uri: str) -> str:
    name = escape(label)
    return f'<figure><img src="{uri}" alt="{name}" data-label="{name}"><figcaption>{name}</figcaption></figure>'


def _modes(page: Page) -> str:
    results = page.report["modes"].values()
    stages = [stage for stage in STAGES if any(stage in result["timings"] for result in results)]
    header, *rows = mode_table(page.report, stages)
    return _table("Modes, strengths and times", header, rows)


def mode_table(report: Mapping[str, Any], stages: Sequence[str] = ()) -> list[list[str]]:
    """Return the header and the rows of the table of modes, with the times of some `stages`."""
    blurred, modes = report.get("blurred"), report["modes"]
    header = ["mode", "prior", "PSFs", "PSF px", "NSR", "weight", "time s", "check"]
    first = ["(blurred)", *[""] * (len(header) - 1)]
    rows = [] if blurred is None else [[*first, *_similarity(blurred), *[""] * len(stages)]]
    # The stages come last, where a narrow page hides them first.
    header += [*(["PSNR dB", "SSIM"] if blurred is not None else []), *(f"{stage} s" for stage in stages)]
    for mode, facts in modes.items():
        wide, tall = facts["psf_px"]
        weight = facts["weight"]
        row = [mode, facts["prior"], f"{facts['bands']} x {facts['strips']}", f"{wide} x {tall}", f"{facts['nsr']:.3g}"]
        row += ["-" if weight is None else f"{weight:.3g}", f"{facts['seconds']:.2f}", _verdict(facts)]
        row += [] if blurred is None else _similarity(facts)
        rows.append(row + [f"{facts['timings'].get(stage, 0.0):.2f}" for stage in stages])
    return [header, *rows]


def _similarity(result: Mapping[str, Any]) -> list[str]:
    return ["inf" if result["psnr_db"] is None else f"{result['psnr_db']:.2f}", f"{result['ssim']:.3f}"]


def _frames(page: Page) -> str:
    """Return the section about the frames of a burst; nothing if there was one picture."""
    if not page.frames:
        return ""
    header = ["frame", "share", "fits %", "blur px", "shift px", "brightness", "noise"]
    row = "{frame}|{share:.2f}|{support:.0%}|{blur:.1f}|{shift:.1f}|{gain:.2f}|{noise:.4f}"
    rows = [row.format(**use).replace("%", "").split("|") for use in page.frames]
    picture = next(iter(page.shown.values()))
    maps = "\n".join(_figure(f"frame {use['frame']}", weight_map_uri(picture, use["weights"])) for use in page.frames)
    return f"""
<section aria-labelledby="frames-title">
  <h2 id="frames-title">Frames</h2>
{_table("Frames and what they contribute", header, rows)}
  <p class="hint">Each map shows the picture whose pose the result has. Where it is orange, the frame does not count:
    something moved, its motion is wrong, or it does not show the place.</p>
  <div class="maps">
{maps}
  </div>
</section>
"""


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


def write_batch_page(path: str | os.PathLike[str], entries: Sequence[Mapping[str, Any]], *, title: str) -> None:
    """Write a page with a thumbnail of every photo of a batch beside its result, the most doubtful first.

    `entries` are the items as `rsdeblur batch` reports them in ``batch.json``.
    """
    counts = Counter(map(_verdict, entries))
    ordered = sorted(entries, key=lambda entry: ORDER.index(_verdict(entry)))
    items = "\n".join(_item(entry, Path(path).parent) for entry in ordered)
    text = document(
        kind="rsdeblur batch",
        title=title,
        facts=", ".join(f"{counts[verdict]} {verdict}" for verdict in ORDER if counts[verdict]),
        main=f'<h2>Photos, the most doubtful first</h2>\n<div class="pairs">\n{items}\n</div>',
    )
    _write(path, text)


def _item(entry: Mapping[str, Any], folder: Path) -> str:
    reasons = entry.get("error") or " ".join((entry.get("check") or {}).get("reasons", ()))
    name = escape(Path(entry["photo"]).name)
    images = _thumbnail(Path(entry["photo"]), f"{name}, the photo")
    if "error" not in entry and "output" in entry:
        link = escape(quote(os.path.relpath(entry["output"], folder)))
        images += f'<a href="{link}">{_thumbnail(Path(entry["output"]), f"{name}, the result")}</a>'
    return f"<figure>{images}<figcaption>{_badge(entry)} {name}<br>{escape(str(reasons))}</figcaption></figure>"


def _thumbnail(path: Path, label: str) -> str:
    """Return a thumbnail, or the label alone if the file is no picture that Pillow reads."""
    try:
        with Image.open(path) as picture:
            picture.draft("RGB", (280, 280))
            uri = thumbnail_uri(ImageOps.exif_transpose(picture).convert("RGB"), 280)
    except (OSError, ValueError, Image.DecompressionBombError):
        return f"<span>{label}</span>"
    return f'<img src="{uri}" alt="{label}">'
