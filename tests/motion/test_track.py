"""Laws of the orientation integrated from a gyro log."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsdeblur import Camera, GyroLog
from rsdeblur.motion.track import OrientationTrack

CAMERA = Camera(64, 48, 80.0)

# A product of n rotation matrices in float64 errs by about n roundings of 2e-16; n is below 500 here.
ROUNDING = 1e-12


def track_of(t, omega, camera=CAMERA):
    return OrientationTrack.from_log(GyroLog(t, omega), camera, float(t[0]), float(t[-1]), 0)


def irregular_times(n, span, seed=0):
    steps = np.random.default_rng(seed).uniform(0.5, 1.5, n - 1)
    return np.concatenate([[0.0], np.cumsum(steps)]) * span / steps.sum()


def whole_track(log, camera):
    """Return the track over the whole log."""
    start, end = log.span
    return OrientationTrack.from_log(log, camera, start, end, 0)


class TestIntegration:
    @pytest.mark.filterwarnings("ignore:gyro rates look like degrees")
    @pytest.mark.parametrize("rate", [(0, 0, 0), (3, 0, 0), (0, -0.7, 0), (0, 0, 25), (1.3, -2.1, 0.4)])
    @pytest.mark.parametrize("samples", [2, 9, 200])
    def test_constant_rate_is_exact(self, rate, samples):
        t = irregular_times(samples, 0.5)
        track = track_of(t, np.tile(rate, (samples, 1)))
        times = np.linspace(0.0, 0.5, 77)
        # C(t + dt) = exp(-[omega dt]x) C(t)
        expected = Rotation.from_rotvec(-times[:, None] * np.asarray(rate)).as_matrix()
        np.testing.assert_allclose(track.at(times), expected, atol=ROUNDING)

    @pytest.mark.parametrize("seed", range(3))
    def test_linear_rates_are_integrated_to_fourth_order(self, seed):
        n, substeps = 12, 100
        t = irregular_times(n, 0.8, seed)
        omega = np.random.default_rng(seed).uniform(-2.8, 2.8, (n, 3))
        track = track_of(t, omega)
        orientation, bound = Rotation.identity(), 0.0
        for k in range(n - 1):
            h, jump = t[k + 1] - t[k], omega[k + 1] - omega[k]
            middles = (np.arange(substeps) + 0.5) / substeps
            for step in Rotation.from_rotvec(-h / substeps * (omega[k] + middles[:, None] * jump)):
                orientation = step * orientation
            # With a = h |omega| and b = h |jump|, the first terms that the Magnus step leaves out (sixth order, Blanes
            # et al. 2009) are [a,[a,[a,b]]]/720 and [[a,b],b]/240; the midpoint steps leave out a b / (12 substeps^2).
            # A rotation vector of length e moves an entry by at most e; the next order is less than half of this one.
            a, b = h * np.linalg.norm(omega[k : k + 2], axis=1).max(), h * np.linalg.norm(jump)
            bound += 1.5 * (a**3 * b / 720 + a * b**2 / 240) + a * b / (12 * substeps**2)
            error = np.abs(track.at(t[k + 1]) - orientation.as_matrix()).max()
            assert error <= bound
        # Without the cross product, steps of 70 ms at 3 rad/s would each err by a b / 12, about 5e-3.
        assert bound < 3e-3

    def test_imu_axes_are_turned_into_camera_axes(self, shaky_log):
        log = shaky_log()
        turn = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
        turned = Camera(64, 48, 80.0, imu_to_camera=turn)
        straight = whole_track(log, CAMERA)
        rotated = whole_track(log, turned)
        times = np.linspace(*log.span, 23)
        # A change of basis: exp(-[R w]x) = R exp(-[w]x) R^T.
        np.testing.assert_allclose(rotated.at(times), turn @ straight.at(times) @ turn.T, atol=ROUNDING)
