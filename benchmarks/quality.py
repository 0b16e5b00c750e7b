"""PSNR and SSIM of every mode on simulated captures: ``python -m benchmarks.quality [--markdown FILE] [--json FILE]``.

All captures have the same NSR: the value of a short ladder with the best mean PSNR in banded mode. The table for `keep`
compares with the rolling truth, the table for `rectify` with the rectified truth.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from benchmarks.captures import QUICK, SimulatedCapture, quality, simulated
from benchmarks.data import noted
from benchmarks.tables import markdown, report, write
from rsdeblur import deblur
from rsdeblur.choices import GEOMETRIES, Geometry

LADDER = (0.01, 0.03, 0.1, 0.3)
METHODS: dict[str, dict[str, Any]] = {
    "global": {"mode": "global"},
    **{
        f"banded {bands} x {strips}": {"mode": "banded", "bands": bands, "strips": strips}
        for strips in (1, "auto")
        for bands in (4, 8, 16, "auto")
    },
    "rowwise x 1": {"mode": "rowwise", "strips": 1},
    "rowwise x auto": {"mode": "rowwise"},
}
Scores = dict[str, dict[str, tuple[float, float]]]


def main() -> None:
    """Run the benchmark and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captures", type=int, help="only the first N of the 14 captures")
    parser.add_argument("--quick", action="store_true", help="one small capture, to see that it runs")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown")
    parser.add_argument("--json", type=Path, help="write all scores")
    options = parser.parse_args()
    count, enlarged = (1, QUICK) if options.quick else (options.captures, 2)
    scores = run(list(track(simulated(count, enlarged=enlarged), "simulating", total=count or 14)))
    report(noted(scores["markdown"]), options.markdown)
    if options.json:
        write(options.json, json.dumps({k: v for k, v in scores.items() if k != "markdown"}, indent=1))


def run(captures: Sequence[SimulatedCapture]) -> dict[str, Any]:
    """Score all methods in both geometries; return scores and tables."""
    nsr, ladder = choose_nsr(captures)
    tables, record = [], {"nsr": nsr, "ladder": ladder}
    for geometry in GEOMETRIES:
        scores = {c.name: score(c, geometry, nsr) for c in track(captures, geometry)}
        record[geometry] = scores
        tables.append(f'### `geometry="{geometry}"`\n\n{table(scores)}')
    worst = {c.name: best_loss(c) for c in track(captures, "do no harm")}
    record["best_minus_blurred_db"] = worst
    rows = "\n".join(f"| {n} | " + " | ".join(f"{v:.2f}" for v in row.values()) + " |" for n, row in ladder.items())
    names = list(next(iter(ladder.values())))
    record["markdown"] = "\n\n".join(
        [
            f"NSR chosen for the noise: {nsr} (banded auto x auto, PSNR in dB):",
            "| NSR | " + " | ".join(names) + " |\n|---|" + "---|" * len(names) + "\n" + rows,
            *tables,
            "Gain over the blurred picture at the best NSR of the ladder for each capture:",
            markdown(
                ("capture", "gain, dB", "at NSR"),
                [(name, f"{gain:+.2f}", str(at)) for name, (gain, at) in worst.items()],
            ),
        ]
    )
    return record


def choose_nsr(captures: Sequence[SimulatedCapture]) -> tuple[float, dict[str, dict[str, float]]]:
    """Return the NSR of the ladder that is best on average, and the PSNR of each capture at each NSR."""
    ladder = {}
    for nsr in LADDER:
        row = {
            c.name: quality(
                c.pictures.rolling, deblur(c.pictures.blurred, *c.recording, prior="wiener", nsr=nsr).image
            )[0]
            for c in captures
        }
        ladder[str(nsr)] = row | {"mean": float(np.mean(list(row.values())))}
    return max(LADDER, key=lambda nsr: ladder[str(nsr)]["mean"]), ladder


def best_loss(capture: SimulatedCapture) -> tuple[float, float]:
    """Return the gain over the blurred picture at the best NSR for this capture, dB, and that NSR."""
    truth = capture.pictures.rolling
    gains = {
        nsr: quality(truth, deblur(capture.pictures.blurred, *capture.recording, prior="wiener", nsr=nsr).image)[0]
        for nsr in (*LADDER, 1.0)
    }
    best = max(gains, key=lambda nsr: gains[nsr])
    return gains[best] - quality(truth, capture.pictures.blurred)[0], best


def score(capture: SimulatedCapture, geometry: Geometry, nsr: float) -> dict[str, tuple[float, float]]:
    """Return PSNR and SSIM of the blurred picture and of every method."""
    blurred = capture.pictures.blurred
    truth = capture.pictures.rolling if geometry == "keep" else capture.pictures.rectified
    scores = {"blurred": quality(truth, blurred)}
    for name, kwargs in METHODS.items():
        image = deblur(blurred, *capture.recording, prior="wiener", nsr=nsr, geometry=geometry, **kwargs).image
        scores[name] = quality(truth, image)
    return scores


def table(scores: Scores) -> str:
    """Return a Markdown table of PSNR / SSIM, a row per capture and one for the mean."""
    methods = list(next(iter(scores.values())))
    mean = {m: tuple(np.mean([row[m] for row in scores.values()], axis=0)) for m in methods}
    lines = ["| capture | " + " | ".join(methods) + " |", "|---|" + "---|" * len(methods)]
    for name, row in {**scores, "**mean**": mean}.items():
        lines.append(f"| {name} | " + " | ".join(f"{row[m][0]:.2f} / {row[m][1]:.3f}" for m in methods) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
