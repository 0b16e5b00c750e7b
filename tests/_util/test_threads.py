"""Threads and worker processes share tasks: each task is done once, whatever fails; arrays are aligned for SIMD."""

import os
import signal
import threading
import time
from contextlib import closing
from multiprocessing import active_children

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, InputError, PsfBank, deblur, hand_shake
from rsdeblur._util import workers
from rsdeblur._util.memory import ALIGNMENT, empty
from rsdeblur._util.threads import ThreadTeam, beside, once, share, share_map
from rsdeblur._util.workers import Failure
from rsdeblur.motion import BlurPaths, Capture

ANYWHERE = pytest.mark.parametrize("threads", [1, 2, 7])


@pytest.fixture
def no_new_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(_: threading.Thread) -> None:
        raise AssertionError("a thread was started")

    monkeypatch.setattr(threading.Thread, "start", start)


@ANYWHERE
@pytest.mark.parametrize("count", [0, 1, 3, 100])
def test_every_task_is_done_once_by_a_numbered_thread(threads: int, count: int) -> None:
    def done_by(run) -> list[tuple[int, int]]:
        done: list[tuple[int, int]] = []
        run(lambda thread, task: done.append((task, thread)))
        return sorted(done)

    for run in (
        lambda work: share(work, range(count), threads),
        lambda work: ThreadTeam(threads).share(work, range(count)),
    ):
        done = done_by(run)
        assert [task for task, _ in done] == list(range(count))
        assert all(thread < min(threads, count) for _, thread in done)


def test_a_function_runs_beside_the_body() -> None:
    started = threading.Event()

    def start() -> int:
        started.set()
        return threading.get_ident()

    with beside(start, 2) as result:
        # The bound only ends a test that fails.
        assert started.wait(timeout=60)
        assert result() == result() != threading.get_ident()


@pytest.mark.usefixtures("no_new_threads")
def test_with_one_thread_a_function_runs_when_its_result_is_wanted() -> None:
    calls: list[int] = []
    with beside(lambda: calls.append(threading.get_ident()), 1) as result:
        assert not calls
        result()
    assert calls == [threading.get_ident()]


def test_an_error_beside_the_body_is_raised_where_the_result_is_wanted() -> None:
    def fail() -> None:
        raise InputError("beside")

    with beside(fail, 2) as result, pytest.raises(InputError, match="beside"):
        result()


def test_a_failure_reaches_the_caller() -> None:
    def fail(thread: int, task: int) -> None:
        raise ValueError(f"task {task} failed")

    for threads in (1, 3):
        with pytest.raises(ValueError, match=r"task \d failed"):
            share(fail, range(5), threads)


def test_an_interrupt_waits_for_the_tasks_of_other_threads_and_comes_before_the_rest() -> None:
    begun, ended, interrupted = set[int](), set[int](), threading.Event()

    def work(thread: int, task: int) -> None:
        if thread == 0:
            interrupted.set()
            signal.raise_signal(signal.SIGINT)
        begun.add(task)
        interrupted.wait()
        time.sleep(0.001)
        ended.add(task)

    with pytest.raises(KeyboardInterrupt):
        share(work, range(1000), 3)
    assert begun == ended
    assert len(ended) < 1000


@pytest.mark.parametrize("mode", ["global", "banded", "rowwise"])
@pytest.mark.parametrize("prior", ["wiener", "tv"])
def test_one_thread_is_the_callers(mode: str, prior: str, no_new_threads: None) -> None:
    capture = hand_shake(0.3, seed=1), Camera(64, 48, 60.0, readout_time=0.03), Exposure(0.1, 0.03)
    picture = np.random.default_rng(0).random((48, 64, 3), dtype=np.float32)
    picture[20:22, 30:33] = 1.0
    deblur(picture, *capture, mode=mode, prior=prior, saturation="always", threads=1)
    paths = BlurPaths.every_row(Capture.from_log(*capture), [20.0])
    PsfBank.from_paths(paths, threads=1)


@pytest.mark.parametrize("shape", [(), (3, 5), (700, 600)])
def test_arrays_are_aligned_and_writable(shape):
    for dtype in (np.float32, np.complex64, np.uint8):
        array = empty(shape, dtype)
        assert array.ctypes.data % ALIGNMENT == 0
        array[...] = 3
        assert (array.shape, array.dtype, array.flags.c_contiguous) == (shape, dtype, True)


# The work is `eval`: a fresh process can import it, and the tasks are expressions.
DIE = "__import__('os').kill(__import__('os').getpid(), 9)"


def answers(tasks, **options):
    with closing(workers.run(eval, tasks, **options)) as done:
        return dict(done)


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_fault_stays_with_its_task(jobs):
    tasks = [f"{i} * {i}" for i in range(9)]
    results = answers([*tasks, "1 / 0", "open('/nowhere/x')", "int('a\\n  b')"], jobs=jobs)
    assert {task: results[task] for task in tasks} == {task: eval(task) for task in tasks}
    assert results["1 / 0"] == Failure("ZeroDivisionError: division by zero")
    assert "/nowhere/x" in results["open('/nowhere/x')"].message
    assert "\n" not in results["int('a\\n  b')"].message


def test_a_process_that_dies_costs_no_other_task():
    others = ["3", "__import__('time').sleep(0.1)", "4", "5"]
    results = answers(["2", DIE, *others], jobs=2)
    assert results == {"2": 2, DIE: Failure(workers.DIED), "3": 3, others[1]: None, "4": 4, "5": 5}


def test_tasks_are_taken_as_workers_get_free():
    taken = []

    def tasks():
        for i in range(6):
            taken.append(i)
            yield str(i)

    with closing(workers.run(eval, tasks(), jobs=2)) as done:
        for answered, _ in enumerate(done, start=1):
            assert len(taken) <= answered + 2


def test_an_interrupt_ends_the_workers(tmp_path, capfd):
    begun = tmp_path / "begun"
    task = f"(open({str(begun)!r}, 'w').close(), __import__('time').sleep(60))"

    def press():
        while not begun.exists():
            pass
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()
    with pytest.raises(KeyboardInterrupt):
        answers([task])
    assert not active_children()
    assert capfd.readouterr().err == ""


def test_an_attribute_is_computed_once_without_a_lock() -> None:
    both = threading.Barrier(2, timeout=30)

    class Kept:
        @once
        def value(self) -> object:
            both.wait()  # breaks unless two objects are computed at the same time
            return object()

    objects = [Kept(), Kept()]
    first, second = share_map(lambda kept: kept.value, objects, 2)
    assert (first, second) == tuple(kept.value for kept in objects)
