"""Worker processes: every task is answered, a fault stays with its task, and nothing is left behind."""

import os
import signal
import threading
from contextlib import closing
from multiprocessing import active_children

import pytest

from rsdeblur._util import workers
from rsdeblur._util.workers import Failure

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


def test_a_process_that_dies_costs_no_other_task(tmp_path):
    # The first task dies only once: it leaves a file and finds it the second time.
    once = f"(__import__('pathlib').Path('{tmp_path}/x').exists() and 7) or (open('{tmp_path}/x', 'w').close(), {DIE})"
    lost, others = [], ["3", "__import__('time').sleep(0.1)", "4", "5"]
    results = answers([once, "2", DIE, *others], jobs=2, lost=lost.append)
    assert results == {once: 7, "2": 2, DIE: Failure(workers.DIED), "3": 3, others[1]: None, "4": 4, "5": 5}
    assert lost.count(DIE) == 2
    assert once in lost


def test_tasks_are_taken_as_workers_get_free():
    taken = []

    def tasks():
        for i in range(6):
            taken.append(i)
            yield str(i)

    with closing(workers.run(eval, tasks(), jobs=2)) as done:
        for answered, _ in enumerate(done, start=1):
            assert len(taken) <= answered + 2


def test_an_interrupt_ends_the_workers_and_tells_what_they_were_doing(tmp_path, capfd):
    begun, lost = tmp_path / "begun", []
    task = f"(open({str(begun)!r}, 'w').close(), __import__('time').sleep(60))"

    def press():
        while not begun.exists():
            pass
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()
    with pytest.raises(KeyboardInterrupt):
        answers([task], lost=lost.append)
    assert lost == [task]
    assert not active_children()
    assert capfd.readouterr().err == ""
