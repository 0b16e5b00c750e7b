"""`rsdeblur compare`: all modes on one picture."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.choices import MODES, Auto, Mode, Transfer
from rsdeblur.cli import _options
from rsdeblur.cli._inputs import display_values, naming, read_inputs, transfer_of, unit_range
from rsdeblur.cli._options import Recording, Target
from rsdeblur.cli._output import prepare_folder, print_json, print_table, progress, write_json
from rsdeblur.cli._report import Compared, capture_warnings, report_page
from rsdeblur.errors import InputError, OutputError

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
"""


@click.command("compare", epilog=EXAMPLES)
@click.argument("photo", type=_options.PATH)
@_options.recording_options
@_options.solve_options(*_options.BLUR[1:], *_options.SOLVER, *_options.ONE_PICTURE, *_options.ENGINE)
@click.option("--truth", type=_options.PATH, metavar="FILE", help="The sharp picture, to measure PSNR and SSIM.")
@_options.target_options("DIR", "Folder to write to.")
@click.option(
    "--report", type=_options.PATH, metavar="HTML", help="Also write a page to look at the results in a browser."
)
def command(
    photo: Path,
    recording: Recording,
    options: Options,
    truth: Path | None,
    report: Path | None,
    target: Target,
) -> None:
    """Deblur PHOTO in every mode and lay the results side by side.

    Writes to DIR the picture of each mode, side-by-side.png with details enlarged, psfs.png with the kernels where
    they belong in the picture, and compare.json with times, memory and, given the truth, PSNR and SSIM.

    --report writes one page that needs no network: any two pictures under a slider, the kernels over them, the
    gyroscope's rates with the window of each row, figures band by band, all settings, and what to be wary of.
    """
    output, force = target.output, target.force
    prepare_folder(output, [*output_names(photo), REPORT], force=force)
    if report is not None:
        check_page(report, force=force)
    with capture_warnings() as remarks:
        compared = compare_modes(photo, recording, options, truth=truth, output=output, force=force)
    if report is not None:
        from rsdeblur.report import write_page

        write_page(report, report_page(compared, recording, options, remarks))
        compared.report["report"] = str(report)
    write_json(output / REPORT, compared.report)
    if target.as_json:
        print_json(compared.report)
    else:
        print_report(compared.report)
        if report is not None:
            click.echo(f"\nOpen {report} in a browser.")


def check_page(path: Path, *, force: bool) -> None:
    """Check before the work that the report's page may be written.

    Raises
    ------
    OutputError
        If it is not named like a page, or cannot be written, or exists and `force` is not set.
    """
    from rsdeblur._util.atomic import check_target

    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{path}: the report is a page of HTML; name it like report.html")
    check_target(path, force=force)


def output_names(photo: Path) -> list[str]:
    """Name the pictures that `compare_modes` writes: lossless, and TIFF where the photo may hold floats."""
    suffix = ".tif" if photo.suffix.lower() in (".tif", ".tiff") else ".png"
    return [*(mode + suffix for mode in MODES), SHEET, MAP]


def compare_modes(
    photo: Path, recording: Recording, options: Options, *, truth: Path | None, output: Path, force: bool
) -> Compared:
    """Deblur `photo` in every mode, write the pictures into the folder `output` and return what came out."""
    inputs = read_inputs(photo, recording)
    picture = inputs.picture
    transfer = transfer_of(picture, options.transfer)
    target = None if truth is None else _read_truth(truth, photo, picture, options.transfer)
    # A mode that the options exclude is refused before the first one is solved.
    each_mode = [replace(options, mode=mode, transfer=transfer) for mode in MODES]

    from rsdeblur.cli._measure import forget_peak_memory, peak_memory_mib, similarity
    from rsdeblur.io.pictures import write_picture
    from rsdeblur.pipeline.plan import plan

    shown = {"input": display_values(unit_range(picture.pixels), transfer)}
    banks: dict[Mode, PsfBank] = {}
    report: dict[str, Any] = {"photo": str(photo), "size_px": list(picture.pixels.shape[1::-1])}
    if target is not None:
        report |= {"truth": str(truth), "blurred": similarity(shown["input"], target)}
    report["modes"] = {}
    for chosen, name in zip(each_mode, output_names(photo), strict=False):
        mode = chosen.mode
        forget_peak_memory()
        begin = time.perf_counter()
        with progress(mode) as move, naming(photo, recording):
            result = plan(inputs.log, inputs.camera, inputs.exposure, chosen).apply(picture.pixels, progress=move)
        seconds, memory = time.perf_counter() - begin, peak_memory_mib()
        write_picture(output / name, result.image, like=picture, force=force)
        tall, wide = result.psfs.size
        shown[mode], banks[mode] = display_values(result.image, transfer), result.psfs
        report["modes"][mode] = {
            "output": str(output / name),
            "bands": result.bands,
            "strips": result.strips,
            "psf_px": [wide, tall],
            "nsr": result.nsr,
            "weight": result.weight,
            "seconds": seconds,
            "timings": result.timings,
            "check": None if result.check is None else asdict(result.check),
            "peak_memory_mib": memory,
        } | ({} if target is None else similarity(shown[mode], target))
    if target is not None:
        shown["truth"] = target
    _draw(output, shown, banks, report["modes"], force=force)
    return Compared(report, inputs, shown, banks, 1.0 - float(result.coverage.mean()), transfer)


def _read_truth(truth: Path, photo: Path, picture: Picture, transfer: Transfer | Auto) -> NDArray[Any]:
    from rsdeblur.io.pictures import read_picture

    sharp = read_picture(truth)
    if sharp.pixels.shape != picture.pixels.shape:
        raise InputError(
            f"{truth}: the true picture has shape {sharp.pixels.shape}, {photo} has {picture.pixels.shape}; "
            "they must be alike"
        )
    return display_values(unit_range(sharp.pixels), transfer_of(sharp, transfer))


def _draw(
    output: Path, shown: dict[str, NDArray[Any]], banks: dict[Mode, PsfBank], modes: dict[str, Any], *, force: bool
) -> None:
    from rsdeblur.io.pictures import write_picture
    from rsdeblur.report import psf_map, side_by_side

    labels = {
        mode: "global, one PSF" if mode == "global" else f"{mode}, {found['bands']} x {found['strips']} PSFs"
        for mode, found in modes.items()
    }
    panels = {labels.get(name, name): values for name, values in shown.items()}
    write_picture(output / SHEET, side_by_side(panels), force=force)
    drawing = psf_map(banks[MODES[-1]], shown["input"].shape, picture=shown["input"])
    write_picture(output / MAP, drawing, force=force)


def print_report(report: dict[str, Any]) -> None:
    """Print the table of modes."""
    judged = "blurred" in report
    columns = [
        "mode",
        "bands x strips",
        "PSF px",
        "time s",
        "apply s",
        "peak MiB",
        "check",
        *(["PSNR dB", "SSIM"] if judged else []),
    ]
    rows = []
    if judged:
        rows.append(["(blurred)", "", "", "", "", "", "", *_similarity_cells(report["blurred"])])
    for mode, found in report["modes"].items():
        memory = found["peak_memory_mib"]
        rows.append(
            [
                mode,
                f"{found['bands']} x {found['strips']}",
                "{} x {}".format(*found["psf_px"]),
                f"{found['seconds']:.2f}",
                f"{found['timings']['apply']:.2f}",
                "-" if memory is None else f"{memory:.0f}",
                "-" if found["check"] is None else found["check"]["verdict"],
                *(_similarity_cells(found) if judged else []),
            ]
        )
    print_table(columns, rows)


def _similarity_cells(found: dict[str, Any]) -> list[str]:
    psnr = found["psnr_db"]
    return ["inf" if psnr is None else f"{psnr:.2f}", f"{found['ssim']:.3f}"]
