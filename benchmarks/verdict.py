"""How often the check of a result is right: ``python -m benchmarks.verdict [--prior tv]``.

Simulated captures are deblurred with the right recording and with wrong ones. Captures of even and of odd number are
counted apart; the thresholds were chosen while looking at both.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, get_args

import click
import numpy as np

from benchmarks.captures import Capture, quality, simulated
from benchmarks.tables import markdown
from benchmarks.timing import progress
from rsdeblur import Camera, Check, Exposure, GyroLog, RsdeblurError, deblur
from rsdeblur.check import Verdict

VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
# dB that a result must gain or lose to count as better or worse than the blurred picture.
EQUAL = 0.5


@dataclass(frozen=True)
class Trial:
    """One result: which capture, what was wrong with the recording, PSNR above the blurred picture's, the check."""

    capture: int
    wrong: str
    gain: float
    check: Check
    share: float


def recordings(capture: Capture) -> Iterator[tuple[str, tuple[GyroLog, Camera, Exposure]]]:
    """Yield the right recording and wrong ones, each with its name."""
    log, camera, exposure = capture.shot
    yield "right", capture.shot
    for shift in (1.0, 0.04):
        yield "other time", (log, camera, replace(exposure, start=exposure.start + shift))
    for axis in range(2):
        signs = np.where(np.arange(3) == axis, -1.0, 1.0)
        yield "axis reversed", (replace(log, omega=log.omega * signs), camera, exposure)
    for size in (0.5, 2.0):
        longer = replace(camera, focal=(size * camera.focal[0], size * camera.focal[1]))
        yield f"focal length x {size:g}", (log, longer, exposure)


def run(captures: list[Capture], **arguments: Any) -> Iterator[Trial]:
    """Deblur every capture with every recording; motion that the picture cannot hold is refused and left out."""
    for number, capture in enumerate(progress(captures, "judging")):
        pictures = capture.pictures
        before = quality(pictures.rolling, pictures.blurred)[0]
        for wrong, shot in recordings(capture):
            try:
                result = deblur(pictures.blurred, *shot, threads=1, **arguments)
            except RsdeblurError:
                continue
            assert result.check is not None
            share = result.timings["check"] / sum(result.timings.values())
            gain = quality(pictures.rolling, result.image)[0] - before
            yield Trial(number, wrong, gain, result.check, share)


def table(trials: list[Trial]) -> str:
    """Return the confusion tables: by what was wrong, and by what came of it."""
    rows = []
    for kind in dict.fromkeys(trial.wrong for trial in trials):
        rows.append([kind, *_counts([trial for trial in trials if trial.wrong == kind])])
    better = [trial for trial in trials if trial.gain > EQUAL]
    worse = [trial for trial in trials if trial.gain < -EQUAL]
    equal = [trial for trial in trials if abs(trial.gain) <= EQUAL]
    for name, some in (("better", better), ("within 0.5 dB", equal), ("worse", worse)):
        rows.append([f"result {name}", *_counts(some)])
    return markdown(["", "results", *VERDICTS], rows)


def _counts(trials: list[Trial]) -> list[str]:
    found = Counter(trial.check.verdict for trial in trials)
    return [str(len(trials)), *(str(found[verdict]) for verdict in VERDICTS)]


@click.command()
@click.option("--count", type=int, help="Captures.  [default: all]")
@click.option("--prior", default="tv", show_default=True)
@click.option("--mode", default="banded", show_default=True)
@click.option("--enlarged", type=int, default=1, show_default=True, help="Size of the pictures, times 512x384.")
@click.option("--all", "each", is_flag=True, help="Print every result.")
def main(count: int | None, prior: str, mode: str, enlarged: int, each: bool) -> None:
    """Judge results of right and wrong recordings."""
    trials = []
    for trial in run(list(simulated(count, enlarged=enlarged)), prior=prior, mode=mode):
        trials.append(trial)
        if not each:
            continue
        check = trial.check
        lead = "-" if check.lead is None else f"{check.lead:.1f} {check.rival}"
        figures = f"{trial.gain:+.1f} dB, lead {lead}, ringing {check.ringing:.4f}"
        more = f"noise x {check.noise_gain}, residual {check.residual}, {trial.share:.0%} of the time"
        print(f"{trial.capture} {trial.wrong}: {check.verdict}, {figures}, {more}", flush=True)
    for name, half in (("even", 0), ("odd", 1)):
        print(f"\nCaptures of {name} number:\n\n{table([trial for trial in trials if trial.capture % 2 == half])}")
    print(f"\nThe check took {np.median([trial.share for trial in trials]):.0%} of the time (median).")


if __name__ == "__main__":
    main()
