"""Time of the work on a photo, without the time in which Numba compiles."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.event import Event, TimingListener, install_listener

from rsdeblur.cli._output import level, say_aside


class Stopwatch(TimingListener):
    """Measurement of a block; see `stopwatch`. `seconds` is known after it."""

    def __init__(self, *, announces: bool) -> None:
        parent: Any = super()  # Numba has no types
        parent.__init__()
        self.seconds = 0.0
        self._announces = announces

    def on_start(self, event: Event) -> None:
        """Begin to count a compilation; before the first one, print that the command compiles."""
        if self._announces:
            say_aside("compiling, once after the installation; the printed time is without it")
            self._announces = False
        parent: Any = super()
        parent.on_start(event)


@contextmanager
def stopwatch() -> Iterator[Stopwatch]:
    """Measure the time of the block without compilation, which is reported on a terminal or if the command is verbose.

    Only the first run after the installation compiles. Numba compiles one function at a time, whatever the thread.
    """
    on_terminal = sys.stderr is not None and sys.stderr.isatty()
    watch = Stopwatch(announces=level() > 0 or (level() == 0 and on_terminal))
    begin = time.perf_counter()
    with install_listener("numba:compile", watch):
        yield watch
    watch.seconds = time.perf_counter() - begin - (watch.duration if watch.done else 0.0)
