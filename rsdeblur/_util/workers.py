"""Many tasks in worker processes, through `concurrent.futures`.

A task that fails does not stop the others, nor does one whose process dies.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

from rsdeblur._util import memory
from rsdeblur.errors import RsdeblurError

Task = TypeVar("Task")
Answer = TypeVar("Answer")

DIED = "its process died, twice (out of memory, perhaps)"


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a task failed, in one line."""

    message: str


def run(
    work: Callable[[Task], Answer],  # a function of a module, as it is sent to the workers
    tasks: Iterable[Task],  # read as workers become free
    *,
    jobs: int = 1,
    lost: Callable[[Task], None] | None = None,  # removes what a task left whose process has died
) -> Generator[tuple[Task, Answer | Failure], None, None]:
    """Do `work` on every task and yield each with its answer, in the order in which they finish.

    To stop early, close the iterator (`contextlib.closing`): it ends the workers at once.
    """
    waiting, lost = iter(tasks), lost or (lambda task: None)
    while died := (yield from _answers(jobs, work, waiting, lost)):
        # Nobody knows whose process died first: each is tried once more, alone.
        for task in died:
            for again in (yield from _answers(1, work, iter([task]), lost)):
                yield again, Failure(DIED)


def _answers(
    jobs: int,
    work: Callable[[Task], Answer],
    waiting: Iterator[Task],
    lost: Callable[[Task], None],
) -> Generator[tuple[Task, Answer | Failure], None, list[Task]]:
    """Yield answers until there are no more tasks, or a process dies; then return the tasks without an answer."""
    running, died = dict[Future[Any], Task](), list[Task]()
    try:
        with _processes(jobs) as pool:
            while True:
                for task in islice(waiting, 0 if died else jobs - len(running)):
                    try:
                        with _blocked_signals():
                            running[pool.submit(attempt, work, task)] = task
                    except BrokenExecutor:  # a process died between two tasks
                        died.append(task)
                        break
                if not running:
                    return died
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task = running.pop(future)
                    # `attempt` catches what `work` raises.
                    if future.exception() is None:
                        yield task, future.result()
                    else:
                        died.append(task)
    finally:
        # Their processes have ended.
        for task in (*running.values(), *died):
            lost(task)


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    # Forking a process whose libraries have threads is not safe.
    pool = ProcessPoolExecutor(jobs, get_context("spawn"), _begin)
    try:
        yield pool
    except BaseException:
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """Prepare a worker: it uses its memory again, and ends when its parent is killed."""
    memory.keep()
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    Thread(target=follow, daemon=True).start()


@contextmanager
def _blocked_signals() -> Iterator[None]:
    """Start no process that Ctrl-C or a closed terminal would end with a traceback: the parent ends its workers."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def attempt(work: Callable[[Task], Answer], task: Task) -> Answer | Failure:
    """Return the answer to a task, or why it failed."""
    try:
        return work(task)
    except (RsdeblurError, OSError) as error:
        text = str(error)
    except MemoryError:
        text = "not enough memory"
    except Exception as error:  # one task's bug must not stop the others
        text = f"{type(error).__name__}: {error}"
    return Failure(" ".join(text.split()))
