"""Triage: path lengths of motions that are known, and the decisions that follow from them."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, triage

FOCAL = 400.0


def steady(rate: float) -> GyroLog:
    """Return a log of a camera that turns about its y axis at `rate` rad/s from 0 s to 1 s, and then rests."""
    t = np.arange(0.0, 2.0, 0.005)
    omega = np.zeros((len(t), 3))
    omega[t < 1.0, 1] = rate
    return GyroLog(t, omega)


@pytest.mark.parametrize("direction", ["top-down", "left-right"])
def test_paths_are_as_long_as_the_turn_times_the_focal_length(direction: str) -> None:
    camera = Camera(160, 120, FOCAL, readout_time=0.02, readout_direction=direction)
    durations = (0.001, 0.01, 0.1)
    exposures = [Exposure(0.2, duration) for duration in durations]
    exposures += [Exposure(1.2, 0.1), Exposure(5.0, 0.1)]
    rate = 1.0
    found = triage(steady(rate), camera, exposures, keep=1.5, drop=20.0)
    # The path at the edge is longer than at the centre by 1 + (80 / 400)^2, 4 %.
    np.testing.assert_allclose(found.lengths[:3], FOCAL * rate * np.array(durations), rtol=0.05)
    assert found.lengths[3] == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(found.lengths[4])
    assert found.decisions == ("keep", "deblur", "drop", "keep", "unknown")
    assert "does not cover" in found.reasons[4]
    assert found.counts == {"keep": 2, "deblur": 1, "drop": 1, "unknown": 1}
    assert not found.lengths.flags.writeable
