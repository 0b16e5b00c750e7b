"""The report page of `compare`, and the warnings for it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rsdeblur.cli._photo import correction_text
from rsdeblur.errors import RsdeblurWarning

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.choices import Transfer
    from rsdeblur.cli._inputs import Inputs
    from rsdeblur.cli._options import Recording
    from rsdeblur.pipeline.options import Options
    from rsdeblur.psf import PsfBank
    from rsdeblur.report import Page


class Compared(NamedTuple):
    """Results of a comparison.

    `shown` contains display values by label, the input first; `banks` the PSFs by mode; `unseen` is the fraction of the
    pixels that were never exposed; `recorded` contains the PSFs before a correction, and `frames` the facts and weights
    of the frames of a burst.
    """

    report: dict[str, Any]
    inputs: Inputs
    shown: dict[str, NDArray[Any]]
    banks: Mapping[str, PsfBank]
    unseen: float
    transfer: Transfer
    recorded: PsfBank | None = None
    frames: Sequence[Mapping[str, Any]] = ()


@contextmanager
def capture_warnings() -> Iterator[list[str]]:
    """Collect the texts of the package's warnings, which are shown as usual."""
    texts: list[str] = []
    show = warnings.showwarning

    def collect(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
        if issubclass(category, RsdeblurWarning) and str(message) not in texts:
            texts.append(str(message))
        show(message, category, *place, **more)

    warnings.showwarning = collect
    try:
        yield texts
    finally:
        warnings.showwarning = show


def report_page(compared: Compared, recording: Recording, options: Options, remarks: Sequence[str]) -> Page:
    """Fill the page of a comparison; it names files without their folders, which may be private."""
    from rsdeblur.report import MotionPlot, Page, band_figures, findings

    report, (picture, log, camera, exposure), shown, banks, unseen, transfer, recorded, frames = compared
    correction = report.get("refinement")
    tall, wide = (max(sides) for sides in zip(*(bank.size for bank in banks.values()), strict=True))
    checks = {mode: facts["check"] for mode, facts in report["modes"].items() if facts["check"] is not None}
    ringings = {mode: check["ringings"] for mode, check in checks.items()}
    return Page(
        photo=Path(report["photo"]).name,
        pictures=shown,
        banks=dict(banks) | ({"as recorded": recorded} if recorded else {}),
        motion=MotionPlot.of(log, camera, exposure),
        bands=band_figures(shown, ringings, across=camera.horizontal_readout),
        modes=report["modes"],
        settings=_settings(compared, recording, options),
        findings=findings(
            *(picture.pixels, log, camera, exposure),
            psf=(tall, wide),
            checks=checks,
            unseen=unseen,
            can_split=not any("highlights" in facts["timings"] for facts in report["modes"].values()),
            correction=correction and (correction["accepted"], correction_text(correction)),
            remarks=[_without_folders(remark, compared, recording) for remark in remarks],
        ),
        frames=frames,
        blurred=report.get("blurred"),
        # Linear light is encoded as sRGB for display; stored values keep their profile.
        icc_profile=None if transfer == "linear" or picture.pixels.ndim == 2 else picture.icc_profile,
    )


def _corrections(refinement: Mapping[str, Any]) -> dict[str, str]:
    """Return the numbers of a correction of the recording with their standard deviations."""
    labels = {
        "scale": "focal length, logarithm of the factor",
        "drift_x": "drift along x, px",
        "drift_y": "drift along y, px",
        "offset": "time offset, s",
        "readout": "readout time, logarithm of the factor",
        "roll": "roll bias, rad/s",
        "acceleration_x": "acceleration along x, px/s²",
        "acceleration_y": "acceleration along y, px/s²",
    }
    values = {
        label: f"{refinement['values'][name]:+.3g} ± {refinement['sd'][name]:.2g}" for name, label in labels.items()
    }
    verdict = "yes" if refinement["accepted"] else f"no: {refinement['reason']}"
    return values | {"confidence": f"{refinement['confidence']:.2f}", "accepted": verdict}


def _without_folders(text: str, compared: Compared, recording: Recording) -> str:
    """Return a text in which the files of the comparison are named without their folders."""
    files = [
        Path(compared.report["photo"]),
        *(value for value in asdict(recording).values() if isinstance(value, Path)),
    ]
    for path in sorted(files, key=lambda path: len(str(path)), reverse=True):
        text = text.replace(str(path), path.name)
    return text


def _settings(compared: Compared, recording: Recording, options: Options) -> dict[str, dict[str, str]]:
    from rsdeblur.config import show_config
    from rsdeblur.io.exif import Exif

    report, (picture, log, camera, exposure), *_ = compared
    transfer = compared.transfer
    orientation = Exif(picture.exif).orientation
    tables: dict[str, Mapping[str, Any]] = {
        "Picture": {
            "photo": Path(report["photo"]),
            "truth": Path(report["truth"]) if "truth" in report else None,
            "stored as": f"{picture.pixels.dtype}, {(*picture.pixels.shape, 1)[2]} channels",
            "transfer": transfer,
            "EXIF orientation": None if orientation == 1 else f"{orientation}, not applied: shown as stored",
            "report made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        },
        "Recording": asdict(recording),
        "Blur and solver": options.recorded | {"mode": ", ".join(report["modes"]), "transfer": transfer},
        "Correction by the picture": _corrections(report["refinement"]) if "refinement" in report else {},
        "Exposure": {"start, s": exposure.start, "duration, s": exposure.duration, "origin, ns": exposure.epoch_ns},
        "Gyro log": {"samples": len(log), "rate, Hz": log.rate, "span, s": log.span, "origin, ns": log.epoch_ns},
        "Camera": {each.name: getattr(camera, each.name) for each in fields(camera)},
        "Software": show_config(mode="dict"),
    }
    return {
        title: {name.replace("_", " "): text for name, value in rows.items() if (text := _text(value))}
        for title, rows in tables.items()
        if rows
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
