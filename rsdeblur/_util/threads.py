"""Threads that share blocks of work, in a forked process too, and the lock by which callers take turns."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager
from typing import Any
from weakref import WeakSet


class ThreadTeam:
    """A solver's threads.

    Parameters
    ----------
    threads : int
        How many share the work; a single one is the caller's own.

    Attributes
    ----------
    lock : context manager
        Held, as often as it likes, by the thread whose picture the solver's buffers belong to.
    """

    lock: AbstractContextManager[Any]

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.renew()
        _teams.add(self)

    def renew(self) -> None:
        """Start anew, with nobody at work."""
        self.lock = threading.RLock()
        self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="rsdeblur") if self.threads > 1 else None

    def share(self, block: Callable[[int, int], None], tasks: Iterable[int]) -> None:
        """Run `block(thread, task)` on every task, each thread taking the next one that is left."""
        if self._pool is None:
            for task in tasks:
                block(0, task)
            return
        left, lock = iter(tasks), threading.Lock()

        def work(thread: int) -> None:
            while True:
                with lock:
                    task = next(left, None)
                if task is None:
                    return
                block(thread, task)

        shares = [self._pool.submit(work, thread) for thread in range(self.threads)]
        try:
            for share in shares:
                share.result()
        finally:
            # After a failure or an interrupt nobody may go on in buffers that the next call uses.
            with lock:
                deque(left, maxlen=0)
            wait(shares)


_teams: WeakSet[ThreadTeam] = WeakSet()


def _renew_all() -> None:
    for team in _teams:
        team.renew()


# A forked process has the caller's thread alone, and the locks as the others left them.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
