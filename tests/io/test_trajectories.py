"""Poses of other programs: every layout gives the same trajectory, faults name the line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsdeblur import read_trajectory
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
