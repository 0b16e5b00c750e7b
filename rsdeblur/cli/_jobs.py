"""Worker processes of commands, and the number of threads in each."""

from __future__ import annotations

from dataclasses import dataclass

import click

from rsdeblur.cli._options import gathered

# Default number of threads in a process. With many, most would wait while the process reads or writes a file.
THREADS = 2


@dataclass(frozen=True, slots=True)
class Workers:
    """Workers of a batch: processes of this machine, or a Dask cluster."""

    jobs: int | None
    scheduler: str | None


jobs_option = click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of processes; --threads applies to each of them.  [default: half the number of cores]",
)


workers_options = gathered(
    "workers",
    Workers,
    (
        jobs_option,
        click.option(
            "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the work; they need the same files."
        ),
    ),
)


def shared_threads(jobs: int | None, threads: int | None, *, alone: bool = True) -> tuple[int, int]:
    """Return the number of processes and of threads in each: as given, else so that they use all cores.

    Workers of a cluster are not `alone` on their machine; they use one thread each unless `threads` is given.
    """
    from rsdeblur._util.threads import thread_count

    if not alone:
        return jobs or 1, threads or 1
    cores = thread_count(None)
    jobs = jobs or max(1, cores // (threads or THREADS))
    return jobs, threads or max(1, cores // jobs)
