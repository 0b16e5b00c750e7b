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

    def __truediv__(self, other: Times) -> float:
        """Return the ratio of the medians."""
        return self.median / other.median


def refuse_noise(load: float, times: Mapping[str, Times]) -> None:
    """Exit instead of publishing figures of a busy machine, or of repetitions that disagree.

    Parameters
    ----------
    load : float
        Average number of running processes before the measurement.
    times : mapping of str to Times
        What was measured, by the name to report.

    Raises
    ------
    SystemExit
        If the load exceeds :data:`benchmarks.machine.BUSY`, or a spread exceeds 15 %.
    """
    reasons = [f"the load was {load:.1f}, more than {machine.BUSY}"] if load > machine.BUSY else []
    wide = {name: each.spread for name, each in times.items() if each.spread > MOST_SPREAD}
    reasons += [f"{name}: the quartiles are {spread:.0%} of the median apart" for name, spread in wide.items()]
    if reasons:
        raise SystemExit("\n".join(["not published; measure again on an idle machine:", *reasons]))


def interleave(
    jobs: Mapping[Key, Job], rounds: int, *, clock: Callable[[], float] = time.perf_counter, seed: int = 0
) -> dict[Key, Times]:
    """Time all jobs, one call of each per round.

    Each round has a new random order, so that no job always runs with the caches and the clock rate that the same job
    left behind. A first round is not counted.

    Parameters
    ----------
    jobs : mapping to callable
    rounds : int
        Number of counted rounds, at least 1.
    clock : callable
        Returns the time in s.
    seed : int
        Seed of the random orders.

    Returns
    -------
    dict of Times
        In the order of `jobs`.
    """
    random = np.random.default_rng(seed)
    keys = list(jobs)
    seconds: dict[Key, list[float]] = {key: [] for key in keys}
    for _ in progress(range(rounds + 1), "measuring"):
        for i in random.permutation(len(keys)):
            begin = clock()
            jobs[keys[i]]()
            seconds[keys[i]].append(clock() - begin)
    return {key: Times.of(all_rounds[1:]) for key, all_rounds in seconds.items()}


def progress(items: Sequence[T], title: str) -> Iterable[T]:
    """Iterate over `items` with a progress bar on standard error, if that is a terminal."""
    console = Console(stderr=True)
    return track(items, title, console=console, transient=True, disable=not console.is_terminal)
