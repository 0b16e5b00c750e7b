"""Times and progress of the stages of a computation."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rsdeblur.types import Progress, StageProgress

LOG = logging.getLogger("rsdeblur")


class StageClock:
    """Times the stages of one computation, reports their progress, and logs them at the level DEBUG."""

    def __init__(self, progress: Progress | None = None) -> None:
        self.timings: dict[str, float] = {}  # s spent in each stage so far
        self._progress = progress

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body as a stage; the times of several bodies of one stage add up."""
        begin = time.perf_counter()
        if name not in self.timings:
            self._report(name, 0.0)
        yield
        seconds = time.perf_counter() - begin
        LOG.debug("stage %s: %.3f s", name, seconds)
        self.timings[name] = self.timings.get(name, 0.0) + seconds
        # The solver reports its own end.
        if name != "apply":
            self._report(name, 1.0)

    def within(self, name: str, part: int = 0, parts: int = 1) -> StageProgress:
        """Return a function that reports the progress of one of several parts of a stage."""
        return lambda fraction: self._report(name, (part + fraction) / parts)

    def _report(self, name: str, fraction: float) -> None:
        if self._progress is not None:
            self._progress(name, fraction)
