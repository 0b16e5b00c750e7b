"""Laws of the paths: signs, the reference of each row, and agreement with independent computations."""

import itertools

import numpy as np
import pytest
from scipy.interpolate import interp1d
from scipy.optimize import brentq

from rsdeblur import Camera, CoverageError, Exposure, GyroLog, InputError, PsfBank, hand_shake
from rsdeblur.choices import MOTIONS, Motion
from rsdeblur.errors import ClockError, GapError
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.motion.alignment import paths_between
from rsdeblur.motion.paths import burst_captures, places
from rsdeblur.pipeline.tiles import largest_derivative
from rsdeblur.psf import tile_centres

WIDTH, HEIGHT, FOCAL = 96, 64, 110.0
CENTRE = (np.array([31.5]), np.array([47.5]))
ROWS, COLS = np.array([0.0, 10.0, 31.5, 50.0, 63.0]), np.array([0.0, 40.0, 95.0])
EXPOSURE = Exposure(0.1, 0.04)

# Poses are tabulated at rows, here dt = 0.47 ms apart, and interpolated linearly. At up to 200 rad/s^2 they err by
# dt^2 / 8 x 200 = 5e-6 rad, times the focal length, which perspective increases by a third towards the corners.
BETWEEN_ROWS = 8e-4  # px


def camera_of(readout_time=0.03, **options):
    return Camera(WIDTH, HEIGHT, FOCAL, readout_time=readout_time, **options)


def constant(*rate):
    """Return a log of 0.4 s with a constant rate."""
    return GyroLog(np.linspace(0.0, 0.4, 81), np.tile(np.float64(rate), (81, 1)))


def paths_of(log, camera, rows=ROWS, cols=COLS, exposure=EXPOSURE, *, motion="rotation", **options):
    return BlurPaths.from_capture(Capture.from_log(log, camera, exposure, motion=motion), rows, cols, **options)


class TestSigns:
    """Displacements d = p - q at time t, compared with the angle theta turned since mid-exposure."""

    THETA = np.linspace(-0.02, 0.02, 9)  # 1 rad/s for 40 ms

    @pytest.mark.parametrize("motion", MOTIONS)
    @pytest.mark.parametrize(
        ("rate", "direction"), [((1, 0, 0), (0, 1)), ((0, 1, 0), (-1, 0)), ((0, 0, 1), (0, 0))], ids="xyz"
    )
    def test_centre_moves_by_f_times_minus_theta_y_theta_x(self, motion, rate, direction):
        d = paths_of(constant(*rate), camera_of(0.0), *CENTRE, motion=motion, samples=9).displacements[0, 0]
        # The rotation moves by f tan(theta), which is f theta^3 / 3 = 3e-4 px more.
        np.testing.assert_allclose(d, FOCAL * self.THETA[:, None] * direction, atol=4e-4)

    def test_roll_moves_a_point_by_theta_z_times_y_minus_x(self):
        d = paths_of(constant(0, 0, 1), camera_of(0.0), samples=9).displacements
        y, x = np.meshgrid(ROWS - 31.5, COLS - 47.5, indexing="ij")
        expected = self.THETA[:, None] * np.stack([y, -x], axis=-1)[:, :, None]
        # Second order of the angle: theta^2 / 2 times the 57 px from the centre to a corner.
        np.testing.assert_allclose(d, expected, atol=0.012)

    @pytest.mark.parametrize("scale", [1.0, 0.1])
    def test_small_angle_is_the_limit_of_the_rotation_at_the_centre(self, shaky_log, scale):
        log = shaky_log()
        log = GyroLog(log.t, scale * log.omega)
        both = [paths_of(log, camera_of(0.0), *CENTRE, motion=motion, samples=101) for motion in MOTIONS]
        # At 2 rad/s, 20 ms from mid-exposure: angles below scale x 0.05 rad; the error of small angles is quadratic.
        error = np.abs(both[0].displacements - both[1].displacements).max()
        assert 0 < error < FOCAL * (0.05 * scale) ** 2
        assert both[0].lengths.min() > 2 * scale


class TestAnchor:
    @pytest.mark.parametrize("motion", MOTIONS)
    def test_paths_pass_zero_at_mid_exposure(self, shaky_log, motion):
        d = paths_of(shaky_log(), camera_of(), motion=motion, samples=101).displacements
        np.testing.assert_allclose(d[:, :, 50], 0.0, atol=BETWEEN_ROWS)

    @pytest.mark.parametrize("direction", ["top-down", "bottom-up"])
    @pytest.mark.parametrize("seed", range(2))
    def test_keep_is_the_inverse_of_the_rolling_shutter_projection(self, shaky_log, direction, seed):
        camera = camera_of(readout_direction=direction)
        capture = Capture.from_log(shaky_log(seed=seed), camera, EXPOSURE)
        paths = BlurPaths.from_capture(capture, ROWS, COLS, samples=9)
        times = np.linspace(*capture.exposure.window(ROWS, camera), 9, axis=-1)
        for (b, y), (s, x), t in itertools.product(enumerate(ROWS), enumerate(COLS), range(9)):
            # The point that the pixel sees at that time appears on the row that shows it at its own mid-exposure.
            world = capture.track.at(times[b, t]).T @ np.linalg.inv(camera.matrix) @ [x, y, 1.0]

            def shown(row, world=world):
                u, v, w = camera.matrix @ capture.track.at(capture.mid(np.array(row))) @ world
                return np.array([u / w, v / w])

            row = brentq(lambda row, shown=shown: shown(row)[1] - row, -30.0, 100.0, xtol=1e-10)
            # Three steps of the iteration leave (speed x line time)^3 of the path, here at most 0.1^3 of 3 px.
            np.testing.assert_allclose(paths.displacements[b, s, t], [x, y] - shown(row), atol=3e-3)


class TestSamples:
    @pytest.mark.parametrize("seed", range(4))
    def test_doubling_them_changes_no_kernel(self, shaky_log, seed):
        capture = Capture.from_log(shaky_log(seed=seed), Camera(WIDTH, HEIGHT, 400.0, readout_time=0.03), EXPOSURE)
        auto = BlurPaths.from_capture(capture, ROWS, COLS)
        double = BlurPaths.from_capture(capture, ROWS, COLS, samples=2 * auto.displacements.shape[2] - 1)
        half = (auto.extent[0] + 2, auto.extent[1] + 2)
        kernels = [_kernels_of_size(paths, half) for paths in (auto, double)]
        # Half a percent of the energy may move, by a fraction of a pixel.
        assert np.abs(kernels[0] - kernels[1]).sum(axis=(2, 3)).max() < 5e-3

    def test_length_and_extent(self):
        corner = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, -1.0]])
        paths = BlurPaths(np.stack([corner, 0 * corner])[:, None], np.arange(2.0), np.zeros(1))
        assert paths.lengths.tolist() == [[10.0], [0.0]]
        # The extent along y comes before the one along x.
        assert paths.extent == (4.0, 3.0)


def _kernels_of_size(paths, half):
    """Return the kernels of all paths at one size, forced by an additional path to the corner."""
    size = [int(np.ceil(n)) for n in half]
    frame = np.full((1, 1, paths.displacements.shape[2], 2), size[::-1], dtype=np.float64)
    displacements = np.concatenate([paths.displacements, np.repeat(frame, len(paths.cols), axis=1)])
    return PsfBank.from_paths(BlurPaths(displacements, np.append(paths.rows, 1e3), paths.cols)).kernels[:-1]


class TestCapture:
    def test_refuses_what_the_log_does_not_describe(self):
        log, camera = constant(0, 0, 0), camera_of(0.03)
        with pytest.raises(CoverageError, match=r"misses 50\.000 ms at its start"):
            Capture.from_log(log, camera, Exposure(-0.05, 0.04))
        # The last row opens 30 ms x 63/64 after the first.
        with pytest.raises(CoverageError, match=r"misses 19\.531 ms at its end"):
            Capture.from_log(log, camera, Exposure(0.35, 0.04))
        with pytest.raises(ClockError):
            Capture.from_log(log, camera, Exposure(0.1, 0.04, 10**18))
        with pytest.raises(GapError):
            Capture.from_log(GyroLog(np.delete(log.t, range(25, 32)), log.omega[7:]), camera, EXPOSURE)

    def test_refuses_a_camera_read_along_x(self):
        camera = camera_of(readout_direction="left-right")
        with pytest.raises(InputError, match=r"read left-right; trace paths with camera\.turned\(\)"):
            Capture.from_log(constant(0, 0, 0), camera, EXPOSURE)
        Capture.from_log(constant(0, 0, 0), camera.turned(), EXPOSURE)


class TestChange:
    """Changes and curvatures, from which the numbers of bands and strips follow."""

    @pytest.mark.parametrize("motion", MOTIONS)
    @pytest.mark.parametrize("number", [2, 32])
    @pytest.mark.parametrize("seed", range(2))
    def test_neighbouring_tiles_differ_by_no_more_than_their_share_of_the_change(self, shaky_log, motion, number, seed):
        capture = Capture.from_log(shaky_log(seed=seed), camera_of(), EXPOSURE, motion=motion)
        probe = capture.probe
        bands = _paths_with_the_times_of_the_probe(capture, tile_centres(number, HEIGHT), probe.cols)
        strips = _paths_with_the_times_of_the_probe(capture, probe.rows, tile_centres(number, WIDTH))
        for axis, tiles in enumerate((bands, strips)):
            change = largest_derivative(probe, 1, axis)
            steps = np.linalg.norm(np.diff(tiles, axis=axis), axis=-1).max()
            # The grid is shorter than the picture by a pixel, 1.6 % here, and its 33 rows and 9 columns may miss a
            # little of the fastest change.
            assert steps <= (1.05, 1.1)[axis] * change / number + 1e-3
            if number == 32:
                # The bound is not too large: tiles as narrow as the rows of the grid have the fastest change too.
                assert steps >= 0.95 * change / number - 1e-9


def _paths_with_the_times_of_the_probe(capture, rows, cols):
    samples = capture.probe.displacements.shape[2]
    return BlurPaths.from_capture(capture, rows, cols, samples=samples).displacements


CAMERA = Camera(160, 120, 180.0, readout_time=0.03)
EXPOSURES = [Exposure(0.1, 0.05), Exposure(0.25, 0.02), Exposure(-0.6, 0.1, 1_000_000_000)]
DOWN, ACROSS = np.array([10.0, 60.0, 110.0]), np.array([20.0, 140.0])
LOG = hand_shake(0.6, seed=2)


@pytest.mark.parametrize("motion", ["rotation", "small-angle"])
def test_the_reference_keeps_its_own_paths(motion: Motion) -> None:
    capture = burst_captures(LOG, CAMERA, EXPOSURES, motion=motion)[0]
    alone = BlurPaths.from_capture(Capture.from_log(LOG, CAMERA, EXPOSURES[0], motion=motion), DOWN, ACROSS, samples=33)
    paths = BlurPaths.from_capture(capture, DOWN, ACROSS, samples=33, reference=capture).displacements
    # The orientation counts from another moment.
    np.testing.assert_allclose(paths, alone.displacements, atol=1e-9)


def test_places_lead_there_and_back_and_agree_with_rays() -> None:
    first, _, last = burst_captures(LOG, CAMERA, EXPOSURES)
    points = np.stack(np.meshgrid(ACROSS, DOWN), axis=-1)
    moved = places(last, first, points)
    assert np.abs(moved - points).max() > 2
    np.testing.assert_allclose(places(first, last, moved), points, atol=1e-4)
    here, there = (
        np.einsum("...ji,...j->...i", capture.track.at(capture.mid(pixels[..., 1])), CAMERA.rays(pixels))
        for capture, pixels in ((first, points), (last, moved))
    )
    np.testing.assert_allclose(np.cross(here, there), 0, atol=1e-6)


def test_paths_of_resampled_frames_start_and_end_around_their_middle() -> None:
    first, second, _ = burst_captures(LOG, CAMERA, EXPOSURES)
    paths = BlurPaths.from_capture(second, DOWN, ACROSS, samples=65, reference=first).displacements
    # At mid-exposure the resampled pixel shows its own place, whatever the rotation between the frames.
    np.testing.assert_allclose(paths[:, :, 32], 0, atol=1e-3)
    own = BlurPaths.from_capture(second, DOWN, ACROSS)
    assert BlurPaths.from_capture(second, DOWN, ACROSS, reference=first).extent[1] < 1.5 * own.extent[1] + 0.5


def test_rows_between_traced_ones_have_the_paths_that_tracing_gives() -> None:
    first, second, _ = burst_captures(LOG, CAMERA, EXPOSURES)
    got = paths_between(second, first, slice(30, 71), ACROSS)
    expected = BlurPaths.from_capture(second, np.arange(30.0, 71.0), ACROSS, reference=first)
    np.testing.assert_array_equal(got.rows, expected.rows - 30)
    # They have fewer points, evenly spaced in time.
    fine, coarse = (np.linspace(0, 1, paths.displacements.shape[2]) for paths in (expected, got))
    at_same_times = interp1d(fine, expected.displacements, axis=2)(coarse)
    # Each row takes 0.25 ms to read.
    np.testing.assert_allclose(got.displacements, at_same_times, atol=0.01)


def test_a_recording_may_have_more_samples_than_an_exposure() -> None:
    """Frames of a fast gyro are taken one by one; the time between them does not count."""
    t = np.arange(0, 2.2, 1 / 8000)
    log = GyroLog(t, np.full((len(t), 3), 0.02))
    exposures = [Exposure(0.05 + 0.5 * n, 0.01) for n in range(5)]
    for capture, exposure in zip(burst_captures(log, CAMERA, exposures), exposures, strict=True):
        alone = Capture.from_log(log, CAMERA, exposure)
        np.testing.assert_allclose(capture.probe.displacements, alone.probe.displacements, atol=1e-9)
