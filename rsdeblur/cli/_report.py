"""The report page of `compare`, and the warnings for it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rsdeblur.cli._refinement import correction_text
from rsdeblur.errors import RsdeblurWarning

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.choices import Mode, Transfer
    from rsdeblur.cli._inputs import Inputs
    from rsdeblur.cli._options import Recording, Track
    from rsdeblur.pipeline.options import Options
    from rsdeblur.psf import PsfBank
    from rsdeblur.report import Page


class Compared(NamedTuple):
    """Results of a comparison.

    `shown` contains display values by label, the input first; `banks` the PSFs by mode; `unseen` is the fraction of the
    pixels that were never exposed; `recorded` contains the PSFs of the recording before the picture corrected it, and
    `frames` the facts and weights of the frames of a burst.
    """

    report: dict[str, Any]
    inputs: Inputs
    shown: dict[str, NDArray[Any]]
    banks: Mapping[Mode, PsfBank] | Mapping[str, PsfBank]
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


def report_page(
    compared: Compared,
    recording: Recording,
    options: Options,
    remarks: Sequence[str],
    *,
    track: Track | None = None,
    with_paths: bool = False,
) -> Page:
    """Fill the page of a comparison; it names files without their folders unless `with_paths` is set."""
    from rsdeblur.report import MotionPlot, Page, band_figures, findings

    report, (picture, log, camera, exposure), shown, banks, unseen, transfer, recorded, frames = compared
    tall, wide = (max(sides) for sides in zip(*(bank.size for bank in banks.values()), strict=True))
    psf = tall, wide
    checks = {mode: facts["check"] for mode, facts in report["modes"].items() if facts["check"] is not None}
    ringings = {mode: check["ringings"] for mode, check in checks.items()}
    return Page(
        photo=Path(report["photo"]).name,
        pictures=shown,
        banks={str(mode): bank for mode, bank in banks.items()} | ({"as recorded": recorded} if recorded else {}),
        motion=MotionPlot.of(log, camera, exposure),
        bands=band_figures(shown, ringings, across=camera.horizontal_readout),
        modes=report["modes"],
        settings=_settings(compared, recording, options, track, with_paths),
        findings=findings(
            *(picture.pixels, log, camera, exposure),
            psf=psf,
            checks=checks,
            unseen=unseen,
            can_split=not any("highlights" in facts["timings"] for facts in report["modes"].values()),
            correction=_correction(report.get("refinement")),
            remarks=remarks if with_paths else [_without_folders(remark, compared, recording) for remark in remarks],
        ),
        frames=frames,
        blurred=report.get("blurred"),
        # Linear light is encoded as sRGB for display; stored values keep their profile.
        icc_profile=None if transfer == "linear" or picture.pixels.ndim == 2 else picture.icc_profile,
    )


def _correction(refinement: Mapping[str, Any] | None) -> tuple[bool, str] | None:
    """Return whether a requested correction of the recording was accepted, and a sentence about it."""
    return None if refinement is None else (refinement["accepted"], correction_text(refinement))


def _corrections(refinement: Mapping[str, Any]) -> dict[str, str]:
    """Return the numbers of a correction of the recording with their standard deviations."""
    units = {
        "scale": (1.0, "focal length, logarithm of the factor"),
        "drift_x": (1.0, "drift along x, px"),
        "drift_y": (1.0, "drift along y, px"),
        "offset": (1e3, "time offset, ms"),
        "readout": (1.0, "readout time, logarithm of the factor"),
        "roll": (1.0, "roll bias, rad/s"),
        "acceleration_x": (1.0, "acceleration along x, px/s²"),
        "acceleration_y": (1.0, "acceleration along y, px/s²"),
    }
    values = {
        label: f"{unit * refinement['values'][name]:+.3g} ± {unit * refinement['sd'][name]:.2g}"
        for name, (unit, label) in units.items()
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


def _settings(
    compared: Compared, recording: Recording, options: Options, track: Track | None, with_paths: bool
) -> dict[str, dict[str, str]]:
    from rsdeblur.config import show_config
    from rsdeblur.io.exif import Exif

    report, (picture, log, camera, exposure), *_ = compared
    transfer = compared.transfer
    exif = Exif(picture.exif)
    about_picture = {
        "photo": Path(report["photo"]),
        "truth": Path(report["truth"]) if "truth" in report else None,
        "stored as": f"{picture.pixels.dtype}, {picture.pixels.shape[2] if picture.pixels.ndim == 3 else 1} channels",
        "transfer": transfer,
        "EXIF orientation": None if exif.orientation == 1 else f"{exif.orientation}, not applied: shown as stored",
        "report made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
    about_log = {
        "samples": len(log),
        "rate, Hz": log.rate,
        "span, s": log.span,
        "origin, ns": log.epoch_ns,
    }
    times = {"start, s": exposure.start, "duration, s": exposure.duration, "origin, ns": exposure.epoch_ns}
    names = (
        "width",
        "height",
        "focal_length",
        "principal_point",
        "readout_time",
        "readout_direction",
        "imu_to_camera",
        "time_offset",
    )
    lens = ("distortion_model", "distortion", "timestamp_marks")
    tables: dict[str, Mapping[str, Any]] = {
        "Picture": about_picture,
        "Recording": asdict(recording),
        "Translation": {} if track is None or not any((track.translation, track.drift)) else asdict(track),
        "Blur and solver": options.recorded | {"mode": ", ".join(report["modes"]), "transfer": transfer},
        "Correction by the picture": _corrections(report["refinement"]) if "refinement" in report else {},
        "Exposure": times,
        "Gyro log": about_log,
        "Camera": {name: getattr(camera, name) for name in (*names, *lens)},
        "Software": show_config(mode="dict"),
    }
    return {
        title: {_label(name): text for name, value in rows.items() if (text := _text(value, with_paths))}
        for title, rows in tables.items()
        if rows
    }


def _label(name: str) -> str:
    return name.replace("_", " ")


def _text(value: Any, with_paths: bool) -> str:
    """Return the text of a value; an empty text for None."""
    import numpy as np

    if value is None:
        return ""
    if isinstance(value, np.ndarray):
        return "; ".join(" ".join(f"{cell:.6g}" for cell in row) for row in value)
    if isinstance(value, tuple):
        return ", ".join(_text(item, with_paths) for item in value)
    if isinstance(value, Path):
        return str(value) if with_paths else value.name
    return f"{value:.9g}" if isinstance(value, float) else str(value)
