"""Times of alternatives, measured in turns so that disturbances of the machine affect all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks import machine

# Largest distance of the quartiles, as a share of the median, of figures that are published.
MOST_SPREAD = 0.15
# A steady measurement is the fastest of calls that last this long together, s.
LENGTH = 0.5
# Most of a call's time that the host of a virtual machine may take away. Its clock ticks every 0.01 s, so short calls
# bear no tick, and long ones bear what does not matter.
MOST_STOLEN = 0.01
# Disturbed calls of one measurement may last this long together, s; they are used if there are no others.
PATIENCE = 1.5
# Most rounds until the quartiles of all jobs agree, as a multiple of those that count.
MOST_ROUNDS = 6

Job = Callable[[], object]
T = TypeVar("T")
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Times:
    """Median and quartiles of repeated measurements, s."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, seconds: Sequence[float]) -> Times:
        """Return the summary of measurements in s."""
        low, median, high = np.percentile(seconds, [25, 50, 75])
        return cls(float(median), float(low), float(high))

    @property
    def spread(self) -> float:
        """Distance of the quartiles as a share of the median."""
        return (self.high - self.low) / self.median

    @property
    def is_steady(self) -> bool:
        """Whether the quartiles are close enough for a figure that is published."""
        return self.spread <= MOST_SPREAD

    def __truediv__(self, other: Times) -> float:
        """Return the ratio of the medians."""
        return self.median / other.median


def refuse_noise(load: float, times: Mapping[str, Times] | None = None) -> None:
    """Exit instead of publishing figures of a busy machine, or of repetitions that disagree.

    Parameters
    ----------
    load : float
        Average number of running processes before the measurement.
    times : mapping of str to Times, optional
        What was measured, by the name to report.

    Raises
    ------
    SystemExit
        If the load exceeds :data:`benchmarks.machine.BUSY`, or a spread exceeds 15 %.
    """
    reasons = [f"the load was {load:.1f}, more than {machine.BUSY}"] if load > machine.BUSY else []
    wide = {name: each.spread for name, each in (times or {}).items() if not each.is_steady}
    reasons += [f"{name}: the quartiles are {spread:.0%} of the median apart" for name, spread in wide.items()]
    if reasons:
        raise SystemExit("\n".join(["not published; measure again on an idle machine:", *reasons]))


def interleave(
    jobs: Mapping[Key, Job],
    rounds: int,
    *,
    steady: bool = False,
    clock: Callable[[], float] = time.perf_counter,
    stolen: Callable[[], float] = machine.stolen,
    seed: int = 0,
) -> dict[Key, Times]:
    """Time all jobs, one measurement of each per round.

    Each round has a new random order, so that no job always runs with the caches and the clock rate that the same job
    left behind. A first round is not counted.

    Parameters
    ----------
    jobs : mapping to callable
    rounds : int
        Number of counted rounds, at least 1.
    steady : bool, default False
        Whether figures are to be published: calls are then repeated, see :func:`fastest`, and rounds go on, up to 6
        times `rounds`, until in the last ones no job's quartiles are more than 15 % of its median apart. Where they
        never agree, those `rounds` in sequence count that took the least time: other machines of the same host, whose
        work slows all jobs down, were quietest then. Otherwise a measurement is one call.
    clock, stolen : callable
        Return the time, and the time that the host has taken away, in s.
    seed : int
        Seed of the random orders.

    Returns
    -------
    dict of Times
        In the order of `jobs`, of the `rounds` that count.
    """
    random = np.random.default_rng(seed)
    keys = list(jobs)
    seconds: dict[Key, list[float]] = {key: [] for key in keys}
    for done in progress(range((MOST_ROUNDS if steady else 1) * rounds + 1), "measuring"):
        for i in random.permutation(len(keys)):
            job = jobs[keys[i]]
            seconds[keys[i]].append(fastest(job, clock, stolen) if steady else _seconds(job, clock))
        if done >= rounds:
            times = {key: Times.of(measured[-rounds:]) for key, measured in seconds.items()}
            if all(each.is_steady for each in times.values()):
                return times
    begin = _quietest(list(seconds.values()), rounds)
    return {key: Times.of(measured[begin : begin + rounds]) for key, measured in seconds.items()}


def _quietest(seconds: Sequence[Sequence[float]], rounds: int) -> int:
    """Return the first of so many rounds in sequence that took the least time, all jobs alike; round 0 never counts."""
    relative = np.mean([np.divide(measured, np.median(measured)) for measured in seconds], axis=0)
    return 1 + int(np.argmin(np.convolve(relative[1:], np.ones(rounds), mode="valid")))


def fastest(job: Job, clock: Callable[[], float], stolen: Callable[[], float]) -> float:
    """Return the time of the fastest of calls that last 0.5 s together, s.

    What slows a call down is not the job, but interrupts and other work of the machine or of its host. Calls during
    which the host of a virtual machine gave a processor to others do not count, unless they are all that 1.5 s bring.
    """
    undisturbed, disturbed = list[float](), list[float]()
    while sum(undisturbed) < LENGTH and sum(disturbed) < PATIENCE:
        lost, took = stolen(), _seconds(job, clock)
        (undisturbed if stolen() - lost <= MOST_STOLEN * took else disturbed).append(took)
    return min(undisturbed or disturbed)


def _seconds(job: Job, clock: Callable[[], float]) -> float:
    begin = clock()
    job()
    return clock() - begin


def progress(items: Sequence[T], title: str) -> Iterable[T]:
    """Iterate over `items` with a progress bar on standard error, if that is a terminal."""
    console = Console(stderr=True)
    return track(items, title, console=console, transient=True, disable=not console.is_terminal)
