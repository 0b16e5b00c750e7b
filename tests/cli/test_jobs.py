"""How many processes and threads the commands start."""

from __future__ import annotations

import pytest

from rsdeblur.cli import _jobs


@pytest.mark.parametrize(
    ("jobs", "threads", "tasks", "gib", "expected"),
    [
        (None, None, None, 64, (4, 2)),
        (None, None, 100, 64, (8, 1)),
        (None, None, 3, 64, (3, 2)),
        (None, None, 100, 5, (2, 4)),
        (None, None, 100, 1, (1, 8)),
        (None, 4, 100, 64, (2, 4)),
        (5, None, 100, 64, (5, 1)),
        (5, 3, 1, 64, (5, 3)),
    ],
)
def test_all_cores_are_used_unless_tasks_or_memory_are_few(monkeypatch, jobs, threads, tasks, gib, expected):
    """On a machine of 8 cores; what the user sets is kept."""
    monkeypatch.setattr("rsdeblur._util.threads.thread_count", lambda count: count or 8)
    monkeypatch.setattr(_jobs, "_memory", lambda: gib * 2**30)
    assert _jobs.shared_threads(jobs, threads, tasks=tasks) == expected
