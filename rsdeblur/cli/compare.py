"""`rsdeblur compare`: deblur one picture in every mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.choices import MODES, Auto, Mode, Transfer
from rsdeblur.cli import _options
from rsdeblur.cli._command import Command
from rsdeblur.cli._inputs import display_values, naming, transfer_of
from rsdeblur.cli._options import Recording, Target, Track
from rsdeblur.cli._output import (
    check_page,
    prepare_folder,
    print_json,
    print_table,
    progress,
    say,
    write_json,
)
from rsdeblur.cli._photo import derive, moment_facts, moment_lines, result_facts
from rsdeblur.cli._refinement import correction_lines, refinement_facts
from rsdeblur.cli._report import Compared, capture_warnings, report_page
from rsdeblur.cli._types import PATH
from rsdeblur.cli._usage import refuse_unused
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.io.pictures import Picture
    from rsdeblur.pipeline.options import Options
    from rsdeblur.psf import PsfBank

SHEET, MAP, REPORT = "side-by-side.png", "psfs.png", "compare.json"

EXAMPLES = """\b
Examples:
  rsdeblur compare photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o out
  rsdeblur compare blurred.png --gyro gyro.csv --camera camera.toml --start 0.1 --duration 1/20 \\
      --truth rolling.png -o out
  rsdeblur compare photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o out \\
      --report report.html
  rsdeblur compare photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o out \\
      --mode global --mode banded --max-memory 1GiB
"""


@click.command("compare", cls=Command, epilog=EXAMPLES)
@click.argument("photo", type=PATH)
@_options.recording_options()
@click.option(
    "--mode", "modes", type=click.Choice(MODES), multiple=True, help="Mode to compare; repeat it.  [default: all]"
)
@_options.solve_options(*_options.ONE_PHOTO[1:], "refine", "max_memory")
@_options.track_options
@click.option("--truth", type=PATH, metavar="FILE", help="Sharp picture, to measure PSNR and SSIM.")
@_options.target_options(
    "DIR",
    "Folder to write to.  [default: PHOTO-compare beside the photo]",
    default=lambda photo, **_: _options.beside(photo, "-compare"),
)
@click.option("--report", type=PATH, metavar="HTML", help="Also write a page that shows the results in a browser.")
@click.option("--report-paths", is_flag=True, help="Name the files on that page with their folders.")
def command(
    photo: Path,
    recording: Recording,
    modes: tuple[Mode, ...],
    options: Options,
    track: Track,
    truth: Path | None,
    report: Path | None,
    report_paths: bool,
    target: Target,
) -> None:
    """Deblur PHOTO in every mode and show the results side by side.

    Writes to DIR the picture of each mode, side-by-side.png with enlarged details, psfs.png with the kernels at their
    places in the picture, and compare.json with times, memory and, with --truth, PSNR and SSIM.

    --report writes one page that needs no network. It shows any two pictures under a divider, the kernels over them,
    the gyroscope's rates with the exposure window of each row, figures for each band, all settings, and warnings.
    """
    if report_paths and report is None:
        raise click.UsageError("--report-paths is for the page of --report")
    output, force = target.output, target.force
    modes = tuple(mode for mode in MODES if mode in (modes or MODES))
    refuse_unused(options, modes)
    prepare_folder(output, [*output_names(photo, modes), REPORT], force=force)
    if report is not None:
        check_page(report, force=force)
    with capture_warnings() as remarks:
        compared = compare_modes(photo, recording, options, track, target, truth=truth, modes=modes)
    if report is not None:
        from rsdeblur.report import write_page

        write_page(report, report_page(compared, recording, options, remarks, track=track, with_paths=report_paths))
        compared.report["report"] = str(report)
    write_json(output / REPORT, compared.report)
    if target.as_json:
        print_json(compared.report)
    else:
        print_report(compared.report)
        page = "" if report is None else f" Open {report} in a browser."
        say("", f"The pictures are in {output}; see {SHEET}.{page}")


def output_names(photo: Path, modes: Sequence[Mode] = MODES) -> list[str]:
    """Return the names of the pictures that `compare_modes` writes: PNG, or TIFF if the photo may contain floats."""
    suffix = ".tif" if photo.suffix.lower() in (".tif", ".tiff") else ".png"
    return [*(mode + suffix for mode in modes), SHEET, MAP]


def compare_modes(
    photo: Path,
    recording: Recording,
    options: Options,
    track: Track,
    target: Target,
    *,
    truth: Path | None,
    modes: Sequence[Mode] = MODES,
    changes: Mapping[Mode, Mapping[str, Any]] = MappingProxyType({}),
) -> Compared:
    """Deblur `photo` in each mode, write the pictures into the folder of `target` and return the results.

    `changes` holds fields of `options` that differ in a mode.
    """
    encoding = options.transfer
    # Only --refine refines here, so it is always asked for.
    inputs, options, known_axes = derive(photo, recording, options, track, refine_anyway=True)
    picture, transfer = inputs.picture, transfer_of(inputs.picture, options.transfer)
    sharp = None if truth is None else _read_truth(truth, photo, picture, encoding)
    # Options that a mode does not take are refused before the first mode is solved.
    each_mode = [replace(options, mode=mode, **changes.get(mode, {})) for mode in modes]

    from rsdeblur.cli._measure import forget_peak_memory, peak_memory_mib, similarity
    from rsdeblur.cli._stopwatch import stopwatch
    from rsdeblur.io.picture_output import write_picture
    from rsdeblur.pipeline.deblur import psfs
    from rsdeblur.pipeline.plan import Plan, plan_for

    shown = {"input": display_values(picture.pixels, transfer)}
    banks: dict[Mode, PsfBank] = {}
    report: dict[str, Any] = {"photo": str(photo), "size_px": list(picture.pixels.shape[1::-1])}
    report |= moment_facts(recording, inputs)
    if sharp is not None:
        report |= {"truth": str(truth), "blurred": similarity(shown["input"], sharp)}
    report["modes"] = {}
    with progress("plan") as move, naming(photo, recording):
        planned = plan_for(
            *(picture.pixels, inputs.log, inputs.camera, inputs.exposure, each_mode[0]),
            known_axes=known_axes,
            progress=move,
        )
    recorded: PsfBank | None = None
    if planned.refinement is not None:
        report["refinement"] = refinement_facts(planned.refinement)
        if planned.refinement.accepted:
            recorded = psfs(
                *(inputs.log, inputs.camera, inputs.exposure),
                translation=options.translation,
                motion=options.motion,
                softness=options.softness,
            )
    for mode, chosen, name in zip(modes, each_mode, output_names(photo, modes), strict=False):
        chosen = replace(chosen, translation=planned.options.translation, refine=False)
        forget_peak_memory()
        with stopwatch() as watch, progress(mode) as move, naming(photo, recording):
            # A plan of its own, so that the memory of a mode does not contain the solver of another one.
            result = Plan(planned.frame, planned.capture, chosen).apply(picture.pixels, progress=move)
        memory = peak_memory_mib()
        write_picture(target.output / name, result.image, like=picture, force=target.force)
        shown[mode], banks[mode] = display_values(result.image, transfer), result.psfs
        facts = {"prior": chosen.prior_name} | result_facts(result, target.output / name)
        facts |= {"seconds": watch.seconds, "peak_memory_mib": memory}
        report["modes"][mode] = facts | ({} if sharp is None else similarity(shown[mode], sharp))
    if sharp is not None:
        shown["truth"] = sharp
    _draw(target, shown, banks, report["modes"])
    return Compared(report, inputs, shown, banks, 1.0 - float(result.coverage.mean()), transfer, recorded)


def _read_truth(truth: Path, photo: Path, picture: Picture, transfer: Transfer | Auto) -> NDArray[Any]:
    from rsdeblur.io.pictures import read_picture

    sharp = read_picture(truth)
    if sharp.pixels.shape != picture.pixels.shape:
        raise InputError(
            f"{truth}: the true picture has shape {sharp.pixels.shape}, but {photo} has {picture.pixels.shape}; "
            "give one of the same size and channels"
        )
    return display_values(sharp.pixels, transfer_of(sharp, transfer))


def _draw(target: Target, shown: dict[str, NDArray[Any]], banks: dict[Mode, PsfBank], modes: dict[str, Any]) -> None:
    from rsdeblur.io.picture_output import write_picture
    from rsdeblur.report import psf_map, side_by_side

    labels = {
        mode: "global, one PSF" if mode == "global" else f"{mode}, {facts['bands']} x {facts['strips']} PSFs"
        for mode, facts in modes.items()
    }
    panels = {labels.get(name, name): values for name, values in shown.items()}
    write_picture(target.output / SHEET, side_by_side(panels), force=target.force)
    drawing = psf_map(list(banks.values())[-1], shown["input"].shape, picture=shown["input"])
    write_picture(target.output / MAP, drawing, force=target.force)


def print_report(report: dict[str, Any]) -> None:
    """Print the table of modes, and below it what `deblur` says of a result too."""
    with_truth = "blurred" in report
    columns = [
        "mode",
        "prior",
        "bands x strips",
        "PSF px",
        "time s",
        "peak MiB",
        "check",
        *(["PSNR dB", "SSIM"] if with_truth else []),
    ]
    rows = []
    if with_truth:
        rows.append(["(blurred)", "", "", "", "", "", "", *_similarity_cells(report["blurred"])])
    for mode, facts in report["modes"].items():
        memory = facts["peak_memory_mib"]
        rows.append(
            [
                mode,
                facts["prior"],
                f"{facts['bands']} x {facts['strips']}",
                "{} x {}".format(*facts["psf_px"]),
                f"{facts['seconds']:.2f}",
                "-" if memory is None else f"{memory:.0f}",
                "-" if facts["check"] is None else facts["check"]["verdict"],
                *(_similarity_cells(facts) if with_truth else []),
            ]
        )
    print_table(columns, rows)
    checks = {mode: facts["check"] for mode, facts in report["modes"].items() if facts["check"] is not None}
    say(*(f"  {mode}: {' '.join(check['reasons'])}" for mode, check in checks.items() if check["reasons"]))
    say(*moment_lines(report), *correction_lines(report.get("refinement"), asked=True))


def _similarity_cells(facts: dict[str, Any]) -> list[str]:
    psnr = facts["psnr_db"]
    return ["inf" if psnr is None else f"{psnr:.2f}", f"{facts['ssim']:.3f}"]
