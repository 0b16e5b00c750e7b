"""`rsdeblur compare`: deblur one picture in every mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from rsdeblur.choices import MODES, Auto, Mode, Transfer
from rsdeblur.cli import _engine as rs
from rsdeblur.cli import _options, _output
from rsdeblur.cli._inputs import transfer_of
from rsdeblur.cli._options import OUTPUT, Command, Recording, Target, option
from rsdeblur.cli._photo import Prepared, moment_facts, prepare, stopwatch
from rsdeblur.cli._types import PATH
from rsdeblur.errors import InputError
from rsdeblur.pipeline.options import BLUR, Options

SHEET, MAP, REPORT = "side-by-side.png", "psfs.png", "compare.json"

EXAMPLES = """\b
Examples:
  rsdeblur compare photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o out
  rsdeblur compare photo.jpg --gyro gyro.csv --camera phone.toml --start 0.1 --duration 1/20 --report report.html
"""


@click.command("compare", cls=Command, epilog=EXAMPLES)
@click.argument("photo", type=PATH)
@_options.recording_options(*_options.ONE_PHOTO)
@option(
    *("--mode", "modes"),
    section=BLUR,
    type=click.Choice(MODES),
    multiple=True,
    help="Mode to compare; repeat it.  [default: all]",
)
@_options.solve_options(*(name for name in _options.SOLVE if name not in ("mode", "fallback")))
@option("--truth", type=PATH, metavar="FILE", help="Sharp picture, to measure PSNR and SSIM.")
@_options.target_options(
    "DIR",
    "Folder to write to; by default PHOTO-compare beside it.",
    default=lambda photo, **_: _options.beside(photo, "-compare"),
)
@option(
    "--report", section=OUTPUT, type=PATH, metavar="HTML", help="Also write a page that shows the results in a browser."
)
def command(
    photo: Path,
    recording: Recording,
    modes: tuple[Mode, ...],
    options: Options,
    truth: Path | None,
    report: Path | None,
    target: Target,
) -> None:
    """Deblur PHOTO in every mode and show the results side by side.

    Writes to DIR the picture of each mode, side-by-side.png with enlarged details, psfs.png with the kernels at their
    places in the picture, and compare.json with times and, with --truth, PSNR and SSIM.

    --report writes one page that needs no network. It shows any two pictures under a divider, the kernels over them,
    the gyroscope's rates with the exposure window of each row, all settings, and warnings.
    """
    modes = tuple(mode for mode in MODES if mode in (modes or MODES))
    _options.refuse_unused(options, modes)
    if report is not None:
        _output.check_output(report, force=target.force, suffixes=(".html", ".htm"), kind="the report is an HTML page")
    _output.prepare_folder(target.output, [*output_names(photo, modes), REPORT], force=target.force)
    compare_modes(photo, recording, options, target, truth=truth, modes=modes, page=report)
    if not target.as_json:
        page = "" if report is None else f" Open {report} in a browser."
        _output.say("", f"The pictures are in {target.output}; see {SHEET}.{page}")


def output_names(photo: Path, modes: Sequence[Mode] = MODES) -> list[str]:
    """Return the names of the pictures that `compare_modes` writes: PNG, or TIFF if the photo may contain floats."""
    suffix = ".tif" if photo.suffix.lower() in (".tif", ".tiff") else ".png"
    return [*(mode + suffix for mode in modes), SHEET, MAP]


def compare_modes(
    photo: Path,
    recording: Recording,
    options: Options,
    target: Target,
    *,
    truth: Path | None,
    modes: Sequence[Mode] = MODES,
    page: Path | None = None,
) -> None:
    """Deblur `photo` in each mode, write the pictures and the results into the folder of `target`, and print them."""
    with _output.capture_warnings() as texts:
        # Only --refine refines here, so it is always asked for.
        ready = prepare(photo, recording, options, refine_anyway=options.refine)
        picture, transfer = ready.inputs.picture, transfer_of(ready.inputs.picture, ready.options.transfer)
        sharp = None if truth is None else _read_truth(truth, photo, picture, options.transfer)
        # Options that a mode does not take are refused before the first mode is solved.
        each_mode = {mode: _options.changed(ready.options, mode=mode) for mode in modes}
        shown = {"input": rs.display_values(picture.pixels, transfer)}
        report: dict[str, Any] = {"photo": str(photo), "size_px": list(picture.pixels.shape[1::-1])}
        report |= moment_facts(recording, ready.inputs)
        if sharp is not None:
            report |= {"truth": str(truth), "blurred": rs.similarity(shown["input"], sharp)}
        report["modes"] = {}
        compared = rs.Page(report, *ready.inputs, shown, {}, transfer)
        _solve(ready, compared, each_mode, target)
    if sharp is not None:
        for mode in modes:
            report["modes"][mode] |= rs.similarity(shown[mode], sharp)
        shown["truth"] = sharp
    labels = {
        mode: "global, one PSF" if mode == "global" else f"{mode}, {facts['bands']} x {facts['strips']} PSFs"
        for mode, facts in report["modes"].items()
    }
    panels = {labels.get(name, name): values for name, values in shown.items()}
    rs.write_picture(target.output / SHEET, rs.side_by_side(panels), force=target.force)
    drawing = rs.psf_map(list(compared.banks.values())[-1], shown["input"].shape, picture=shown["input"])
    rs.write_picture(target.output / MAP, drawing, force=target.force)
    if page is not None:
        rs.write_page(page, compared.completed(asdict(recording), options, texts))
        report["report"] = str(page)
    _output.write_json(target.output / REPORT, report)
    if target.as_json:
        _output.print_json(report)
        return
    _output.print_table(*rs.mode_table(report))
    for mode, facts in report["modes"].items():
        _output.say(*(f"  {mode}: {line.strip()}" for line in rs.remarks({"check": facts["check"]})))
    _output.say(*rs.remarks(report))


def _solve(ready: Prepared, compared: rs.Page, each_mode: Mapping[Mode, Options], target: Target) -> None:
    """Deblur and write the picture in each mode, and add the results to the comparison."""
    picture = ready.inputs.picture
    with _output.progress("plan") as move, ready.naming:
        planned = ready.plan(move, next(iter(each_mode.values())))
    if planned.refinement is not None:
        compared.report["refinement"] = rs.refinement_facts(planned.refinement)
    names = output_names(Path(compared.report["photo"]), list(each_mode))
    for (mode, chosen), name in zip(each_mode.items(), names, strict=False):
        chosen = replace(chosen, translation=planned.options.translation, refine=False)
        with stopwatch() as elapsed, _output.progress(mode) as move, ready.naming:
            # A plan of its own, so that a mode does not keep the memory of another one's solver.
            result = rs.Plan(planned.frame, planned.capture, chosen).apply(picture.pixels, progress=move)
            seconds = elapsed()
        rs.write_picture(target.output / name, result.image, like=picture, force=target.force)
        compared.shown[mode], compared.banks[mode] = rs.display_values(result.image, compared.transfer), result.psfs
        compared.report["modes"][mode] = rs.result_facts(result, target.output / name, chosen.prior_name, seconds)


def _read_truth(truth: Path, photo: Path, picture: rs.Picture, transfer: Transfer | Auto) -> rs.NDArray[Any]:
    sharp = rs.read_picture(truth)
    if sharp.pixels.shape != picture.pixels.shape:
        raise InputError(
            f"{truth}: the true picture has shape {sharp.pixels.shape}, but {photo} has {picture.pixels.shape}; "
            "give one of the same size and channels"
        )
    return rs.display_values(sharp.pixels, transfer_of(sharp, transfer))
