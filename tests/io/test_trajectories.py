"""Poses of other programs: every layout gives the same trajectory, faults name the line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsdeblur import FileFormatError, read_trajectory
from tests._util.files import EPOCH, RATES, TIMESTAMPS, TRAJECTORIES


@pytest.mark.parametrize("name", TRAJECTORIES)
def test_layouts(write: Callable[..., Path], name: str) -> None:
    trajectory = read_trajectory(write(TRAJECTORIES[name], "poses.txt"))
    assert trajectory.epoch_ns == EPOCH
    np.testing.assert_array_equal(trajectory.t, (TIMESTAMPS - EPOCH) * 1e-9)
    np.testing.assert_array_equal(trajectory.position, RATES)
    assert (trajectory.quaternion is None) == ("positions" in name)
    if trajectory.quaternion is not None:
        np.testing.assert_array_equal(trajectory.quaternion, [[0.0, 0.6, 0.0, 0.8]] * len(RATES))


FAULTS = {
    "0.5 1 2 3 4\n1 1 2 3 4\n": "line 1: unknown trajectory format",
    "0 1 2 3 0 0 0 0\n1 1 2 3 0 0 0 1\n": "quaternion 0 has the norm 0 instead of 1",
    "0 1 2 3 0 0 0 1\n1 1 x 3 0 0 0 1\n2 1 2 3 0 0 0 1\n": "line 2: 'x' in column 3",
    "0 1 2 3\n1 1 2 3\n1 1 2 4\n2 1 2 3\n": "line 3: duplicate timestamp",
    "0 1 2 3\n": "at least 2",
    "": "empty",
    "timestamp tx ty tz qx qy qz qw\n": "no samples",
}


@pytest.mark.parametrize(("text", "message"), FAULTS.items(), ids=FAULTS.values())
def test_faults(write: Callable[..., Path], text: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=rf"poses\.txt.*{message}"):
        read_trajectory(write(text, "poses.txt"))
