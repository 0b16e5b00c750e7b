"""Solvers in many threads and in forked and spawned processes give the bits of one thread and never hang.

Short runs of `benchmarks.load`.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba.core.compiler_lock import global_compiler_lock

from benchmarks import load
from rsdeblur import (
    BlurPaths,
    Capture,
    Deconvolver,
    DerivativePrior,
    InputError,
    PlugAndPlayPrior,
    RowDeconvolver,
    TileQuadratic,
    plan,
    psfs,
)
from rsdeblur._util.threads import ThreadTeam
from rsdeblur.deconv import fft
from rsdeblur.io import pictures

KINDS = load.solvers(threads=2)
RECORDING, PICTURE = load._recording(), np.full((load.HEIGHT, load.WIDTH, 3), 0.5, np.float32)

forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
# Of Python 3.12, about what is tested here.
many_threads = pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")


@pytest.mark.parametrize("kind", KINDS)
def test_threads_that_share_a_solver_get_the_bits_of_one(kind: str) -> None:
    assert load.shared_by_threads(KINDS[kind], 3) == {"the same bits": 3 * load.THREADS}


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_other_processes_get_the_same_bits(method: str) -> None:
    counts = load.in_processes(method, 1)
    assert counts == {"the same bits": len(KINDS) + 2, "exit 0": 1}


def in_a_fork(work: Callable[[], Any]) -> int:
    """Return the exit status of a forked process that works for at most 10 s."""
    child = os.fork()
    if child == 0:
        signal.alarm(10)
        work()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@forks
@many_threads
def test_a_plan_works_in_a_process_forked_while_a_thread_uses_it() -> None:
    prepared = plan(*RECORDING).prepare(PICTURE)
    begun, done = threading.Event(), threading.Event()

    def wait(stage: str, fraction: float) -> None:
        if stage == "apply":
            begun.set()
            done.wait(20)

    other = threading.Thread(target=lambda: prepared.apply(PICTURE, progress=wait))
    other.start()
    assert begun.wait(20)
    status = in_a_fork(lambda: prepared.apply(PICTURE))
    done.set()
    other.join()
    assert status == 0


@forks
@many_threads
@pytest.mark.parametrize("lock", [fft._planner, pictures._limit_lock, global_compiler_lock])
def test_a_fork_waits_for_what_a_process_has_once(lock: Any) -> None:
    begun, held = threading.Event(), threading.Event()

    def hold() -> None:
        with lock:
            begun.set()
            held.wait(0.2)

    other = threading.Thread(target=hold)
    other.start()
    begun.wait(20)
    assert in_a_fork(lock.acquire) == 0
    other.join()


def test_a_function_that_a_solver_calls_may_not_use_it() -> None:
    """It would spoil the solver's buffers, or wait for itself."""
    bank, prior = psfs(*RECORDING, bands=2, strips=1), DerivativePrior("tv", 1e-3)
    tiles = TileQuadratic(bank, PICTURE.shape)
    rows = RowDeconvolver(BlurPaths.every_row(Capture.from_log(*RECORDING), [20.0]), PICTURE.shape)
    wiener = Deconvolver(bank, PICTURE.shape)
    calls: list[Callable[[Callable[..., Any]], Any]] = [
        lambda again: tiles.apply(PICTURE, prior=prior, progress=again),
        lambda again: tiles.apply(PICTURE, prior=PlugAndPlayPrior(lambda image, sigma: again() or image, 0.01)),
        lambda again: rows.apply(PICTURE, progress=again),
        lambda again: wiener.apply(PICTURE, progress=again),
    ]
    for call in calls:
        with pytest.raises(InputError, match="the solver is at work on a picture"):
            call(lambda *_: call(lambda *_: None))  # noqa: B023
        call(lambda *_: None)  # The refusal leaves the solver as it was.
    with pytest.raises(InputError, match="the solver is at work on a picture"):
        wiener.apply(PICTURE, progress=lambda _: wiener.replan(bank))


def test_after_a_failure_no_thread_is_at_work() -> None:
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
    # Tasks under way at the failure have finished, and no later one starts.
    team.share(lambda thread, task: None, range(9))
    assert len(done) == finished
