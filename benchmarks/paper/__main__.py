"""Repeat the evaluation of the paper and write its page.

``python -m benchmarks.paper [--quick] [--only NAME] [--folder FOLDER]``
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from benchmarks import machine
from benchmarks.data import noted, pages
from benchmarks.paper import baselines, borders, clock, failures, geometry, noise, options, rolling, speed
from benchmarks.paper.figure import section
from benchmarks.tables import write

GROUPS = {
    "geometry": geometry,
    "speed": speed,
    "borders": borders,
    "options": options,
    "clock": clock,
    "baselines": baselines,
    "failures": failures,
    "rolling": rolling,
    "noise": noise,
}
INTRODUCTION = """\
# The paper, measured again

Made by `python -m benchmarks.paper`; do not edit. It repeats the figures and tables of Sindelar and Sroubek (2013,
[reference](../theory.md#references)) on simulated captures with known truth, and adds some that need the truth.
`global` with `motion="small-angle"` is their method. One sentence in each section states whether their finding holds
here.
"""


def main() -> None:
    """Run all groups, or the chosen ones, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few small cases, to see that it runs")
    parser.add_argument("--only", choices=GROUPS, action="append", help="only this group; other figures are kept")
    parser.add_argument("--folder", type=Path, default=pages(), help="folder of the page")
    arguments = parser.parse_args()
    folder = arguments.folder / "paper"
    folder.mkdir(parents=True, exist_ok=True)
    load = machine.load()
    names = arguments.only or list(GROUPS)
    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} groups")
    with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True, highlight=False)) as progress:
        if note := noted("").rstrip():
            progress.console.print(note, markup=False)
        task = progress.add_task("", total=len(names))
        for name in names:
            progress.update(task, description=name)
            for line in run(name, folder, quick=arguments.quick):
                progress.console.print(line, markup=False)
            progress.advance(task)
    write(arguments.folder / "paper.md", noted(page(folder, load)))


def run(name: str, folder: Path, *, quick: bool) -> Iterator[str]:
    """Make the figures of a group, and yield a line about each."""
    begin, processor = time.perf_counter(), processor_time()
    for place, figure in enumerate(GROUPS[name].figures(quick)):
        seconds, busy = time.perf_counter() - begin, processor_time() - processor
        figure.write(folder, group=name, place=place, seconds=round(seconds, 1), processor_seconds=round(busy, 1))
        yield f"{seconds:5.0f} s  {figure.name}: {figure.finding}"
        begin, processor = time.perf_counter(), processor_time()


def processor_time() -> float:
    """Return the processor time of this process and of its finished children, s."""
    return sum(os.times()[:4])


def page(folder: Path, load: float) -> str:
    """Return the page of all figures in the folder."""
    records = [json.loads(file.read_text()) for file in folder.glob("*.json")]
    records.sort(key=lambda record: (list(GROUPS).index(record["group"]), record["place"]))
    seconds, busy = (sum(record[key] for record in records) for key in ("seconds", "processor_seconds"))
    facts = machine.facts()
    times = (
        f"Measured on {facts['cores']} cores of {facts['processor']} (SIMD: {facts['simd']}, FFTW {facts['fftw']}) in "
        f"{seconds:.0f} s, with {busy:.0f} s of processor time."
    )
    return "\n\n".join([INTRODUCTION.rstrip(), times, *machine.busy(load), *map(section, records)])


if __name__ == "__main__":
    main()
