"""The readout time follows from the bands of a lamp, in walls and scenes, and is refused without bands."""

import numpy as np
import pytest

from rsdeblur import InputError
from rsdeblur.calibration.flicker import measure_flicker

HEIGHT, WIDTH = 160, 128
EXPOSURE = 0.004


def photos(readout: float, count: int = 1, *, scene: float = 0.0, depth: float = 0.3, mains: float = 50.0) -> list:
    """Return pictures of a shaded wall with a pattern, lit by a lamp, as a rolling shutter sees it row by row."""
    rng = np.random.default_rng(0)
    wall = (
        0.4
        + 0.1 * np.linspace(-1, 1, HEIGHT)[:, None]
        + scene * rng.random((HEIGHT // 8, WIDTH // 8)).repeat(8, axis=0).repeat(8, axis=1)
    )
    opens = readout * np.arange(HEIGHT) / HEIGHT
    # The mean of the lamp over a row's exposure, by sums instead of the formula.
    times = opens[:, None] + np.linspace(0, EXPOSURE, 50)
    shots = []
    for phase in rng.uniform(0, 2 * np.pi, count):
        lamp = (1 + depth * np.cos(2 * np.pi * 2 * mains * times + phase)).mean(axis=1)
        shots.append((wall * lamp[:, None] + rng.normal(0, 0.005, wall.shape)).astype(np.float32))
    return shots


@pytest.mark.parametrize("readout", [0.017, 0.0251, 0.033])
def test_a_wall_and_a_scene(readout: float) -> None:
    # One picture of a wall; of a scene several, whose common part is removed.
    for shots, tolerance in ((photos(readout), 0.01), (photos(readout, 3, scene=0.3), 0.02)):
        assert measure_flicker(shots).readout_time == pytest.approx(readout, rel=tolerance)


def test_other_mains_and_axes() -> None:
    (shot,) = photos(0.025, mains=60.0)
    assert measure_flicker([shot.T], mains=60.0, horizontal=True).readout_time == pytest.approx(0.025, rel=0.01)


def test_no_bands_no_answer() -> None:
    for shots in (photos(0.025, depth=0.0), photos(0.025, depth=0.0, scene=0.3)):
        found = measure_flicker(shots)
        assert found.readout_time is None
        assert "no clear bands" in found.reason
    with pytest.raises(InputError, match="at least 64 px"):
        measure_flicker([np.zeros((40, 80), np.float32)])
