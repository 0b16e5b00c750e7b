"""Table 1: times of transforms, of the deconvolution and of the whole process."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyfftw
from skimage.transform import resize

from benchmarks import machine
from benchmarks.cases import EXPOSURE, NSR, Case
from benchmarks.paper.figure import Cell, Figure
from benchmarks.timing import interleave, refuse_noise
from rsdeblur import Deconvolver, deblur
from rsdeblur.image.encoded import reduced
from rsdeblur.io import read_picture, write_picture

# Size of the picture, and the authors' ms: without NEON, with it on one core, and on two.
THEIRS: dict[tuple[int, int], tuple[str, str, str]] = {
    (1536, 1152): ("2900", "185", "110"),
    (2048, 1536): ("5300", "330", "195"),
    (2050, 1538): ("-", "1000", "540"),
    (3264, 2448): ("21200", "1450", "800"),
}
ROUNDS = 7
CASE = Case(2048, 1536, (17, 59))
# Ratio of the size of their camera's pictures to the size they work on.
RAW = 3264 / 2048
WHOLE = {"deconvolution, RGB 2048x1536": "2600", "whole process, from 3264x2448": "a little over 6000"}


def figures(quick: bool) -> Iterator[Figure]:
    """Yield table 1."""
    case = Case(256, 192, (9, 15)) if quick else CASE
    sizes = [(width // 8, height // 8) if quick else (width, height) for width, height in THEIRS]
    jobs: dict[tuple[object, int], Callable[[], object]] = {}
    for size in sizes:
        for threads in (1, 2):
            jobs[size, threads] = transform(*size, threads)
    with tempfile.TemporaryDirectory() as folder:
        for threads in (1, 2):
            solver = Deconvolver(case.bank(1), case.shape, nsr=NSR, threads=threads)
            jobs["deconvolution", threads] = lambda solver=solver: solver.apply(case.blurred)  # type: ignore[misc]
            jobs["whole", threads] = process(case, Path(folder), threads)
        load = machine.load()
        measured = interleave(jobs, 2 if quick else ROUNDS, steady=not quick)
    _, usual, awkward, _ = sizes
    compared = {size: measured[size, 1] for size in (usual, awkward)}
    if not quick:
        refuse_noise(load, {f"FFT {size}": each for size, each in compared.items()})
    times: dict[tuple[object, int], Cell] = {
        key: 1e3 * time.median if quick or time.is_steady else "-" for key, time in measured.items()
    }
    rows: list[tuple[Cell, ...]] = []
    for size, theirs in zip(sizes, THEIRS.values(), strict=True):
        rows.append((f"FFT, grey {size[0]}x{size[1]}", *theirs, times[size, 1], times[size, 2]))
    for (label, theirs_ms), key in zip(WHOLE.items(), ("deconvolution", "whole"), strict=True):
        rows.append((label, "-", "-", theirs_ms, times[key, 1], times[key, 2]))
    penalty = compared[awkward] / compared[usual]

    def draw(canvas: Any) -> None:
        axes = canvas.subplots()
        places = np.arange(len(rows))
        for shift, column, label in ((-0.2, 2, "theirs, one core"), (0.0, 3, "theirs, two"), (0.2, 5, "ours, two")):
            values = [float(row[column]) if str(row[column]).replace(".", "").isdigit() else np.nan for row in rows]
            axes.bar(places + shift, values, 0.2, label=label)
        axes.set(yscale="log", ylabel="ms")
        axes.set_xticks(places, [str(row[0]).replace(", ", "\n") for row in rows], fontsize=7)
        axes.legend()

    yield Figure(
        "table1",
        "Table 1: times",
        "Milliseconds: theirs on a phone of 2012 without NEON, with NEON on one core and on two; ours (FFTW, float32, "
        "estimated plans) with one thread and with two, on this machine. A colour picture takes 7 transforms, one of "
        "the PSF and 2 of each channel; the times here are those of the latter 6, after planning. The whole process "
        "reads a JPEG of 3264x2448, reduces it to 2048x1536, makes the PSF, deconvolves and writes a JPEG. Times whose "
        'quartiles are more than 15 % of the median apart are left out ("-").',
        f"Holds: a size with large prime factors (2050x1538) takes {penalty:.1f} times as long as its neighbour "
        "(theirs: 3.0), which is why a work size is chosen; absolute times are not comparable between machines.",
        ("what", "theirs, no NEON", "theirs, 1 core", "theirs, 2 cores", "ours, 1 thread", "ours, 2 threads"),
        rows,
        draw,
    )


def transform(width: int, height: int, threads: int) -> Callable[[], object]:
    """Return a planned forward real transform of a grey picture."""
    source = pyfftw.zeros_aligned((height, width), dtype=np.float32)
    target = pyfftw.empty_aligned((height, width // 2 + 1), dtype=np.complex64)
    plan = pyfftw.FFTW(source, target, axes=(0, 1), flags=("FFTW_MEASURE",), threads=threads)
    execute: Callable[[], object] = plan.execute
    return execute


def process(case: Case, folder: Path, threads: int) -> Callable[[], object]:
    """Return a function that runs the whole process on files."""
    photo, sharp, log = folder / "photo.jpg", folder / f"sharp{threads}.jpg", case.log(1)
    raw = case.camera.scaled(RAW)
    large = resize(case.blurred, (raw.height, raw.width), order=1)
    write_picture(photo, large.clip(0, 1), force=True)

    def run() -> None:
        pixels, camera = reduced(read_picture(photo).pixels, raw, max(case.camera.width, case.camera.height))
        result = deblur(
            pixels,
            log,
            camera,
            EXPOSURE,
            mode="global",
            motion="small-angle",
            nsr=NSR,
            saturation="ignore",
            threads=threads,
            prior="wiener",
        )
        write_picture(sharp, result.image, force=True)

    return run
