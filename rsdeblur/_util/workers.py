"""Many tasks in worker processes; one that fails, or whose process dies, does not stop the others."""

import os
import signal
import sys
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from itertools import islice
from multiprocessing import active_children, get_context, parent_process
from threading import Thread
from typing import Any, TypeVar

from rsdeblur._util import memory
from rsdeblur.errors import RsdeblurError

Task = TypeVar("Task")
Answer = TypeVar("Answer")

DIED = "its process died; if the memory is too small, use fewer --jobs or --max-memory"


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a task failed, in one line."""

    message: str


def run(
    work: Callable[[Task], Answer],  # a function of a module, as it is sent to the workers
    tasks: Iterable[Task],  # read as workers become free
    *,
    jobs: int = 1,
) -> Generator[tuple[Task, Answer | Failure], None, None]:
    """Do `work` on every task and yield each with its answer, in the order in which they finish.

    To stop early, close the iterator (`contextlib.closing`): it ends the workers at once.
    """
    waiting, running = iter(tasks), dict[Future[Any], tuple[Task, Executor]]()
    # Each worker has a pool of its own, so that one that dies takes no other task with it.
    idle = [_worker() for _ in range(jobs)]
    try:
        while True:
            for task in islice(waiting, len(idle)):
                worker = idle.pop()
                running[_submit(worker, work, task)] = task, worker
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, worker = running.pop(future)
                # `attempt` catches what `work` raises.
                has_died = future.exception() is not None
                idle.append(_worker() if has_died else worker)
                yield task, Failure(DIED) if has_died else future.result()
    except BaseException:
        for process in active_children():
            process.terminate()
        raise
    finally:
        for worker in [*idle, *(worker for _, worker in running.values())]:
            worker.shutdown(cancel_futures=True)


def _worker() -> Executor:
    # Forking a process whose libraries have threads is not safe.
    return ProcessPoolExecutor(1, get_context("spawn"), _begin)


def _submit(worker: Executor, work: Callable[[Task], Answer], task: Task) -> Future[Any]:
    try:
        return worker.submit(attempt, work, task)
    except BrokenExecutor as error:  # it died between two tasks
        failed: Future[Any] = Future()
        failed.set_exception(error)
        return failed


def _begin() -> None:
    """Prepare a worker: it uses its memory again, and is ended by its parent or with it, not by Ctrl-C."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # removes an unfinished file
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    memory.keep()
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    Thread(target=follow, daemon=True).start()


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
