"""Rerun the evaluation of the paper and write its page.

``python -m benchmarks.paper [--quick] [--only NAME] [--folder FOLDER]``
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from rich.console import Console

from benchmarks import machine
from benchmarks.captures import ROOT, require_data
from benchmarks.paper import failures, geometry, noise, opponents, rolling, speed
from benchmarks.paper.figure import Figure
from benchmarks.tables import markdown, write

GROUPS = {
    "geometry": geometry,
    "speed": speed,
    "opponents": opponents,
    "failures": failures,
    "rolling": rolling,
    "noise": noise,
}
INTRODUCTION = """\
# The paper, measured again

Made by `python -m benchmarks.paper`; do not edit. The figures and tables of Sindelar and Sroubek (2013) on simulated
captures with known truth, and what they could not show. `global` with `motion="small-angle"` is their method. For every
figure one sentence says whether their finding holds here; the numbers are in CSV and JSON files beside the pictures.
"""


def main() -> None:
    """Run all groups, or some, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few cases and small pictures; says little")
    parser.add_argument("--only", choices=GROUPS, action="append", help="only this group; no page is written")
    parser.add_argument("--folder", type=Path, default=ROOT / "docs" / "benchmarks", help="where the page goes")
    options = parser.parse_args()
    require_data()
    folder = options.folder / "paper"
    folder.mkdir(parents=True, exist_ok=True)
    load = machine.load()
    begin = time.perf_counter()
    console = Console(stderr=True, highlight=False)
    made: list[Figure] = []
    for name in options.only or GROUPS:
        for figure in GROUPS[name].figures(options.quick):
            figure.write(folder)
            made.append(figure)
            console.print(f"{time.perf_counter() - begin:5.0f} s  {figure.name}: {figure.finding}", markup=False)
    if not options.only:
        facts = markdown(("machine", ""), list(machine.facts().items()))
        seconds = f"All of it took {time.perf_counter() - begin:.0f} s."
        parts = [INTRODUCTION.rstrip(), facts, *machine.busy(load), seconds, *(figure.section() for figure in made)]
        write(options.folder / "paper.md", "\n\n".join(parts))


if __name__ == "__main__":
    main()
