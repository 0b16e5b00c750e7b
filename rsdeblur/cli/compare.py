"""`rsdeblur compare`: all modes on one picture."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rsdeblur.cli import _options
from rsdeblur.cli._inputs import display_values, naming, read_inputs, transfer_of, unit_range
from rsdeblur.cli._options import Blur, Recording, Solver
from rsdeblur.cli._output import prepare_folder, print_json, print_table, progress, write_json
from rsdeblur.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rsdeblur.io.pictures import Picture
    from rsdeblur.method import Mode

MODES: tuple[Mode, ...] = ("global", "banded", "rowwise")
SHEET, MAP, REPORT = "side-by-side.png", "psfs.png", "compare.json"

EXAMPLES = """\b
Examples:
  rsdeblur compare photo.jpg --gyro gyro.csv --camera phone.toml --capture frames.csv --index 4 -o out
  rsdeblur compare blurred.png --gyro gyro.csv --camera camera.toml --start 0.1 --duration 1/20 \\
      --truth rolling.png -o out
"""


@click.command("compare", epilog=EXAMPLES)
@click.argument("photo", type=_options.PATH)
@_options.recording_options
@_options.blur_options
@_options.solver_options
@click.option("--truth", type=_options.PATH, metavar="FILE", help="The sharp picture, to measure PSNR and SSIM.")
@click.option("-o", "--output", type=_options.PATH, required=True, metavar="DIR", help="Folder to write to.")
@_options.force_option
@_options.json_option
def command(
    photo: Path,
    recording: Recording,
    blur: Blur,
    solver: Solver,
    truth: Path | None,
    output: Path,
    force: bool,
    as_json: bool,
) -> None:
    """Deblur PHOTO in every mode and lay the results side by side.

    Writes to DIR the picture of each mode, side-by-side.png with details enlarged, psfs.png with the kernels where
    they belong in the picture, and compare.json with times, memory and, given the truth, PSNR and SSIM.
    """
    prepare_folder(output, [*output_names(photo), REPORT], force=force)
    report = compare_modes(photo, recording, blur, solver, truth=truth, output=output, force=force)
    write_json(output / REPORT, report)
    if as_json:
        print_json(report)
    else:
        print_report(report)


def output_names(photo: Path) -> list[str]:
    """Name the pictures that `compare_modes` writes: lossless, and TIFF where the photo may hold floats."""
    suffix = ".tif" if photo.suffix.lower() in (".tif", ".tiff") else ".png"
    return [*(mode + suffix for mode in MODES), SHEET, MAP]


def compare_modes(
    photo: Path, recording: Recording, blur: Blur, solver: Solver, *, truth: Path | None, output: Path, force: bool
) -> dict[str, Any]:
    """Deblur `photo` in every mode, write the pictures into the folder `output` and return the report."""
    inputs = read_inputs(photo, recording)
    picture = inputs.picture
    transfer = transfer_of(picture, solver.transfer)
    target = None if truth is None else _read_truth(truth, photo, picture, solver)

    from rsdeblur.cli._measure import forget_peak_memory, likeness, peak_memory_mib
    from rsdeblur.io.pictures import write_picture
    from rsdeblur.pipeline import deblur

    shown = {"input": display_values(unit_range(picture.pixels), transfer)}
    report: dict[str, Any] = {"photo": str(photo), "size_px": list(picture.pixels.shape[1::-1])}
    if target is not None:
        report |= {"truth": str(truth), "blurred": likeness(shown["input"], target)}
    report["modes"] = {}
    arguments = asdict(blur) | asdict(solver) | {"transfer": transfer}
    for mode, name in zip(MODES, output_names(photo), strict=False):
        forget_peak_memory()
        begin = time.perf_counter()
        with progress(mode) as move, naming(photo, recording):
            result = deblur(picture.pixels, *inputs[1:], mode=mode, progress=move, **arguments)
        seconds, memory = time.perf_counter() - begin, peak_memory_mib()
        write_picture(output / name, result.image, like=picture, force=force)
        tall, wide = result.psfs.size
        values = display_values(result.image, transfer)
        report["modes"][mode] = {
            "output": str(output / name),
            "bands": result.bands,
            "strips": result.strips,
            "psf_px": [wide, tall],
            "nsr": result.nsr,
            "weight": result.weight,
            "seconds": seconds,
            "timings": result.timings,
            "peak_memory_mib": memory,
        } | ({} if target is None else likeness(values, target))
        shown[f"{mode}, {result.bands} x {result.strips} PSFs" if mode != "global" else "global, one PSF"] = values
    _draw(output, shown, result.psfs, target, force=force)
    return report


def _read_truth(truth: Path, photo: Path, picture: Picture, solver: Solver) -> NDArray[Any]:
    from rsdeblur.io.pictures import read_picture

    sharp = read_picture(truth)
    if sharp.pixels.shape != picture.pixels.shape:
        raise InputError(
            f"{truth}: the true picture has shape {sharp.pixels.shape}, {photo} has {picture.pixels.shape}; "
            "they must be alike"
        )
    return display_values(unit_range(sharp.pixels), transfer_of(sharp, solver.transfer))


def _draw(output: Path, shown: dict[str, NDArray[Any]], psfs: Any, target: NDArray[Any] | None, *, force: bool) -> None:
    from rsdeblur.io.pictures import write_picture
    from rsdeblur.report import psf_map, side_by_side

    panels = shown if target is None else shown | {"truth": target}
    write_picture(output / SHEET, side_by_side(panels), force=force)
    write_picture(output / MAP, psf_map(psfs, shown["input"].shape, picture=shown["input"]), force=force)


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
        *(["PSNR dB", "SSIM"] if judged else []),
    ]
    rows = []
    if judged:
        rows.append(["(blurred)", "", "", "", "", "", *_likeness_cells(report["blurred"])])
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
                *(_likeness_cells(found) if judged else []),
            ]
        )
    print_table(columns, rows)


def _likeness_cells(found: dict[str, Any]) -> list[str]:
    psnr = found["psnr_db"]
    return ["inf" if psnr is None else f"{psnr:.2f}", f"{found['ssim']:.3f}"]
