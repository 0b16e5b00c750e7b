"""Solvers in many threads and in forked and spawned processes give the bits of one thread, and never hang.

Short runs of `benchmarks.load`.
"""

from __future__ import annotations

import threading

import pytest

from benchmarks import load
from rsdeblur._util.threads import ThreadTeam

KINDS = load.solvers(threads=2)


@pytest.mark.parametrize("kind", KINDS)
def test_threads_that_share_a_solver_get_the_bits_of_one(kind: str) -> None:
    assert load.shared_by_threads(KINDS[kind], 3) == {"the same bits": 3 * load.THREADS}


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_get_the_same_bits(method: str) -> None:
    found = load.in_processes(method, 1)
    assert found == {"the same bits": len(KINDS) + 2, "exit 0": 1}


def test_after_a_failure_no_task_is_running() -> None:
    team, begun, done = ThreadTeam(3), threading.Event(), []

    def block(thread: int, task: int) -> None:
        if task == 0:
            begun.wait()
            raise ValueError("a task's fault")
        begun.set()
        threading.Event().wait(0.05)
        done.append(task)

    with pytest.raises(ValueError, match="a task's fault"):
        team.share(block, range(1000))
    finished = len(done)
    assert finished < 1000
    # Tasks that had begun are in the list by now, and no other task begins later.
    team.share(lambda thread, task: None, range(9))
    assert len(done) == finished
