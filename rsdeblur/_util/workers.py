"""Many tasks in worker processes, or on a Dask cluster.

A task that fails does not stop the others. A task whose process dies is tried once more. `work` and the tasks are sent
to the processes, so `work` must be a function of a module, and tasks and answers must pickle.
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from multiprocessing import connection, get_context
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from rsdeblur._util import interrupts, memory, validate
from rsdeblur._util.extras import missing
from rsdeblur.errors import InputError, RsdeblurError

Task = TypeVar("Task")
Answer = TypeVar("Answer")

ATTEMPTS = 2
# Time for an interrupted worker to remove its unfinished files (s).
PATIENCE = 10.0
# Tasks that wait at a cluster, per thread of it.
AHEAD = 2
# s until a scheduler must answer.
CONNECT = 5.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a task that has a process of its own.

    Parameters
    ----------
    memory : int
        Most bytes of address space, libraries included; not enforced on Windows.
    seconds : float
        Most time in s, the start of the process included.
    """

    memory: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Failure:
    """A task that failed.

    Parameters
    ----------
    message : str
        One line.
    died : bool
        Whether the process was killed or crashed, so that temporary files may be left.
    """

    message: str
    died: bool = False


def run(
    work: Callable[[Task], Answer],
    tasks: Iterable[Task],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    lost: Callable[[Task], None] | None = None,
    announce: Callable[[str], None] | None = None,
    limits: Limits | None = None,
) -> Generator[tuple[Task, Answer | Failure], None, None]:
    """Do `work` on every task and yield each with its answer, in the order in which they finish.

    To stop early, close the iterator (`contextlib.closing`): it interrupts the tasks under way.

    Parameters
    ----------
    work : callable
        Takes a task and returns its answer.
    tasks : iterable
        Read as workers become free.
    jobs : int, default 1
        Number of worker processes; the calling process does no work.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers take the place of the processes; they must see the same files.
    lost : callable, optional
        Called with a task whose process died, before the next attempt: to remove what the process left.
    announce : callable, optional
        Called with a line about the workers of the cluster.
    limits : Limits, optional
        Gives each task a process of its own, which ends with it, and these limits; not for a cluster. A task that takes
        too long is not tried again.

    Raises
    ------
    InputError
        If `jobs` is out of range, no scheduler answers, or the extra ``[dask]`` is not installed.
    """
    jobs = validate.count("jobs", jobs)
    lost = lost or (lambda task: None)
    if scheduler is None:
        yield from _in_processes(work, tasks, lost, jobs, limits)
    else:
        yield from _on_cluster(work, tasks, lost, scheduler, announce or (lambda line: None))


def _in_processes(
    work: Callable[[Task], Answer],
    tasks: Iterable[Task],
    lost: Callable[[Task], None],
    jobs: int,
    limits: Limits | None,
) -> Iterator[tuple[Task, Answer | Failure]]:
    waiting, workers, idle = iter(tasks), list[_Worker](), list[_Worker]()
    busy: dict[Connection, tuple[_Worker, Task, int]] = {}

    def begin(task: Task, attempt: int) -> None:
        if not idle:
            # A process that no list names would not be ended.
            with interrupts.Postponed():
                workers.append(_Worker(work, limits))
            idle.append(workers[-1])
        worker = idle.pop()
        busy[worker.pipe] = worker, task, attempt
        worker.send(task)

    def end(worker: _Worker) -> None:
        worker.pipe.close()
        worker.end()
        workers.remove(worker)

    try:
        while True:
            for task in islice(waiting, jobs - len(busy)):
                begin(task, 1)
            if not busy:
                return
            deadline = min(worker.deadline for worker, _, _ in busy.values())
            ready = connection.wait(list(busy), max(0.0, deadline - time.monotonic()) if limits else None)
            for pipe in busy.keys() - set(ready):
                busy[pipe][0].kill_if_late()
            for pipe in [pipe for pipe in busy if pipe in ready]:
                worker, task, attempt = busy.pop(pipe)
                answer = worker.answer()
                if isinstance(answer, Failure) and answer.died:
                    end(worker)
                    lost(task)
                    if attempt < ATTEMPTS and not worker.late:
                        begin(task, attempt + 1)
                        continue
                elif limits:
                    end(worker)
                else:
                    idle.append(worker)
                yield task, answer
    finally:
        # A second interrupt must not stop the cleanup after the first.
        with interrupts.ignored():
            for worker in workers:
                worker.interrupt()
            for worker in workers:
                worker.end()


class _Worker:
    """A process that takes tasks through a pipe, one at a time."""

    def __init__(self, work: Callable[[Any], Any], limits: Limits | None) -> None:
        self._limits, self.deadline, self.late = limits, math.inf, False
        # Forking a process whose libraries have threads is not safe.
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, work, limits), daemon=True)
        with interrupts.ignored():
            self._process.start()
        # Only the worker keeps that end open, so the pipe breaks when it dies.
        theirs.close()

    def send(self, task: Any) -> None:
        if self._limits:
            self.deadline = time.monotonic() + self._limits.seconds
        # `answer` reports a worker that has died.
        with suppress(BrokenPipeError):
            self.pipe.send(task)

    def kill_if_late(self) -> None:
        """Kill the worker if its task takes longer than the limit, which breaks the pipe."""
        self.late = time.monotonic() >= self.deadline
        if self.late:
            self._process.kill()

    def answer(self) -> Any:
        try:
            return self.pipe.recv()
        except (EOFError, ConnectionResetError):
            self._process.join()
            if self._limits and self.late:
                return Failure(f"it took more than {self._limits.seconds:g} s, the time limit", died=True)
            code = self._process.exitcode or 0
            cause = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
            return Failure(f"its process {cause} (out of memory, perhaps), {ATTEMPTS} times", died=True)

    def interrupt(self) -> None:
        """Ask the worker to leave its task; on Windows this ends the process."""
        if self._process.is_alive() and self._process.pid is not None:
            os.kill(self._process.pid, signal.SIGINT)
        self.pipe.close()

    def end(self) -> None:
        self._process.join(PATIENCE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _serve(pipe: Connection, work: Callable[[Any], Any], limits: Limits | None) -> None:
    """Do tasks until the pipe closes or an interrupt arrives during one; the next one gets the memory of the last."""
    if limits:
        _limit_memory(limits.memory)
    # An idle worker has nothing to clean up. When the parent exits, Python ends its workers with SIGTERM, and waits for
    # them: also for one that was started just before an interrupt.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # A closed pipe raises EOFError, and ConnectionError if the parent left an answer unread.
    with memory.kept(), suppress(EOFError, ConnectionError, KeyboardInterrupt):
        while True:
            task = pipe.recv()
            # The terminal and the parent both send one; the second must not stop the cleanup after the first.
            for number in interrupts.ENDING:
                signal.signal(number, interrupts.interrupt_once)
            # No task comes before the answer to the last one, so the pipe is closed: the interrupt came too early.
            if pipe.poll():
                return
            answer = _attempt(work, task)
            for number in interrupts.ENDING:
                signal.signal(number, signal.SIG_IGN)
            pipe.send(answer)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _limit_memory(size: int) -> None:
    with suppress(ImportError):  # Windows
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        size = size if hard == resource.RLIM_INFINITY else min(size, hard)
        resource.setrlimit(resource.RLIMIT_AS, (size, hard))
        # A crash is expected, and its memory may be large.
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _attempt(work: Callable[[Any], Any], task: Any) -> Any:
    try:
        return work(task)
    except (RsdeblurError, OSError) as error:
        return Failure(_one_line(error))
    except MemoryError:
        return Failure("not enough memory")
    except Exception as error:  # one task's bug must not stop the others
        return Failure(f"{type(error).__name__}: {_one_line(error)}")


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _on_cluster(
    work: Callable[[Task], Answer],
    tasks: Iterable[Task],
    lost: Callable[[Task], None],
    address: str,
    announce: Callable[[str], None],
) -> Iterator[tuple[Task, Answer | Failure]]:
    try:
        from distributed import Client, Future, as_completed
    except ImportError as error:
        raise InputError(missing("a Dask scheduler needs distributed", "dask")) from error
    try:
        client = Client(address, timeout=CONNECT)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # TypeError: TLS without certificates
        raise InputError(f"no Dask scheduler answers at {address}: {_one_line(error)}") from error
    waiting, sent = iter(tasks), dict[Future, Task]()

    def send(count: int) -> list[Future]:
        new = {client.submit(_attempt, work, task, pure=False): task for task in islice(waiting, count)}
        sent.update(new)
        return list(new)

    with client:
        cores = client.ncores()
        # Without workers the batch waits until one joins.
        threads = sum(cores.values())
        announce(f"{address}: {len(cores)} workers with {threads} threads; dashboard {client.dashboard_link}")
        try:
            done = as_completed(send(AHEAD * max(1, threads)))
            for future in done:
                task = sent.pop(future)
                # `_attempt` catches what `work` raises, so a future fails only if its worker died several times.
                died = future.status != "finished"
                answer = Failure("its worker died, several times", died=True) if died else future.result()
                if died:
                    lost(task)
                for more in send(1):
                    done.add(more)
                yield task, answer
        finally:
            client.cancel(list(sent))
