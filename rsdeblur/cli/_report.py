"""The report page of `compare`, and the warnings for it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rsdeblur.cli import _engine as rs
from rsdeblur.cli._options import Recording
from rsdeblur.cli._photo import correction_text
from rsdeblur.errors import RsdeblurWarning
from rsdeblur.pipeline.options import Options


@contextmanager
def capture_warnings(*, show: bool = True) -> Iterator[list[str]]:
    """Collect the texts of the package's warnings, which are shown as usual unless `show` is False."""
    texts: list[str] = []
    before = warnings.showwarning

    def collect(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if issubclass(category, RsdeblurWarning) and str(message) not in texts:
            texts.append(str(message))
        if show:
            before(message, category, *place, **more)

    with warnings.catch_warnings():
        warnings.simplefilter("always", RsdeblurWarning)
        warnings.showwarning = collect
        yield texts


def complete(page: rs.Page, recording: Recording, options: Options, texts: Sequence[str]) -> rs.Page:
    """Return the page with settings and remarks; it names files without their folders, which may be private."""
    paths = [Path(page.report["photo"]), *(value for value in asdict(recording).values() if isinstance(value, Path))]
    remarks = []
    for text in texts:
        for path in sorted(paths, key=lambda path: len(str(path)), reverse=True):
            text = text.replace(str(path), path.name)
        remarks.append(rs.Finding("warning", "Remark", text))
    if correction := page.report.get("refinement"):
        level: rs.Level = "good" if correction["accepted"] else "note"
        remarks.append(rs.Finding(level, "Motion", correction_text(correction)))
    return page._replace(settings=_settings(page, recording, options), remarks=remarks)


def _settings(page: rs.Page, recording: Recording, options: Options) -> dict[str, dict[str, str]]:
    report, picture, log, camera, exposure, *_ = page
    orientation = rs.Exif(picture.exif).orientation
    tables: dict[str, Mapping[str, Any]] = {
        "Picture": {
            "photo": Path(report["photo"]),
            "truth": Path(report["truth"]) if "truth" in report else None,
            "stored as": f"{picture.pixels.dtype}, {(*picture.pixels.shape, 1)[2]} channels",
            "transfer": page.transfer,
            "EXIF orientation": None if orientation == 1 else f"{orientation}, not applied: shown as stored",
            "report made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        },
        "Recording": asdict(recording),
        "Blur and solver": options.recorded | {"mode": ", ".join(report["modes"]), "transfer": page.transfer},
        "Exposure": {"start, s": exposure.start, "duration, s": exposure.duration, "origin, ns": exposure.epoch_ns},
        "Gyro log": {"samples": len(log), "rate, Hz": log.rate, "span, s": log.span, "origin, ns": log.epoch_ns},
        "Camera": {each.name: getattr(camera, each.name) for each in fields(camera)},
        "Software": rs.show_config(mode="dict"),
    }
    return {
        title: {name.replace("_", " "): text for name, value in rows.items() if (text := _text(value))}
        for title, rows in tables.items()
    }


def _text(value: Any) -> str:
    """Return the text of a value; an empty text for None."""
    import numpy as np

    if value is None:
        return ""
    if isinstance(value, np.ndarray):
        return "; ".join(" ".join(f"{cell:.6g}" for cell in row) for row in value)
    if isinstance(value, tuple):
        return ", ".join(map(_text, value))
    if isinstance(value, Path):
        return value.name
    return f"{value:.9g}" if isinstance(value, float) else str(value)
