"""How commands that work in several processes share the processors out."""

from __future__ import annotations

from dataclasses import dataclass

import click

from rsdeblur.cli._options import gathered

# Threads of a process where nothing else is asked for: reading and writing a file uses one.
THREADS = 2


@dataclass(frozen=True, slots=True)
class Workers:
    """Where a batch is worked on."""

    jobs: int | None
    scheduler: str | None


jobs_option = click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes; --threads counts for each of them.  [default: half as many as cores]",
)


workers_options = gathered(
    "workers",
    Workers,
    (
        jobs_option,
        click.option(
            "--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the work (they see the files)."
        ),
    ),
)


def shared_threads(jobs: int | None, threads: int | None, *, alone: bool = True) -> tuple[int, int]:
    """Return the number of processes and of threads in each, as given or sharing the cores out.

    Workers of a cluster, which are not `alone` on their machine, take one thread each if nothing is said.
    """
    from rsdeblur._util.threads import thread_count

    if not alone:
        return jobs or 1, threads or 1
    cores = thread_count(None)
    jobs = jobs or max(1, cores // (threads or THREADS))
    return jobs, threads or max(1, cores // jobs)
