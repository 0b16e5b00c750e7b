"""Worker processes of commands, and the number of threads in each."""

from __future__ import annotations

import os
from dataclasses import dataclass

import click

from rsdeblur.cli._options import Decorator, gathered

# Default number of threads in a process. With many, most would wait while the process reads or writes a file. Memory of
# the machine for each process with fewer threads, bytes.
THREADS, PROCESS_MEMORY = 2, 2**31


@dataclass(frozen=True, slots=True)
class Workers:
    """Workers of a batch: processes of this machine, or a Dask cluster."""

    jobs: int | None
    scheduler: str | None


def _memory() -> int:
    """Return the bytes of memory of this machine, or 8 GiB where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 * 2**30


def jobs_option(what: str, default: str) -> Decorator:
    """Return the option of the number of processes or frames, with a description of its default."""
    return click.option(
        "--jobs",
        type=click.IntRange(min=1),
        metavar="N",
        help=f"Number of {what}; --threads applies to each of them.  [default: {default}]",
    )


workers_options = gathered(
    "workers",
    Workers,
    (
        jobs_option("processes", "half the number of cores"),
        click.option(
            "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the work; they need the same files."
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
