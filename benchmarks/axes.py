"""Recordings with wrong axes: what `sync` and `refine` say of them: ``python -m benchmarks.axes [--records FILE]``.

Each camera has one of the phone presets; its captures are simulated, processed as by a phone, and searched and refined
with every preset, at a clock offset that is a little wrong. Rows of --records are appended as soon as they are
measured, and rows that the file has are not measured again.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.data import noted
from benchmarks.refine import Case, cases, psnr
from benchmarks.tables import append, markdown, recorded, report
from rsdeblur import find_time_offset, refine
from rsdeblur.estimate.correction import Recording
from rsdeblur.motion.axes import PRESETS, imu_to_camera

PHONES = tuple(name for name in PRESETS if name.startswith("phone"))
CAPTURES = 4
# Errors of the clock offset, s.
LATE = 3e-3, 15e-3
# What is said of an accepted correction that leaves the axes in doubt.
DRIFT = "the drift makes up much of the motion"
HEADER = "axes", "recordings", "sync: sure", "named", "refine: corrected", "doubted", "named", "better", "worse"


@dataclass(frozen=True)
class Row:
    """What was said of one capture with one preset: reasons are empty where there is an answer; PSNR in dB."""

    seed: int
    capture: int
    preset: str
    given: str
    offset_error: float
    sync: str
    refine: str
    before: float
    after: float

    @property
    def turn(self) -> str:
        """The relative turn of the two presets."""
        angle = np.trace(imu_to_camera(self.given) @ imu_to_camera(self.preset).T)
        return {3.0: "right", 1.0: "a quarter", -1.0: "a half"}[float(angle)]


def measured(case: Case, seed: int, preset: str, given: str) -> Row:
    """Return what is said of a capture of a camera with one preset that is given another."""
    true = replace(case.true, camera=replace(case.true.camera, imu_to_camera=imu_to_camera(preset)))
    # The log that this phone records of the same motion.
    axes = true.camera.imu_to_camera.T @ case.true.camera.imu_to_camera
    log = replace(true.log, omega=true.log.omega @ axes.T)
    random = np.random.default_rng(case.number)
    late = float(random.choice([-1, 1]) * random.uniform(*LATE))
    camera = replace(true.camera, imu_to_camera=imu_to_camera(given), time_offset=true.camera.time_offset + late)
    search = find_time_offset(case.picture, log, camera, true.exposure)
    found = refine(case.picture, log, camera, true.exposure)
    corrected = Recording(found.log, found.camera, found.exposure, found.translation)
    return Row(
        *(seed, case.number, preset, given, search.best - true.camera.time_offset),
        *(search.reason, found.reason if found.confidence or not found.accepted else DRIFT),
        *(psnr(case, recording) for recording in (Recording(log, camera, true.exposure), corrected)),
    )


def lines(rows: Sequence[Row]) -> Iterator[list[str]]:
    """Yield the lines of the table."""
    for turn in ("right", "a quarter", "a half"):
        group = [row for row in rows if row.turn == turn]
        counts = Counter[str]()
        for row in group:
            counts["sure"] += not row.sync
            counts["named"] += "axes" in row.sync
            counts["corrected"] += row.refine in ("", DRIFT)
            counts["doubted"] += row.refine == DRIFT
            counts["refine named"] += "axes" in row.refine
            counts["better"] += row.after - row.before > 0.5
            counts["worse"] += row.before - row.after > 0.5
        names = "sure", "named", "corrected", "doubted", "refine named", "better", "worse"
        yield [turn, f"{len(group)}", *(f"{counts[name]}" for name in names)]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=int, default=CAPTURES, help="captures of each preset")
    parser.add_argument("--seed", type=int, default=6060)
    parser.add_argument("--records", type=Path, help="file of records (JSON lines) to continue")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown")
    options = parser.parse_args()
    rows = [row for row in (Row(**each) for each in recorded(options.records)) if row.seed == options.seed]
    for case in cases(options.captures * len(PHONES), options.seed):
        for given in PHONES:
            if (case.number, given) in {(row.capture, row.given) for row in rows}:
                continue
            row = measured(case, options.seed, PHONES[case.number % len(PHONES)], given)
            rows.append(row)
            print(row, flush=True)
            append(options.records, asdict(row))
    report(noted(markdown(HEADER, lines(rows))), options.markdown)


if __name__ == "__main__":
    main()
