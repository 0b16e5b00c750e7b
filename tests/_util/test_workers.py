"""Worker processes: every task is answered, a fault stays with its task, and nothing is left behind."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import closing

import pytest

from rsdeblur._util import workers
from rsdeblur._util.workers import Failure, Limits
from rsdeblur.errors import InputError
from tests.installed import needs

# The work is `eval`: a fresh process can import it, and the tasks are expressions.
DIE = "__import__('os').kill(__import__('os').getpid(), 9)"


def answers(tasks, **options):
    with closing(workers.run(eval, tasks, **options)) as done:
        return dict(done)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_is_answered_once(jobs):
    tasks = [f"{i} * {i}" for i in range(9)]
    assert answers(tasks, jobs=jobs) == {task: eval(task) for task in tasks}


def test_a_fault_stays_with_its_task():
    results = answers(["1 / 0", "2", "open('/nowhere/x')", "int('a\\n  b')"])
    assert results["2"] == 2
    assert results["1 / 0"] == Failure("ZeroDivisionError: division by zero")
    assert "/nowhere/x" in results["open('/nowhere/x')"].message
    assert "\n" not in results["int('a\\n  b')"].message


def test_a_killed_worker_is_replaced_and_its_task_tried_once_more(tmp_path):
    # The first task dies only once: it leaves a file and finds it the second time.
    once = f"(__import__('pathlib').Path('{tmp_path}/x').exists() and 7) or (open('{tmp_path}/x', 'w').close(), {DIE})"
    lost = []
    results = answers([once, DIE, "3"], lost=lost.append)
    assert results[once] == 7
    assert results["3"] == 3
    assert results[DIE].died
    assert "killed by signal 9" in results[DIE].message
    assert sorted(lost) == sorted([once, DIE, DIE])


def test_isolated_tasks_have_their_own_process_and_limits():
    pids = ["__import__('os').getpid()", "__import__('os').getpid() + 0"]
    greedy, endless = "len(bytes(2**32))", "__import__('time').sleep(60)"
    lost = []
    tasks = [*pids, greedy, endless, "7"]
    results = answers(tasks, jobs=2, limits=Limits(2**31, 3.0), lost=lost.append)
    assert len({os.getpid(), *(results[task] for task in pids)}) == 3
    assert results[greedy] == Failure("not enough memory")
    assert results[endless] == Failure("it took more than 3 s, the time limit", died=True)
    assert results["7"] == 7
    # A task that takes too long is not tried again.
    assert lost == [endless]


def test_tasks_are_taken_as_workers_get_free():
    taken = []

    def tasks():
        for i in range(6):
            taken.append(i)
            yield str(i)

    with closing(workers.run(eval, tasks(), jobs=2)) as done:
        for answered, _ in enumerate(done, start=1):
            assert len(taken) <= answered + 2


def test_closing_interrupts_the_tasks_under_way(tmp_path):
    # The task cleans up after an interrupt, as atomic writing does.
    begun, mark = tmp_path / "begun", tmp_path / "tidy"
    # Short sleeps: an interrupt that comes just before a long one waits for its end.
    rest = "while True:\n  time.sleep(0.01)"
    code = f"import os, time\ntry:\n os.mkdir({str(begun)!r})\n {rest}\nfinally:\n os.mkdir({str(mark)!r})"
    task = f"exec({code!r})"
    done = workers.run(eval, [task, "1"], jobs=2)
    next(done)
    while not begun.exists():
        pass
    done.close()
    assert mark.exists()


def test_an_unread_answer_prints_nothing(tmp_path, capfd):
    mark = tmp_path / "mark"
    done = workers.run(eval, ["1", f"open({str(mark)!r}, 'w').close()"], jobs=2)
    next(done)
    while not mark.exists():
        pass
    # The second answer is on its way, or in the pipe.
    time.sleep(0.2)
    done.close()
    assert capfd.readouterr().err == ""


def test_interrupt_of_the_parent(tmp_path):
    begun = tmp_path / "begun"
    task = f"(open({str(begun)!r}, 'w').close(), __import__('time').sleep(60))"

    def press():
        while not begun.exists():
            pass
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()
    with pytest.raises(KeyboardInterrupt):
        answers([task])


def test_refusals():
    with pytest.raises(InputError, match="jobs"):
        answers(["1"], jobs=0)


def test_a_cluster_does_the_same(tmp_path):
    distributed = needs("dask")
    with distributed.LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        results = answers(["1 / 0", *map(str, range(9))], scheduler=cluster.scheduler_address)
    assert results.pop("1 / 0") == Failure("ZeroDivisionError: division by zero")
    assert results == {str(i): i for i in range(9)}
