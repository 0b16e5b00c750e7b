"""Pages of HTML that contain everything they show, so that they need no network."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from numpy.typing import NDArray

from rsdeblur import config
from rsdeblur._util.files import atomic_write
from rsdeblur.choices import VERDICTS, Transfer
from rsdeblur.io.pictures import Picture
from rsdeblur.motion.camera import Camera
from rsdeblur.motion.exposure import Exposure
from rsdeblur.motion.gyro import GyroLog
from rsdeblur.pipeline.options import Options
from rsdeblur.psf import PsfBank
from rsdeblur.report.drawings import bank_data, picture_uris
from rsdeblur.report.facts import correction_text, motion_data, plain

# Colours of verdicts; others are warnings.
VERDICT_LEVELS = {"good": "good", "cannot tell": "note", "not checked": "note"}
TIMES = "\N{MULTIPLICATION SIGN}"


class Page(NamedTuple):
    """Content of a report: a photo and its results."""

    report: dict[str, Any]  # facts as `rsdeblur compare` writes them
    picture: Picture
    log: GyroLog
    camera: Camera
    exposure: Exposure
    shown: dict[str, NDArray[Any]]  # display values in [0, 1] by label, the blurred input first
    banks: dict[str, PsfBank]  # PSFs by mode
    transfer: Transfer  # of the photo
    settings: Mapping[str, Mapping[str, str]] = {}  # tables of names and values by title
    remarks: Sequence[tuple[str, str]] = ()  # subjects and sentences, beside the verdicts

    @property
    def findings(self) -> list[tuple[str, str]]:
        """Subjects and sentences of the remarks and of the checks."""
        checks = {mode: facts["check"] for mode, facts in self.report["modes"].items() if facts.get("check")}
        return [
            *self.remarks,
            *((f"Check, {mode}", " ".join((f"{each['verdict']}.", *each["reasons"]))) for mode, each in checks.items()),
        ]

    @property
    def best(self) -> str:
        """Label of the best result: by PSNR if the truth is known, else by the verdict; of equal ones, the last."""
        modes: dict[str, Any] = self.report["modes"]

        def rank(label: str) -> tuple[float, int]:
            psnr, verdict = modes[label].get("psnr_db", 0.0), _verdict(modes[label])
            place = VERDICTS.index(verdict) if verdict in VERDICTS else len(VERDICTS)
            return math.inf if psnr is None else psnr, -place

        return max(reversed(list(modes)), key=rank)

    def completed(self, recording: Mapping[str, Any], options: Options, texts: Sequence[str]) -> Page:
        """Return the page with settings and warnings; it names files without their folders, which may be private."""
        paths = [Path(self.report["photo"]), *(value for value in recording.values() if isinstance(value, Path))]
        remarks = []
        for text in texts:
            for path in sorted(paths, key=lambda path: len(str(path)), reverse=True):
                text = text.replace(str(path), path.name)
            remarks.append(("Warning", text))
        if correction := self.report.get("refinement"):
            remarks.append(("Motion", correction_text(correction)))
        camera, exposure, modes = self.camera, self.exposure, ", ".join(self.report["modes"])
        values: dict[str, Mapping[str, Any]] = {
            "Recording": recording,
            "Blur and solver": options.recorded | {"mode": modes, "transfer": self.transfer},
            "Exposure": {"start, s": exposure.start, "duration, s": exposure.duration, "origin, ns": exposure.epoch_ns},
            "Camera": {each.name: getattr(camera, each.name) for each in fields(camera)}
            | {"imu_to_camera": camera.imu_to_camera.tolist()},
            "Software": config.facts(),
        }
        tables = {
            title: {name.replace("_", " "): text for name, value in rows.items() if (text := plain(value, 9))}
            for title, rows in values.items()
        }
        return self._replace(settings=tables, remarks=remarks)


def write_page(path: str | os.PathLike[str], page: Page) -> None:
    """Write a report as one file of HTML, which appears whole or not at all; an existing one is replaced."""
    with atomic_write(path) as file:
        # A file name that is not valid Unicode must not prevent the page.
        file.write(render(page).encode("utf-8", "replace"))


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
    best, modes = page.best, page.report["modes"]
    data = {
        "size": [width, height],
        "scale": scale,
        "banks": {label: bank_data(bank) for label, bank in page.banks.items()},
        "motion": motion_data(page.log, page.camera, page.exposure),
        "best": best,
        "isWhole": True,
    }
    verdict = _verdict(modes[best])
    badge = f'<span class="verdict {VERDICT_LEVELS.get(verdict, "warning")}">{verdict}</span>'
    about = f"{escape(best)}: {badge} · " if modes[best].get("check") else ""
    main = Template(part("page.html")).substitute(
        viewer=part("page_viewer.html"),
        scale=f"Pictures are embedded as JPEG at {scale:.0%} of their size; the files of compare have full size.",
        pictures="\n".join(_figure(label, uri) for label, uri in zip(page.shown, uris, strict=True)),
        modes=_table("Modes, strengths and times", *mode_table(page.report)),
        findings="\n".join(
            f"<li><strong>{escape(subject)}.</strong> {escape(text)}</li>" for subject, text in page.findings
        ),
        settings="\n".join(_settings(title, rows) for title, rows in page.settings.items()),
        data=script_json(data),
    )
    return document(
        kind="rsdeblur report",
        title=Path(page.report["photo"]).name,
        facts=f'{about}{width} {TIMES} {height} px · <a href="#findings">remarks</a>',
        main=main,
        script=part("page_viewer.js") + part("page_plots.js"),
    )


def script_json(payload: Any) -> str:
    """Return JSON that is safe in a script element: no text in it can end the element or open a comment."""
    text = json.dumps(payload, separators=(",", ":"), allow_nan=False)
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


def _verdict(facts: Mapping[str, Any]) -> str:
    """Return the verdict on a result: that of the check, or "not checked"."""
    return str((facts.get("check") or {}).get("verdict", "not checked"))


def _figure(label: str, uri: str) -> str:
    name = escape(label)
    return f'<figure><img src="{uri}" alt="{name}" data-label="{name}"><figcaption>{name}</figcaption></figure>'


def mode_table(report: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Return the header and the rows of the table of modes."""
    blurred, header = report.get("blurred"), ["mode", "prior", "PSFs", "PSF px", "NSR", "weight", "time s", "check"]
    rows = [] if blurred is None else [["(blurred)", *[""] * (len(header) - 1), *_similarity(blurred)]]
    for mode, facts in report["modes"].items():
        wide, tall = facts["psf_px"]
        weight = facts["weight"]
        row = [mode, facts["prior"], f"{facts['bands']} x {facts['strips']}", f"{wide} x {tall}", f"{facts['nsr']:.3g}"]
        row += ["-" if weight is None else f"{weight:.3g}", f"{facts['seconds']:.2f}", _verdict(facts)]
        rows.append(row + ([] if blurred is None else _similarity(facts)))
    return [*header, *(["PSNR dB", "SSIM"] if blurred is not None else [])], rows


def _similarity(result: Mapping[str, Any]) -> list[str]:
    return ["inf" if result["psnr_db"] is None else f"{result['psnr_db']:.2f}", f"{result['ssim']:.3f}"]


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
