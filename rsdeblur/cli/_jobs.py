"""Worker processes of commands, and the number of threads in each."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from rsdeblur.cli._options import Decorator, gathered
from rsdeblur.cli._types import BytesType, SecondsType

if TYPE_CHECKING:
    from rsdeblur._util.workers import Limits

# Default number of threads in a process. With many, most would wait while the process reads or writes a file. Memory of
# the machine for each process with fewer threads, bytes.
THREADS, PROCESS_MEMORY = 2, 2**31

# Default limit of an isolated photo, s; the least limits, s and bytes, with which a process can load its libraries.
PHOTO_SECONDS = 900.0
LEAST_SECONDS, LEAST_MEMORY = 1.0, 2**30


@dataclass(frozen=True, slots=True)
class Workers:
    """Workers of a batch: processes of this machine, or a Dask cluster; and the limits of a process for one photo."""

    jobs: int | None
    scheduler: str | None
    isolate: bool
    memory_limit: int | None
    time_limit: float | None

    def limits(self, jobs: int) -> Limits | None:
        """Return the limits of each photo when `jobs` are deblurred at a time; None unless they are isolated.

        Raises
        ------
        click.UsageError
            If options contradict each other, or no photo can be deblurred within them.
        """
        if not self.isolate:
            if self.memory_limit is not None or self.time_limit is not None:
                raise click.UsageError("--memory-limit and --time-limit need --isolate")
            return None
        from rsdeblur._util.workers import Limits

        if self.scheduler is not None:
            raise click.UsageError("--isolate needs processes of this machine: leave out --scheduler")
        seconds = PHOTO_SECONDS if self.time_limit is None else self.time_limit
        if not LEAST_SECONDS <= seconds < float("inf"):
            raise click.UsageError(f"--time-limit must be at least {LEAST_SECONDS:g} s, got {seconds:g} s")
        memory = max(LEAST_MEMORY, _memory() // jobs) if self.memory_limit is None else self.memory_limit
        if memory < LEAST_MEMORY:
            raise click.UsageError(f"--memory-limit must be at least 1GiB, got {memory} bytes")
        return Limits(memory, seconds)


def _memory() -> int:
    """Return the bytes of memory of this machine, or 8 GiB where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 * 2**30


def jobs_option(default: str) -> Decorator:
    """Return the option of the number of processes, with a description of its default."""
    return click.option(
        "--jobs",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Number of processes; --threads applies to each of them.  [default: {default}]",
    )


workers_options = gathered(
    "workers",
    Workers,
    (
        jobs_option("half the number of cores"),
        click.option(
            "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the work; they need the same files."
        ),
        click.option(
            "--isolate",
            is_flag=True,
            help="Read and deblur each photo in a process of its own, which is killed beyond its limits.",
        ),
        click.option(
            "--memory-limit",
            type=BytesType(),
            metavar="SIZE",
            help="With --isolate: address space of each photo's process.  [default: the machine's memory / --jobs]",
        ),
        click.option(
            "--time-limit",
            type=SecondsType(),
            help=f"With --isolate: time for each photo.  [default: {PHOTO_SECONDS:g}]",
        ),
    ),
)


def shared_threads(
    jobs: int | None, threads: int | None, *, alone: bool = True, tasks: int | None = None
) -> tuple[int, int]:
    """Return the number of processes and of threads in each: as given, else so that they use all cores.

    Workers of a cluster are not `alone` on their machine; they use one thread each unless `threads` is given. For a
    known number of small `tasks` there are as many processes as there are cores, tasks and memory for.
    """
    from rsdeblur._util.threads import thread_count

    if not alone:
        return jobs or 1, threads or 1
    cores = thread_count(None)
    if tasks is not None:
        jobs = jobs or max(1, min(cores // (threads or 1), tasks, _memory() // PROCESS_MEMORY))
    jobs = jobs or max(1, cores // (threads or THREADS))
    return jobs, threads or max(1, cores // jobs)
