"""Reliability of the check of results: ``python -m benchmarks.verdict [--prior wiener] [--half odd]``.

Simulated captures are deblurred with the right motion, with the small errors of real recordings, and with wrong motion.
The first table counts the verdicts in each case. The second compares them with the truth: is the result better or worse
than the blurred picture? The third shows the effect of ``fallback=True`` on results called bad.

Thresholds were chosen on the captures of odd number (1st, 3rd, ...). The others, the default here, are held out.
Processes share the captures.
"""

from __future__ import annotations

import json
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import get_args

import click
import numpy as np
from rich.progress import track

from benchmarks.captures import SimulatedCapture, quality, simulated
from benchmarks.priors import FOCAL_ERROR, OFFSET_ERROR, RATE_NOISE, jpeg, noisy
from benchmarks.tables import markdown, write
from rsdeblur import GyroLog, QualityCheck, RsdeblurError, deblur
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import PRIORS, Prior
from rsdeblur.estimate.check import Verdict, fall_back
from rsdeblur.image.encoded import EncodedImage

VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
# Least gain or loss, dB, at which a result counts as better or worse than the blurred picture.
EQUAL = 0.5
DECIBELS = 40
SIZES = 0.5, 0.7, 1.5, 2.0


@dataclass(frozen=True)
class Trial:
    """One result: capture, case, PSNR gain over the blurred picture without and with fallback, check."""

    capture: str
    case: str
    gain: float
    blended: float
    check: QualityCheck


def cases(clean: SimulatedCapture) -> Iterator[tuple[str, SimulatedCapture]]:
    """Yield a capture with right, slightly wrong and wrong motion, each with the name of the case."""
    for decibels in (30, 50):
        yield f"right motion, {decibels} dB", noisy(clean, decibels)
    capture = noisy(clean, DECIBELS)
    log, camera, exposure = capture.recording
    yield f"right motion, {DECIBELS} dB", capture
    stored = jpeg(capture.pictures.blurred)
    yield "right motion, JPEG 90", replace(capture, pictures=capture.pictures._replace(blurred=stored))
    yield "focal length + 1 %", focal_length(capture, 1 + FOCAL_ERROR)
    yield "2 ms late", replace(capture, log=GyroLog(log.t + OFFSET_ERROR, log.omega, log.epoch_ns))
    noise = np.random.default_rng(0).normal(0.0, RATE_NOISE, log.omega.shape)
    yield "rates + 0.01 rad/s noise", replace(capture, log=replace(log, omega=log.omega + noise))
    for size in SIZES:
        yield f"focal length x {size:g}", focal_length(capture, size)
    for shift, name in ((1.0, "1 s later"), (0.04, "40 ms later")):
        yield name, replace(capture, exposure=replace(exposure, start=exposure.start + shift))
    for axis, name in enumerate("xyz"):
        signs = np.where(np.arange(3) == axis, -1.0, 1.0)
        yield f"{name} reversed", replace(capture, log=replace(log, omega=log.omega * signs))
    yield "x and y exchanged", replace(capture, log=replace(log, omega=log.omega[:, [1, 0, 2]]))
    yield "readout reversed", replace(capture, camera=replace(camera, readout_direction="bottom-up"))


def focal_length(capture: SimulatedCapture, size: float) -> SimulatedCapture:
    """Return the capture with the focal length multiplied by `size`."""
    fx, fy = capture.camera.focal_length
    return replace(capture, camera=replace(capture.camera, focal_length=(size * fx, size * fy)))


def trials(clean: SimulatedCapture, prior: Prior) -> list[Trial]:
    """Deblur a capture in all cases; leave out motion that is refused because the blur exceeds the picture."""
    all_trials = []
    for case, capture in cases(clean):
        truth, blurred = capture.pictures.rolling, capture.pictures.blurred
        try:
            result = deblur(blurred, *capture.recording, prior=prior, threads=1)
        except RsdeblurError:
            continue
        assert result.check is not None
        before, after = quality(truth, blurred)[0], quality(truth, result.image)[0]
        blended = result.image.copy()
        if result.check.verdict == "bad":
            fall_back(EncodedImage(blurred, "linear"), result.check, blended)
        all_trials.append(Trial(clean.name, case, after - before, quality(truth, blended)[0] - before, result.check))
    return all_trials


def report(all_trials: list[Trial]) -> str:
    """Return the tables: verdicts by case, verdicts by outcome, and bad results with fallback."""
    by_case = [[case, *_counts(some)] for case, some in _grouped(all_trials, lambda trial: trial.case).items()]
    outcomes = _grouped(sorted(all_trials, key=lambda trial: -trial.gain), _outcome)
    by_outcome = [[f"result {name}", *_counts(some)] for name, some in outcomes.items()]
    tables = [markdown(["", "results", *VERDICTS], rows) for rows in (by_case, by_outcome)]
    bad = np.array([(trial.gain, trial.blended) for trial in all_trials if trial.check.verdict == "bad"])
    if len(bad):
        rows = []
        for name, column in zip(("as they are", "with fallback"), bad.T, strict=True):
            rows.append([name, *(f"{x:+.2f}" for x in (column.min(), np.median(column), column.max()))])
        tables.append(markdown(["bad results, dB above the input", "least", "median", "most"], rows))
    return "\n\n".join(tables)


def _outcome(trial: Trial) -> str:
    if abs(trial.gain) <= EQUAL:
        return f"within {EQUAL} dB"
    return "better" if trial.gain > 0 else "worse"


def _grouped(all_trials: list[Trial], key: Callable[[Trial], str]) -> dict[str, list[Trial]]:
    groups: dict[str, list[Trial]] = {}
    for trial in all_trials:
        groups.setdefault(key(trial), []).append(trial)
    return groups


def _counts(group: list[Trial]) -> list[str]:
    verdicts = Counter(trial.check.verdict for trial in group)
    return [str(len(group)), *(str(verdicts[verdict]) for verdict in VERDICTS)]


@click.command()
@click.option(
    "--half", type=click.Choice(["odd", "even"]), default="even", show_default=True, help="Half of the captures."
)
@click.option("--count", type=int, help="Only the first captures of that half.")
@click.option("--prior", type=click.Choice(PRIORS), default="tv", show_default=True)
@click.option("--json", "output", type=Path, help="Write every result to this file.")
def main(half: str, count: int | None, prior: Prior, output: Path | None) -> None:
    """Check results of right and wrong motion, and print the confusion tables."""
    captures = list(simulated(noise=0.0, enlarged=1))[half == "even" :: 2][:count]
    # Every solve uses one thread.
    with ProcessPoolExecutor(thread_count(None), multiprocessing.get_context("spawn")) as pool:
        results = pool.map(partial(trials, prior=prior), captures)
        all_trials = [trial for some in track(results, "checking", total=len(captures)) for trial in some]
    if output:
        write(output, json.dumps([asdict(trial) for trial in all_trials], indent=1))
    print(report(all_trials))


if __name__ == "__main__":
    main()
