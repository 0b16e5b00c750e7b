"""Speed compared with other libraries: ``python -m benchmarks.peers [--size 2048x1536] [--rounds 15] [--threads 1 2]``.

Everything runs in one process. All alternatives are built first. Then each is timed once per round, in a new random
order, and compared by the ratio of medians. All get the same blurred RGB picture and the same PSFs. Their results are
compared before timing, so that every alternative does the same work. Missing libraries are named and left out.

PSFs are 17x59 and 73x77 px (width x height): 16x59 and 72x76 of Sindelar and Sroubek (2013), rounded up to odd sizes
because kernels here have a centre pixel. They are the paths of a shaken hand, scaled to fill that box.

With ``--psf``, only these PSFs are measured. ``--quick`` uses small pictures; its times mean nothing. The exit code is
1 if an alternative returns another picture. A missed target is only reported. The tables of ``--markdown`` leave out
times whose quartiles are more than 15 % of the median apart, and are not written on a busy machine.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import alternatives as c
from benchmarks import machine
from benchmarks.cases import Case, size
from benchmarks.data import Image
from benchmarks.tables import markdown, print_table, write
from benchmarks.timing import Times, interleave, progress, refuse_noise

BOXES = ((17, 59), (73, 77))
SIZE, QUICK_SIZE = (2048, 1536), (512, 384)
# Size for the time per pixel. One round of it costs as much as LARGE_SHARE rounds of the others.
LARGE, QUICK_LARGE, LARGE_SHARE = (8000, 6000), (1024, 768), 3
# Where borders differ, 1 / INNER of each side is left out at both ends.
INNER = 4
Record = dict[str, Any]
Key = tuple[str, int]  # alternative, threads


@dataclass(frozen=True, slots=True)
class Target:
    """A bound on the ratio of two alternatives' medians."""

    text: str
    over: str
    under: str
    bound: float
    at_least: bool = False

    def assess(self, medians: dict[str, float]) -> Record:
        """Return the ratio and whether the bound holds; both are None if an alternative is missing."""
        ratio = medians[self.over] / medians[self.under] if {self.over, self.under} <= medians.keys() else None
        met = None if ratio is None else (ratio >= self.bound if self.at_least else ratio <= self.bound)
        return {"text": self.text, "bound": self.bound, "at_least": self.at_least, "ratio": ratio, "met": met}


TARGETS = (
    Target("global / bare 7 FFTs", c.GLOBAL, c.BARE, 1.3),
    Target("16 bands / global", c.banded(16), c.GLOBAL, 1.3),
    Target("64 bands / global", c.banded(64), c.GLOBAL, 2.0),
    Target("scikit-image / global", c.SKIMAGE, c.GLOBAL, 4.0, at_least=True),
    Target("scikit-image, as is / global", c.SKIMAGE_AS_IS, c.GLOBAL, 4.0, at_least=True),
    Target("global / MKL-FFT", c.GLOBAL, c.MKL, 1.0),
    Target("regularizepsf / 16 bands", c.PATCHES, c.banded(16), 15.0, at_least=True),
    Target("motion, PSFs and filters of 16 bands / global", c.REPLAN, c.GLOBAL, 1.0),
)
PER_PIXEL = 1.5


def main() -> None:
    """Run the benchmark and print its tables."""
    options = arguments()
    record = run(
        *(options.size, options.large, options.rounds, options.threads), boxes=options.psf, steady=not options.quick
    )
    record["command"] = "python -m benchmarks.peers " + " ".join(sys.argv[1:])
    for case in record["cases"]:
        print(f"\n{heading(record, case)}\n")
        print_table(COLUMNS, rows(case))
    print()
    print_table(TARGET_COLUMNS, target_rows(record))
    for note in notes(record):
        print(note)
    if options.json:
        write(options.json, json.dumps(record, indent=1))
    if options.markdown:
        refuse_noise(record["load"])
        write(options.markdown, as_markdown(steady_figures(record)))
    refuse_other_pictures(record)


def refuse_other_pictures(record: Record) -> None:
    """Exit with a message if an alternative returned a different picture."""
    wrong = {row["name"] for case in record["cases"] for row in case["alternatives"] if row["same"] is False}
    if wrong:
        sys.exit(f"returned another picture: {', '.join(sorted(wrong))}")


def arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=size, help="width x height of the picture (2048x1536)")
    parser.add_argument("--large", type=size, help="width x height for the time per pixel (8000x6000)")
    parser.add_argument("--rounds", type=int, help="rounds of timing (15)")
    parser.add_argument(
        "--threads", type=int, nargs="+", default=[1, 2], help="threads; targets are for the last (1 2)"
    )
    parser.add_argument(
        "--psf", type=size, nargs="+", choices=BOXES, default=BOXES, metavar="WxH", help="only PSFs of these sizes"
    )
    parser.add_argument("--quick", action="store_true", help="small pictures and 3 rounds, to see that it runs")
    parser.add_argument("--json", type=Path, help="write the record")
    parser.add_argument("--markdown", type=Path, help="write the tables")
    options = parser.parse_args()
    options.size = options.size or (QUICK_SIZE if options.quick else SIZE)
    options.large = options.large or (QUICK_LARGE if options.quick else LARGE)
    options.rounds = options.rounds or (3 if options.quick else 15)
    return options


def run(
    size: tuple[int, int],
    large: tuple[int, int],
    rounds: int,
    threads: Sequence[int],
    *,
    boxes: Sequence[tuple[int, int]] = BOXES,
    steady: bool = False,
) -> Record:
    """Time everything, steadily where the figures mean something, and return the record."""
    record: Record = {"machine": machine.facts(), "size": size, "rounds": rounds, "threads": threads}
    record["load"] = machine.load()
    duels = [duel(Case(*size, box), rounds, threads, steady=steady) for box in boxes]
    record["cases"] = duels
    record["scaling"] = scaling(size, large, max(2, rounds // LARGE_SHARE), threads[-1])
    record["skipped"] = sorted({reason for case in duels for reason in case.pop("skipped")})
    return record


def steady_figures(record: Record) -> Record:
    """Return a record without the times whose repetitions disagree, and without the ratios to them: None instead."""
    return record | {"cases": [_steady_case(case, record["threads"]) for case in record["cases"]]}


def _steady_case(case: Record, threads: Sequence[int]) -> Record:
    steady = {
        (row["name"], n)
        for row in case["alternatives"]
        for n in threads
        if row["threads"] in (n, None) and Times(**row["seconds"]).is_steady
    }

    def kept(row: Record) -> Record:
        n = row["threads"] or threads[-1]
        if (row["name"], n) not in steady:
            return row | {"seconds": row["seconds"] | {"median": None}, "to_bare": None, "to_global": None}
        ratios = {"to_bare": c.BARE, "to_global": c.GLOBAL}
        return row | {key: row[key] if (name, n) in steady else None for key, name in ratios.items()}

    pairs = {target.text: {(target.over, threads[-1]), (target.under, threads[-1])} for target in TARGETS}
    targets = [
        target if pairs[target["text"]] <= steady else target | {"ratio": None, "met": None}
        for target in case["targets"]
    ]
    return case | {"alternatives": [kept(row) for row in case["alternatives"]], "targets": targets}


def duel(case: Case, rounds: int, threads: Sequence[int], *, steady: bool = False) -> Record:
    """Build, compare and time all alternatives for one PSF size."""
    tasks, builds, skipped = build(case, threads)
    pictures = {key: task.comparable(p) for key, task in tasks.items() if isinstance(p := task.run(), np.ndarray)}
    deviations = {key: deviation(key, pictures) for key in tasks}
    times = interleave({key: task.run for key, task in tasks.items()}, rounds, steady=steady)
    medians = {name: t.median for (name, n), t in times.items() if n == threads[-1]}
    return {
        "psf": case.box,
        "alternatives": [entry(key, times, builds[key], deviations[key]) for key in tasks],
        "targets": [target.assess(medians) for target in TARGETS],
        "skipped": skipped,
    }


def build(case: Case, threads: Sequence[int]) -> tuple[dict[Key, c.Task], dict[Key, float], list[str]]:
    """Return all tasks, the seconds that each took to build, and a message for each missing library."""
    tasks, builds, skipped = {}, {}, []
    for name, alternative in progress(list(c.ALTERNATIVES.items()), "building"):
        for n in threads if alternative.threaded else threads[-1:]:
            begin = time.perf_counter()
            try:
                tasks[name, n] = alternative.build(case, n)
            except ImportError as error:
                skipped.append(f"{name}: {error}")
                break
            builds[name, n] = time.perf_counter() - begin
    return tasks, builds, skipped


def deviation(key: Key, pictures: dict[Key, Image]) -> float | None:
    """Return the difference of an alternative's picture from its reference, or None if it has no reference."""
    name, n = key
    alternative = c.ALTERNATIVES[name]
    if alternative.like is None:
        return None
    difference = pictures[key] - pictures[alternative.like, n]
    if alternative.measure == "largest":
        return float(np.abs(difference).max())
    margins = [length // INNER for length in difference.shape[:2]]
    inner = difference[margins[0] : -margins[0], margins[1] : -margins[1]]
    return float(np.sqrt(np.mean(inner**2)))


def entry(key: Key, times: dict[Key, Times], build: float, deviation: float | None) -> Record:
    """Return the record of one alternative."""
    name, n = key
    alternative = c.ALTERNATIVES[name]
    return {
        "name": name,
        "threads": n if alternative.threaded else None,
        "seconds": asdict(times[key]),
        "to_bare": times[key] / times[c.BARE, n],
        "to_global": times[key] / times[c.GLOBAL, n],
        "build_seconds": build,
        "like": alternative.like,
        "measure": alternative.measure,
        "deviation": deviation,
        "same": None if deviation is None else deviation <= alternative.tolerance,
    }


def scaling(small: tuple[int, int], large: tuple[int, int], rounds: int, threads: int) -> Record:
    """Return the time per pixel of a large picture relative to a small one."""
    cases = {size: Case(*size, BOXES[0]) for size in (small, large)}
    makers = {"global": c.ours(1), "16 bands": c.ours(16)}
    tasks = {(mode, size): make(case, threads).run for mode, make in makers.items() for size, case in cases.items()}
    times = interleave(tasks, rounds)
    pixels = large[0] * large[1] / (small[0] * small[1])
    report: Record = {"small": small, "large": large, "psf": BOXES[0], "bound": PER_PIXEL, "modes": {}}
    for mode in makers:
        few, many = times[mode, small], times[mode, large]
        per_pixel = many / few / pixels
        report["modes"][mode] = {
            "small_seconds": few.median,
            "large_seconds": many.median,
            "per_pixel": per_pixel,
            "met": per_pixel <= PER_PIXEL,
        }
    return report


COLUMNS = ("alternative", "threads", "ms", "quartiles", "/ bare FFTs", "/ global", "built in s", "differs by")


def rows(case: Record) -> list[list[str]]:
    """Return the rows of the table of one PSF size."""
    return [
        [
            row["name"],
            str(row["threads"] or "-"),
            _figure(row["seconds"]["median"], 1e3, ".1f"),
            f"{1e3 * row['seconds']['low']:.1f} - {1e3 * row['seconds']['high']:.1f}",
            _figure(row["to_bare"]),
            _figure(row["to_global"]),
            f"{row['build_seconds']:.2f}",
            _difference(row),
        ]
        for row in case["alternatives"]
    ]


TARGET_COLUMNS = ("target", "PSF", "bound", "reached", "outcome")


def target_rows(record: Record) -> list[list[str]]:
    """Return the rows of the table of targets."""
    table = [
        [
            target["text"],
            _by(case["psf"]),
            f"{'at least' if target['at_least'] else 'at most'} {target['bound']:g}",
            _figure(target["ratio"]),
            "not measured" if target["met"] is None else ("met" if target["met"] else "missed"),
        ]
        for case in record["cases"]
        for target in case["targets"]
    ]
    scaling = record["scaling"]
    for mode, result in scaling["modes"].items():
        text = f"time per pixel, {mode}: {_by(scaling['large'])} / {_by(scaling['small'])}"
        bound, met = f"at most {scaling['bound']:g}", "met" if result["met"] else "missed"
        table.append([text, _by(scaling["psf"]), bound, f"{result['per_pixel']:.2f}", met])
    return table


def heading(record: Record, case: Record) -> str:
    """Return the heading of the table of one PSF size."""
    return f"{_by(record['size'])} RGB float32, PSF {_by(case['psf'])}, medians of {record['rounds']} rounds"


def as_markdown(record: Record) -> str:
    """Return all tables as Markdown."""
    parts = [markdown(("machine", "fact"), list(record["machine"].items()))]
    parts += [f"### Targets (`threads={record['threads'][-1]}`)", markdown(TARGET_COLUMNS, target_rows(record))]
    for case in record["cases"]:
        parts += [f"### {heading(record, case)}", markdown(COLUMNS, rows(case))]
    return "\n\n".join(parts + notes(record))


def notes(record: Record) -> list[str]:
    """Return remarks that limit the validity of the figures."""
    remarks = [f"Skipped: {reason}." for reason in record["skipped"]]
    return remarks + machine.busy(record["load"])


def _figure(value: float | None, unit: float = 1.0, form: str = ".2f") -> str:
    return "-" if value is None else f"{unit * value:{form}}"


def _difference(row: Record) -> str:
    if row["deviation"] is None:
        return ""
    measure = "" if row["measure"] == "largest" else " rms"
    return f"{row['deviation']:.1e}{measure}{'' if row['same'] else ' NOT THE SAME'}"


def _by(size: Sequence[int]) -> str:
    return f"{size[0]}x{size[1]}"


if __name__ == "__main__":
    main()
