"""Threads that share tasks, in forked processes too: a team that a solver keeps, or one for a single call."""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Generic, TypeVar
from weakref import WeakSet

from rsdeblur._util import validate
from rsdeblur.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")


def thread_count(threads: int | None) -> int:
    """Return `threads`, from 1 to 1024, or the number of processors that this process may use if it is None."""
    if threads is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return validate.count("threads", threads, maximum=1024)  # more than processors


class ThreadTeam:
    """The threads of a solver, of which the calling thread is one; the solver's buffers hold one picture at a time."""

    lock: AbstractContextManager[Any]  # re-entrant; a thread holds it while the buffers belong to its picture

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.renew()
        _all_teams.add(self)

    def renew(self) -> None:
        """Replace the lock and the threads by new ones, all of them idle."""
        self.lock = threading.RLock()
        self._taken = False
        self._pool = _pool(self.threads) if self.threads > 1 else None

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Hold the lock while a picture is solved; refuse a thread that is solving one, which needs its buffers."""
        with self.lock:
            if self._taken:
                raise InputError(
                    "the solver is at work on a picture: its progress function or denoiser must not use it; "
                    "make another solver for that"
                )
            try:
                self._taken = True
                yield
            finally:
                self._taken = False

    def share(self, work: Callable[[int, int], None], tasks: Sequence[int]) -> None:
        """Call `work(thread, task)` for every task; threads have numbers from 0, the calling one, fewer than tasks."""
        _share(self._pool, self.threads, work, tasks)


def share(work: Callable[[int, int], None], tasks: Sequence[int], threads: int | None) -> None:
    """Call `work(thread, task)` for every task, in any order, by threads that end with the call."""
    threads = min(thread_count(threads), len(tasks))
    with _pool(threads) if threads > 1 else nullcontext() as pool:
        _share(pool, threads, work, tasks)


def share_map(function: Callable[[Item], Result], items: Sequence[Item], threads: int | None) -> list[Result]:
    """Return what `function` returns for every item, computed by threads as in :func:`share`."""
    results: list[Any] = [None] * len(items)

    def work(_: int, n: int) -> None:
        results[n] = function(items[n])

    share(work, range(len(items)), threads)
    return results


@contextmanager
def beside(function: Callable[[], Result], threads: int | None) -> Iterator[Callable[[], Result]]:
    """Let another thread, if allowed, call `function` beside the body, which gets a function for the result."""
    if thread_count(threads) == 1:
        yield function
        return
    with _pool(2) as pool:
        yield pool.submit(function).result


def share_range(work: Callable[[int, int], None], count: int, threads: int | None) -> None:
    """Call `work(first, stop)` for parts of `range(count)` that cover it, shared by threads as in :func:`share`.

    Numba's own parallel loops cannot replace it: they end the process that runs one after a fork and, depending on
    Numba's threading layer, a process that runs two at once.
    """
    # Four parts for each thread: some take longer than others.
    size = max(1, -(-count // (4 * thread_count(threads))))
    share(lambda _, first: work(first, min(first + size, count)), range(0, count, size), threads)


def share_blocks(
    work: Callable[[int, slice, slice], None], shape: tuple[int, int], block: tuple[int, int], threads: int | None
) -> None:
    """Call `work(thread, rows, columns)` for blocks of a picture, both of a height and width in px, by threads."""
    (height, width), (tall, wide) = shape, block
    corners = [(top, left) for top in range(0, height, tall) for left in range(0, width, wide)]

    def at(thread: int, n: int) -> None:
        top, left = corners[n]
        work(thread, slice(top, min(top + tall, height)), slice(left, min(left + wide, width)))

    share(at, range(len(corners)), threads)


def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads - 1, thread_name_prefix="rsdeblur")


def _share(
    pool: ThreadPoolExecutor | None, threads: int, work: Callable[[int, int], None], tasks: Sequence[int]
) -> None:
    left, lock = iter(tasks), threading.Lock()
    runs: list[Future[None]] = []

    def run(thread: int) -> None:
        while True:
            with lock:
                task = next(left, None)
            if task is None:
                return
            work(thread, task)

    try:
        if pool is not None:
            runs.extend(pool.submit(run, thread) for thread in range(1, min(threads, len(tasks))))
        # The calling thread works, too: it need not wait until another one has started.
        run(0)
        for each in runs:
            each.result()
    finally:
        # After a failure or an interrupt, no thread may keep writing to buffers that the next call uses.
        with lock:
            deque(left, maxlen=0)
        wait(runs)


_all_teams: WeakSet[ThreadTeam] = WeakSet()


def _renew_all() -> None:
    for team in _all_teams:
        team.renew()


# A forked process has only the thread that forked, and locks in the state that other threads left them in.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)


class once(Generic[Result]):
    """Property whose value is computed at its first use and kept, in the object's dictionary.

    It takes no lock, unlike `functools.cached_property` of Python 3.11, whose lock is one for all objects of a class.
    """

    def __init__(self, compute: Callable[[Any], Result]) -> None:
        self._compute, self.__doc__ = compute, compute.__doc__

    def __get__(self, thing: Any, _: type) -> Result:
        value: Result = vars(thing).setdefault(self._compute.__name__, self._compute(thing))
        return value
