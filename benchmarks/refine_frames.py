"""How well `refine` corrects wrong recordings by six photos of each: ``python -m benchmarks.refine_frames``.

It prints a table and writes docs/benchmarks/refine-frames.md. Each row is appended to --records as soon as it is
measured; rows that the file has are not measured again.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import data
from benchmarks.data import noted, pages
from benchmarks.refine import LENGTHS, PICTURES, Case, distance, error, landscape, mounted, psnr
from benchmarks.tables import append, markdown, recorded, write
from rsdeblur import Camera, Correction, Exposure, RsdeblurError, refine
from rsdeblur.estimate.correction import Recording
from rsdeblur.motion.paths import Capture

KINDS = ("none", "offset", "readout", "scale", "all", "axes")
FRAMES = 6

INTRODUCTION = """\
# Refinement by several frames

How well [`refine`](../api.md#refinement) of several photos, and so `rsdeblur video --refine`, corrects recordings that
are wrong by a known amount. Made by

```sh
python -m benchmarks.refine_frames --records FILE
```

A recording has {frames} frames of one camera at random moments of a real phone's shake (seed {seed}). Each frame shows
another Kodak picture; they are otherwise like the captures of [Refinement](refine.md), whose terms are used here: the
means are those of all frames, the worst loss is that of the mean of one recording. Errors are those of that page, and
*all* together have no drift. Means of few recordings vary widely. *Time* is the median wall time of `refine`, on
two cores.
"""


@dataclass(frozen=True)
class Row:
    """What refinement did to one recording with one error: means over its frames, paths in px and PSNR in dB."""

    recording: int
    kind: str
    accepted: bool
    reason: str
    seconds: float
    given_px: float
    refined_px: float
    given: float
    refined: float
    true: float


def filmed(seed: int, number: int) -> list[Case]:
    """Simulate the frames of one recording."""
    log = data.shake()
    random = np.random.default_rng((seed, number))
    scenes = [landscape(name) for name in random.choice(PICTURES, FRAMES, replace=False)]
    height, width, _ = scenes[0].shape
    readout_time, duration = random.choice([0.01, 0.02, 0.03]), random.choice([1 / 30, 1 / 20, 1 / 15])
    camera = Camera(width, height, width * random.uniform(0.75, 1.1), readout_time=float(readout_time))
    found: list[Case] = []
    while len(found) < FRAMES:
        exposure = Exposure(random.uniform(2, 55), float(duration), log.epoch_ns)
        try:
            length = Capture.from_log(log, camera, exposure).probe.lengths.mean()
        except RsdeblurError:
            continue
        if LENGTHS[0] < length < LENGTHS[1]:
            n = len(found)
            found.append(Case(f"{number}-{n}", scenes[n], Recording(log, camera, exposure), FRAMES * number + n))
    return found


def measured(cases: list[Case], number: int, kind: str, seed: int) -> Row | None:
    """Return what refinement does to a recording with an error; None where the log does not describe all frames."""
    random = np.random.default_rng((seed, number, KINDS.index(kind)))
    first = cases[0].true
    if kind == "axes":
        wrong = mounted(random, first)
    else:
        drawn = error(kind, random, first)
        wrong = first.corrected(Correction(drawn.scale, 0.0, 0.0, drawn.offset, drawn.readout, drawn.roll))
    given = [replace(case.true, log=wrong.log, camera=wrong.camera) for case in cases]
    begin = time.perf_counter()
    try:
        found, *_ = refine([case.picture for case in cases], wrong.log, wrong.camera, [each.exposure for each in given])
    except RsdeblurError:
        return None
    seconds = time.perf_counter() - begin
    refined = [replace(each, log=found.log, camera=found.camera) for each in given]

    def mean_psnr(recordings: list[Recording]) -> float:
        return float(np.mean([psnr(case, each) for case, each in zip(cases, recordings, strict=True)]))

    def mean_distance(recordings: list[Recording]) -> float:
        return float(np.mean([distance(each, case.true) for case, each in zip(cases, recordings, strict=True)]))

    return Row(
        number,
        kind,
        found.accepted,
        found.reason,
        seconds,
        mean_distance(given),
        mean_distance(refined),
        given=mean_psnr(given),
        refined=mean_psnr(refined),
        true=mean_psnr([case.true for case in cases]),
    )


def table(rows: list[Row]) -> str:
    """Return the means of each kind of error."""
    lines = []
    for kind in KINDS:
        group = [row for row in rows if row.kind == kind]
        if not group:
            continue
        lost, left = (np.mean([row.true - getattr(row, name) for row in group]) for name in ("given", "refined"))
        paths = (np.mean([getattr(row, name) for row in group]) for name in ("given_px", "refined_px"))
        lines.append(
            (
                "none: the recording is right" if kind == "none" else kind,
                f"{len(group)}",
                f"{sum(row.accepted for row in group)}",
                " -> ".join(f"{px:.2f}" for px in paths),
                f"{lost:.2f}",
                f"{left:.2f}",
                "-" if kind in ("none", "axes") else f"{1 - left / lost:.0%}",
                f"{max(0.0, *(row.given - row.refined for row in group)):.2f}",
                f"{np.median([row.seconds for row in group]):.0f} s",
            )
        )
    header = ("error", "recordings", "accepted", "px", "dB lost", "left", "recovered", "worst", "time")
    return markdown(header, lines)


def main() -> None:
    """Run the benchmark, print its table and write its page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=6, help="number of recordings")
    parser.add_argument("--kinds", default=",".join(KINDS), help="kinds of errors to measure, separated by commas")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--records", type=Path, help="file of records (JSON lines) to continue")
    parser.add_argument("--page", type=Path, default=pages() / "refine-frames.md")
    options = parser.parse_args()
    rows = {(row.recording, row.kind): row for row in (Row(**each) for each in recorded(options.records))}
    for number in range(options.recordings):
        missing = [kind for kind in options.kinds.split(",") if (number, kind) not in rows]
        cases = filmed(options.seed, number) if missing else []
        for kind in missing:
            row = measured(cases, number, kind, options.seed)
            if row is None:
                continue
            rows[number, kind] = row
            print(row, flush=True)
            append(options.records, asdict(row))
    text = table(list(rows.values()))
    print(noted(text))
    write(options.page, noted(INTRODUCTION.format(seed=options.seed, frames=FRAMES) + "\n" + text))


if __name__ == "__main__":
    main()
