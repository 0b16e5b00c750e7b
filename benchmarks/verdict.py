"""Reliability of the check, and worth of the fading: ``python -m benchmarks.verdict [--others] [--phone]``.

Simulated captures are deblurred with the right motion, with the small errors of real recordings, and with wrong motion.
The first table counts the verdicts in each case, and lists the gain by the fading of light below black. The second
compares the verdicts with the truth: is the result better or worse than the blurred picture? With ``--phone`` the
pictures are processed as by a phone.

Thresholds were chosen on fourteen captures, at first on those of odd number (1st, 3rd, ...); the default here is the
other half. With ``--others`` there are eighty more, on which the thresholds of "bad" were chosen as well, and with
``--new`` twenty which no threshold was chosen on.
Processes share the captures. With ``--records`` each capture is appended to a file as soon as it is measured, and
captures that the file has are not measured again.
"""

from __future__ import annotations

import multiprocessing
import statistics
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import click
import numpy as np
from rich.progress import track

from benchmarks.captures import MOMENTS, NEW_MOMENTS, OTHER_MOMENTS, QUICK, SimulatedCapture, quality, simulated
from benchmarks.data import Image, noted
from benchmarks.phone import from_phone
from benchmarks.priors import FOCAL_ERROR, OFFSET_ERROR, RATE_NOISE, jpeg, noisy
from benchmarks.tables import append, markdown, recorded
from rsdeblur import Correction, GyroLog, RsdeblurError, deblur
from rsdeblur._util.threads import thread_count
from rsdeblur.choices import PRIORS, VERDICTS, Prior
from rsdeblur.estimate import QualityCheck
from rsdeblur.estimate.correction import Recording
from rsdeblur.image.mending import fade_undershoot
from rsdeblur.pipeline import steps

# Least gain or loss, dB, at which a result counts as better or worse than the blurred picture, and clearly better.
EQUAL, CLEAR = 0.5, 2.0
DECIBELS = 40
SIZES = 0.5, 0.7, 1.5, 2.0
# A motion that the log lacks: shift of the scene during the exposure, px.
DRIFT = Correction(drift_x=4.0, drift_y=-2.0)


@dataclass(frozen=True)
class Trial:
    """One result.

    Parameters
    ----------
    capture, case : str
        Their names.
    gain, unfaded : float
        PSNR above that of the blurred picture, dB: of the result, and without the fading of light below black.
    check : QualityCheck
        Check of the result.
    """

    capture: str
    case: str
    gain: float
    unfaded: float
    check: QualityCheck


def right(clean: SimulatedCapture) -> dict[str, SimulatedCapture]:
    """Return a capture with the right motion and different noise, the last one of `DECIBELS`."""
    captures = {f"right motion, {decibels} dB": noisy(clean, decibels) for decibels in (30, 50, DECIBELS)}
    pictures = captures[f"right motion, {DECIBELS} dB"].pictures
    stored = replace(clean, pictures=pictures._replace(blurred=jpeg(pictures.blurred)))
    return {"right motion, JPEG 90": stored} | captures


def wrong(capture: SimulatedCapture) -> Iterator[tuple[str, SimulatedCapture]]:
    """Yield a capture with slightly wrong and wrong motion, each with the name of the case."""
    log, camera, exposure = capture.recording
    yield "focal length + 1 %", focal_length(capture, 1 + FOCAL_ERROR)
    yield "2 ms late", replace(capture, log=GyroLog(log.t + OFFSET_ERROR, log.omega, log.epoch_ns))
    noise = np.random.default_rng(0).normal(0.0, RATE_NOISE, log.omega.shape)
    yield "rates + 0.01 rad/s noise", replace(capture, log=replace(log, omega=log.omega + noise))
    drift = f"drift of {DRIFT.drift_x:g} and {DRIFT.drift_y:g} px"
    yield drift, replace(capture, translation=Recording(*capture.recording).corrected(DRIFT).translation)
    for size in SIZES:
        yield f"focal length x {size:g}", focal_length(capture, size)
    for shift, name in ((1.0, "1 s later"), (0.04, "40 ms later")):
        yield name, replace(capture, exposure=replace(exposure, start=exposure.start + shift))
    for axis, name in enumerate("xyz"):
        signs = np.where(np.arange(3) == axis, -1.0, 1.0)
        yield f"{name} reversed", replace(capture, log=replace(log, omega=log.omega * signs))
    half_turn = replace(log, omega=log.omega * (-1.0, -1.0, 1.0))
    yield "half a turn about the optical axis", replace(capture, log=half_turn)
    yield "x and y exchanged", replace(capture, log=replace(log, omega=log.omega[:, [1, 0, 2]]))
    yield "readout reversed", replace(capture, camera=replace(camera, readout_direction="bottom-up"))


def focal_length(capture: SimulatedCapture, size: float) -> SimulatedCapture:
    """Return the capture with the focal length multiplied by `size`."""
    fx, fy = capture.camera.focal_length
    return replace(capture, camera=replace(capture.camera, focal_length=(size * fx, size * fy)))


def trials(captures: dict[str, SimulatedCapture], prior: Prior) -> list[Trial]:
    """Deblur one capture with different noise, and the last of these also with wrong motion.

    Motion that is refused because the blur exceeds the picture is left out.
    """
    unfaded = []

    def fade(sharp: Image, *args: Any, **kwargs: Any) -> None:
        unfaded.append(sharp.copy())
        fade_undershoot(sharp, *args, **kwargs)

    all_trials = []
    for case, capture in (*captures.items(), *wrong(list(captures.values())[-1])):
        truth, blurred = capture.pictures.rolling, capture.pictures.blurred
        try:
            with patch.object(steps, "fade_undershoot", fade):
                result = deblur(
                    blurred,
                    *capture.recording,
                    prior=prior,
                    translation=capture.translation,
                    saturation="ignore",
                    threads=1,
                )
        except RsdeblurError:
            continue
        assert result.check is not None
        # Linear priors do not fade.
        images = blurred, result.image, unfaded.pop() if unfaded else result.image
        before, after, without = (quality(truth, image)[0] for image in images)
        gains = (after - before, without - before)
        all_trials.append(Trial(capture.name, case, *gains, result.check))
    return all_trials


def report(all_trials: list[Trial]) -> str:
    """Return the tables: verdicts and fading by case, verdicts by outcome, and fading."""
    cases = _grouped(all_trials, lambda trial: trial.case)
    by_case = [[case, *_counts(some), *_fading(some)] for case, some in cases.items()]
    outcomes = _grouped(sorted(all_trials, key=lambda trial: -trial.gain), _outcome)
    by_outcome = [[f"result {name}", *_counts(some)] for name, some in outcomes.items()]
    columns = ["", "results", *VERDICTS]
    tables = [markdown([*columns, "fading gains, dB", "least", "most"], by_case), markdown(columns, by_outcome)]
    rows = []
    for name, some in (("with fading", [t.gain for t in all_trials]), ("without", [t.unfaded for t in all_trials])):
        rows.append([name, str(sum(gain < -EQUAL for gain in some)), *_signed(min(some), statistics.mean(some))])
    tables.append(markdown(["results, dB above the input", "worse", "least", "mean"], rows))
    return "\n\n".join(tables)


def _outcome(trial: Trial) -> str:
    if abs(trial.gain) <= EQUAL:
        return f"within {EQUAL} dB"
    if trial.gain > CLEAR:
        return f"better by {CLEAR:g} dB and more"
    return "better" if trial.gain > 0 else "worse"


def _fading(group: list[Trial]) -> list[str]:
    gains = [trial.gain - trial.unfaded for trial in group]
    return _signed(statistics.mean(gains), min(gains), max(gains))


def _signed(*decibels: float) -> list[str]:
    return [f"{value:+.2f}" for value in decibels]


def _grouped(all_trials: list[Trial], key: Callable[[Trial], str]) -> dict[str, list[Trial]]:
    groups: dict[str, list[Trial]] = {}
    for trial in all_trials:
        groups.setdefault(key(trial), []).append(trial)
    return groups


def _counts(group: list[Trial]) -> list[str]:
    verdicts = Counter(trial.check.verdict for trial in group)
    return [str(len(group)), *(str(verdicts[verdict]) for verdict in VERDICTS)]


def load(path: Path | None) -> dict[tuple[str, ...], list[Trial]]:
    """Return the trials in a file of records."""
    return {
        tuple(record["key"]): [Trial(**t | {"check": QualityCheck(**t["check"])}) for t in record["trials"]]
        for record in recorded(path)
    }


@click.command()
@click.option(
    "--half", type=click.Choice(["odd", "even", "all"]), default="even", show_default=True, help="Half of the captures."
)
@click.option("--others", is_flag=True, help="Eighty other captures instead of these fourteen.")
@click.option("--new", is_flag=True, help="Twenty captures which no threshold was chosen on.")
@click.option("--count", type=int, help="Only the first captures.")
@click.option("--quick", is_flag=True, help="One small capture, to see that it runs.")
@click.option("--prior", type=click.Choice(PRIORS), default="tv", show_default=True)
@click.option("--phone", is_flag=True, help="Pictures processed as by a phone.")
@click.option("--records", type=Path, help="File of records (JSON lines) to continue.")
def main(
    half: str,
    others: bool,
    new: bool,
    count: int | None,
    quick: bool,
    prior: Prior,
    phone: bool,
    records: Path | None,
) -> None:
    """Check results of right and wrong motion, and print the confusion tables."""
    moments = NEW_MOMENTS if new else OTHER_MOMENTS if others else MOMENTS
    half = half if moments is MOMENTS else "all"
    part = {"odd": slice(0, None, 2), "even": slice(1, None, 2), "all": slice(None)}[half]
    numbers = range(len(moments))[part][: 1 if quick else count]
    taken = simulated(noise=0.0, enlarged=QUICK if quick else 1, moments=[moments[n] for n in numbers])
    numbered = list(zip(numbers, taken, strict=True))
    keys = [(capture.name, prior, *(["phone"] if phone else [])) for _, capture in numbered]
    known = load(records)
    missing = {
        key: {"right motion, phone": from_phone(capture, n)} if phone else right(capture)
        for key, (n, capture) in zip(keys, numbered, strict=True)
        if key not in known
    }
    # Every solve uses one thread.
    with ProcessPoolExecutor(thread_count(None), multiprocessing.get_context("spawn")) as pool:
        results = pool.map(partial(trials, prior=prior), missing.values())
        for key, some in zip(missing, track(results, "checking", total=len(missing)), strict=True):
            known[key] = some
            append(records, {"key": key, "trials": [asdict(trial) for trial in some]})
    print(noted(report([trial for key in keys for trial in known[key]])))


if __name__ == "__main__":
    main()
