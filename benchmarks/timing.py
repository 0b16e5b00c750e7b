"""Times of alternatives, measured in turns so that disturbances of the machine affect all of them."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.progress import track

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

    def __truediv__(self, other: Times) -> float:
        """Return the ratio of the medians."""
        return self.median / other.median


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
