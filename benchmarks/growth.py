"""Growth of time and memory: ``python -m benchmarks.growth [--rounds 5] [--json FILE] [--plots FOLDER]``.

Four series for RGB float32, each starting from 2048x1536, a PSF of 17x59 px and 16 bands: over the size of the picture,
the height of the PSF, the number of bands and the number of strips. Each point is measured in a separate process, which
has its own peak of memory and its own plans, and twice, minutes apart: the faster process counts. Time is the median of
`apply` into a given array. Extra memory is the peak of the process while the solver was built and applied, less the
pictures in and out.

``--quick`` uses small pictures; its times mean nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine
from benchmarks.cases import NSR, Case
from benchmarks.tables import print_table, write
from benchmarks.timing import Times, interleave, progress
from rsdeblur import Deconvolver

Record = dict[str, Any]
# Passes over all points where times are published.
PASSES = 2


@dataclass(frozen=True, slots=True)
class Point:
    """One configuration; one band is the global mode."""

    width: int = 2048
    height: int = 1536
    psf_width: int = 17
    psf_height: int = 59
    bands: int = 16
    strips: int = 1


@dataclass(frozen=True, slots=True)
class Series:
    """Points along one axis, for one or two modes.

    Parameters
    ----------
    label : str
        Label of the axis.
    x : sequence of float
        Position of each point.
    modes : dict of list of Point
    logarithmic : bool
        Whether time is expected to grow with x.
    """

    label: str
    x: Sequence[float]
    modes: dict[str, list[Point]]
    logarithmic: bool = False


def series(
    start: Point, sizes: Sequence[tuple[int, int]], heights: Sequence[int], counts: Sequence[int]
) -> list[Series]:
    """Return the four series from a starting point."""
    modes = {"global": replace(start, bands=1), f"{start.bands} bands": start}
    by_size = {name: [replace(point, width=w, height=h) for w, h in sizes] for name, point in modes.items()}
    by_height = {name: [replace(point, psf_height=h) for h in heights] for name, point in modes.items()}
    strips = [n for n in counts if n <= start.bands]
    return [
        Series("size (megapixels)", [w * h / 1e6 for w, h in sizes], by_size, logarithmic=True),
        Series("height of the PSF (px)", heights, by_height),
        Series("bands", counts, {"1 strip": [replace(start, bands=n) for n in counts]}),
        Series("strips", strips, {f"{start.bands} bands": [replace(start, strips=n) for n in strips]}),
    ]


FULL = series(
    Point(),
    # 0.5, 1, 2, 3, 6, 12, 24 and 48 megapixels
    sizes=((816, 612), (1152, 864), (1632, 1224), (2048, 1536), (2832, 2124), (4000, 3000), (5656, 4242), (8000, 6000)),
    heights=(9, 17, 31, 59, 77, 121, 201),
    counts=(1, 2, 4, 8, 16, 32, 64),
)
QUICK = series(Point(256, 192, 9, 17, 4), sizes=((256, 192), (512, 384)), heights=(9, 17), counts=(1, 4))


def main() -> None:
    """Measure all series, print them and draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, help="rounds of timing for each point (5)")
    parser.add_argument("--threads", type=int, default=2, help="threads (2)")
    parser.add_argument("--quick", action="store_true", help="few small points, to see that it runs")
    parser.add_argument("--json", type=Path, help="write the record")
    parser.add_argument("--plots", type=Path, help="draw the curves as SVG into this folder")
    parser.add_argument("--point", help=argparse.SUPPRESS)
    options = parser.parse_args()
    rounds = options.rounds or (2 if options.quick else 5)
    if options.point:
        point = Point(**json.loads(options.point))
        print(json.dumps(measure(point, rounds, options.threads, steady=not options.quick)))
        return
    record = run(QUICK if options.quick else FULL, rounds, options.threads, steady=not options.quick)
    record["command"] = "python -m benchmarks.growth " + " ".join(sys.argv[1:])
    for curve in record["series"]:
        print()
        print_table(columns(curve), rows(curve))
    for note in machine.busy(record["load"]):
        print(note)
    if options.json:
        write(options.json, json.dumps(record, indent=1))
    if options.plots:
        for path in draw(record, options.plots):
            print(f"drew {path}")


def run(planned: Sequence[Series], rounds: int, threads: int, *, steady: bool = False) -> Record:
    """Measure every point in a separate process.

    Where times are to be steady, there are two passes over all points, of which the faster counts for each.
    """
    load = machine.load()
    points = list(dict.fromkeys(point for s in planned for mode in s.modes.values() for point in mode))
    # A process lasts seconds, and the work of other machines of the host minutes: no process can avoid it.
    passes = PASSES if steady else 1
    by_point: dict[Point, Record] = {}
    for point in progress(passes * points, "measuring"):
        record = _in_new_process(point, rounds, threads, steady)
        by_point[point] = min(by_point.get(point, record), record, key=lambda each: each["apply_seconds"]["median"])
    return {
        "machine": machine.facts(),
        "load": load,
        "rounds": rounds,
        "threads": threads,
        "series": [
            {
                "label": s.label,
                "x": list(s.x),
                "logarithmic": s.logarithmic,
                "modes": {name: [by_point[point] for point in points] for name, points in s.modes.items()},
            }
            for s in planned
        ],
    }


def measure(point: Point, rounds: int, threads: int, *, steady: bool = False) -> Record:
    """Return the time and the extra memory of one point; memory is None where the system does not report it."""
    case = Case(point.width, point.height, (point.psf_width, point.psf_height))
    bank = case.bank(point.bands, point.strips)
    picture, out = case.sharp, np.ones(case.shape, dtype=np.float32)
    before = machine.forget_peak()
    begin = time.perf_counter()
    solver = Deconvolver(bank, case.shape, nsr=NSR, planning="measure", threads=threads)
    planned = time.perf_counter() - begin
    solver.apply(picture, out=out)
    peak = machine.peak_memory()
    extra = None if before is None or peak is None else peak - before
    times = interleave({"apply": lambda: solver.apply(picture, out=out)}, rounds, steady=steady)["apply"]
    return {**asdict(point), "plan_seconds": planned, "apply_seconds": asdict(times), "extra_bytes": extra}


def _in_new_process(point: Point, rounds: int, threads: int, steady: bool = False) -> Record:
    task = ["--point", json.dumps(asdict(point)), "--rounds", str(rounds), "--threads", str(threads)]
    task += [] if steady else ["--quick"]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.growth", *task], stdout=subprocess.PIPE, check=True, text=True
    )
    record: Record = json.loads(done.stdout)
    return record


def columns(curve: Record) -> list[str]:
    """Return the column titles of the table of a series."""
    quantities = ("ms", "ns/px", "extra MiB")
    return [curve["label"], *(f"{mode}: {quantity}" for mode in curve["modes"] for quantity in quantities)]


def rows(curve: Record) -> list[list[str]]:
    """Return the rows of the table of a series."""
    return [
        [f"{x:.3g}", *(cell for mode in curve["modes"].values() for cell in _cells(mode[i]))]
        for i, x in enumerate(curve["x"])
    ]


def _cells(point: Record) -> list[str]:
    seconds = _steady_seconds(point)
    extra = "-" if point["extra_bytes"] is None else f"{point['extra_bytes'] / 2**20:.0f}"
    per_pixel = 1e9 * seconds / (point["width"] * point["height"])
    return [*("-" if math.isnan(figure) else f"{figure:.1f}" for figure in (1e3 * seconds, per_pixel)), extra]


def _steady_seconds(point: Record) -> float:
    """Return the time of a point, or NaN where its repetitions disagree."""
    times = Times(**point["apply_seconds"])
    return times.median if times.is_steady else math.nan


def plot_names(record: Record) -> list[str]:
    """Return the file name of each series' plot."""
    return [f"growth-{curve['label'].split(' (')[0].replace(' ', '-').lower()}.svg" for curve in record["series"]]


def draw(record: Record, folder: Path) -> list[Path]:
    """Draw time and extra memory of each series; return the files."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    # No date and no random names: the same curves give the same file.
    with mpl.rc_context({"svg.hashsalt": "rsdeblur", "svg.fonttype": "none"}):
        for curve, name in zip(record["series"], plot_names(record), strict=True):
            figure = Figure(figsize=(9, 3.4), layout="constrained")
            for axes, quantity in zip(figure.subplots(1, 2), ("time of apply (ms)", "extra memory (MiB)"), strict=True):
                for mode, points in curve["modes"].items():
                    axes.plot(curve["x"], [_value(point, quantity) for point in points], "o-", label=mode)
                if curve["logarithmic"]:
                    axes.set(xscale="log", yscale="log")
                    axes.set_xticks(curve["x"], [f"{x:.2g}" for x in curve["x"]])
                    axes.minorticks_off()
                    axes.yaxis.set_major_formatter("{x:g}")
                else:
                    axes.set_ylim(bottom=0)
                axes.set(xlabel=curve["label"], ylabel=quantity)
                axes.grid(alpha=0.3)
                axes.legend()
            paths.append(folder / name)
            figure.savefig(paths[-1], metadata={"Date": None})
    return paths


def _value(point: Record, quantity: str) -> float:
    if quantity.startswith("time"):
        return 1e3 * _steady_seconds(point)
    return float("nan") if point["extra_bytes"] is None else point["extra_bytes"] / 2**20


if __name__ == "__main__":
    main()
