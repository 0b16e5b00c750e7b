"""The simulator: laws of photos and clips, agreement with the PSFs, the test picture and the shake."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rsdeblur import Camera, Exposure, GyroLog, PsfBank, Translation, hand_shake, scene, simulate
from rsdeblur.choices import READOUT_DIRECTIONS
from rsdeblur.motion import BlurPaths, Capture
from rsdeblur.simulation.simulate import simulate_clip

SIZE, FOCAL = 80, 100.0
EXPOSURE, STILL = Exposure(0.12, 0.05), GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)))

# Half the side of the window around a dot, px.
RADIUS = 16

# Spline coefficients and weights are float32: some roundings of 6e-8 of values up to 1.
SPLINE = 3e-6


def camera_of(readout_time=0.03, direction="top-down", **options):
    return Camera(SIZE, SIZE, FOCAL, readout_time=readout_time, readout_direction=direction, **options)


def turning(*acceleration):
    """Return a log whose rate increases through zero: blur is one-sided, shows its sign, and changes with the row.

    The angle since mid-exposure has the mean acceleration x duration^2 / 24, about 1 px for 100 rad/s^2.
    """
    t = np.linspace(0.0, 0.4, 201)
    return GyroLog(t, np.clip(t - 0.165, -0.045, 0.045)[:, None] * acceleration)


def dots(places, sigma=2.5):
    y, x = np.mgrid[:SIZE, :SIZE]
    return np.sum([np.exp(-((y - b) ** 2 + (x - a) ** 2) / (2 * sigma**2)) for a, b in places], axis=0)


def moments(picture):
    """Return the sum, the centroid (x, y) and the covariances xx, yy, xy of a picture."""
    total = picture.sum(dtype=np.float64)
    weights = picture / total
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    centre = np.array([(weights * x).sum(), (weights * y).sum()])
    x, y = x - centre[0], y - centre[1]
    return total, centre, np.array([(weights * x * x).sum(), (weights * y * y).sum(), (weights * x * y).sum()])


@pytest.fixture(scope="module")
def picture():
    return scene(SIZE, SIZE, seed=1)


class TestIdentities:
    @pytest.mark.parametrize("direction", READOUT_DIRECTIONS)
    def test_zero_motion_returns_the_sharp_picture(self, picture, direction):
        for seen in simulate(picture, STILL, camera_of(direction=direction), EXPOSURE):
            np.testing.assert_allclose(seen, picture, atol=SPLINE)
            assert seen.dtype == np.float32

    def test_a_constant_stays_constant(self, shaky_log):
        for seen in simulate(np.full((SIZE, SIZE, 3), 0.6), shaky_log(), camera_of(), EXPOSURE):
            np.testing.assert_allclose(seen, 0.6, atol=SPLINE)

    def test_blur_is_linear(self, picture, shaky_log):
        a, b = picture[..., 0], picture[..., 1]
        whole, part_a, part_b = (
            simulate(p, shaky_log(), camera_of(), EXPOSURE).blurred for p in (0.3 * a + 0.7 * b, a, b)
        )
        np.testing.assert_allclose(whole, 0.3 * part_a + 0.7 * part_b, atol=SPLINE)

    @pytest.mark.parametrize("axes", np.eye(3), ids="xyz")
    def test_the_sum_of_a_blob_inside_is_kept(self, axes, shaky_log):
        blob = dots([(40, 40)], sigma=4)
        blurred = simulate(blob, shaky_log(axes), camera_of(0.0), EXPOSURE).blurred
        # A homography changes areas by 3 theta r / f: with a turn below 0.05 rad and a blob of radius 10 px at the
        # centre 1.5 %, with opposite signs on opposite sides; the rest is quadratic, 1.5 theta^2.
        assert blurred.sum() == pytest.approx(blob.sum(), rel=4e-3)

    def test_with_readout_rolling_differs_but_in_the_middle_row(self, picture, shaky_log):
        odd = scene(SIZE + 1, SIZE, seed=1)
        camera = Camera(SIZE, SIZE + 1, FOCAL, readout_time=0.03)
        seen = simulate(odd, shaky_log(), camera, EXPOSURE)
        np.testing.assert_allclose(seen.rolling[SIZE // 2], odd[SIZE // 2], atol=SPLINE)
        assert np.abs(seen.rolling - odd).max() > 0.1

    def test_timestamps_and_offset_shifted_together_change_nothing(self, picture, shaky_log):
        straight = simulate(picture, shaky_log(), camera_of(), EXPOSURE)
        moved = simulate(picture, shaky_log().shifted(3.5), camera_of(time_offset=-3.5), EXPOSURE)
        np.testing.assert_allclose(moved.blurred, straight.blurred, atol=SPLINE)


class TestReadout:
    def test_backwards_in_time_and_space_is_the_same(self, picture):
        # Bottom-up readout of the picture turned upside down is top-down readout of the picture.
        half_turn = np.diag([-1.0, -1.0, 1.0])
        log = turning(90, 60, 0)
        upright = simulate(picture, log, camera_of(), EXPOSURE)
        over = simulate(picture[::-1, ::-1], log, camera_of(direction="bottom-up", imu_to_camera=half_turn), EXPOSURE)
        for a, b in zip(upright, over, strict=True):
            np.testing.assert_allclose(b[::-1, ::-1], a, atol=SPLINE)

    @pytest.mark.parametrize("direction", ["left-right", "right-left"])
    def test_horizontal_readout_is_the_turned_problem(self, picture, direction, shaky_log):
        camera = camera_of(direction=direction)
        seen = simulate(picture, shaky_log(), camera, EXPOSURE)
        turned = simulate(np.rot90(picture, -1), shaky_log(), camera.turned(), EXPOSURE)
        for a, b in zip(seen, turned, strict=True):
            np.testing.assert_allclose(a, np.rot90(b), atol=SPLINE)


class TestFrame:
    @pytest.mark.parametrize("direction", READOUT_DIRECTIONS)
    def test_a_larger_scene_is_centred(self, direction, shaky_log):
        large = scene(SIZE + 20, SIZE + 8)
        seen = simulate(large, shaky_log(), camera_of(direction=direction), EXPOSURE)
        np.testing.assert_array_equal(seen.rectified, large[10:-10, 4:-4])
        assert seen.blurred.shape == seen.rolling.shape == (SIZE, SIZE, 3)

    def test_what_is_beyond_the_frame_does_not_change_the_inside(self, shaky_log):
        large = scene(SIZE + 40, SIZE + 40)
        whole = simulate(large, shaky_log(), camera_of(), EXPOSURE).blurred
        cut = simulate(large[20:-20, 20:-20], shaky_log(), camera_of(), EXPOSURE).blurred
        # Inside, paths end within 20 px; spline tails of the cut fade as 0.27 per pixel.
        np.testing.assert_allclose(whole[28:-28, 28:-28], cut[28:-28, 28:-28], atol=1e-5)
        assert np.abs(whole - cut).max() > 1e-2


class TestNoise:
    def test_level_and_place(self, picture):
        seen = simulate(picture, STILL, camera_of(), EXPOSURE, noise=0.01, seed=3)
        grain = seen.blurred - picture
        n = grain.size
        # Five standard errors of a standard deviation and of a mean.
        assert grain.std() == pytest.approx(0.01, rel=5 / math.sqrt(2 * n))
        assert abs(grain.mean()) < 5 * 0.01 / math.sqrt(n)
        for reference in (seen.rectified, seen.rolling):
            np.testing.assert_allclose(reference, picture, atol=SPLINE)


class TestOracle:
    """The blur of isolated smooth dots by warping, compared with PSFs traced and rasterised at their positions."""

    PLACES = ((22, 20), (58, 20), (21, 59), (57, 58))

    # Each axis alone, and all of them with both directions of the readout.
    @pytest.mark.parametrize(
        ("acceleration", "direction"),
        [
            *(((110, 0, 0), "top-down"), ((0, 110, 0), "bottom-up"), ((0, 0, 300), "top-down")),
            *(((60, -80, 150), "top-down"), ((60, -80, 150), "bottom-up")),
        ],
        ids=["x", "y", "z", "all-top-down", "all-bottom-up"],
    )
    # About z, 13 rad/s are needed to see something at 30 px from the centre.
    @pytest.mark.filterwarnings("ignore:gyro rates look like degrees")
    def test_dots_are_blurred_as_the_psfs_say(self, acceleration, direction):
        log, camera = turning(*acceleration), camera_of(direction=direction)
        seen = simulate(dots(self.PLACES), log, camera, EXPOSURE)
        capture = Capture.from_log(log, camera, EXPOSURE)
        shifts = []
        for x, y in self.PLACES:
            window = np.s_[y - RADIUS : y + RADIUS + 1, x - RADIUS : x + RADIUS + 1]
            total, centre, spread = moments(seen.blurred[window])
            expected_total, expected_centre, expected_spread = moments(_gathered(seen.rolling, capture, x, y))
            assert total == pytest.approx(expected_total, rel=1e-3)
            # Poses linear between rows 0.4 ms apart, and the last step of the iteration, leave about 1e-3 px.
            np.testing.assert_allclose(centre, expected_centre, atol=0.02)
            # Bilinear drawing of the path adds f (1 - f) to the variances, at most 1/4 px^2, and none between x and y.
            excess = expected_spread - spread
            assert np.all((excess[:2] > -0.03) & (excess[:2] < 0.28)), excess
            assert abs(excess[2]) < 0.03, excess
            shifts.append(np.abs(centre - moments(seen.rolling[window])[1]).max())
        # The test can fail: with a wrong sign, the centroid would err by twice this.
        assert min(shifts) > 0.2


def _gathered(sharp, capture, x, y):
    """Return the blur g(p) = sum_d h(p, d) u(p - d) around (x, y), with a separate PSF h for each pixel p."""
    reach = np.arange(-RADIUS, RADIUS + 1.0)
    bank = PsfBank.from_paths(BlurPaths.from_capture(capture, y + reach, x + reach))
    height, width = bank.size
    padded = np.pad(sharp, ((height // 2,) * 2, (width // 2,) * 2))
    latent = np.lib.stride_tricks.sliding_window_view(padded, bank.size)
    latent = latent[y - RADIUS : y + RADIUS + 1, x - RADIUS : x + RADIUS + 1]
    return np.einsum("yxij,yxij->yx", bank.kernels[..., ::-1, ::-1], latent)


CAMERA = Camera(96, 72, 110.0, readout_time=0.02, readout_direction="right-left")
EXPOSURES = [Exposure(0.1, 0.02), Exposure(0.5, 0.02)]


@pytest.fixture(scope="module")
def wide():
    return scene(112, 144)


@pytest.mark.parametrize("distortion", [{}, {"distortion_model": "radtan", "distortion": [0.1, 0.0, 0.01, 0.0]}])
def test_a_clip_of_one_frame_is_a_photo(wide, distortion):
    """Both are the scene at the mid-exposure of the middle row."""
    log, exposure, camera = hand_shake(0.5, seed=3), Exposure(0.2, 0.03), replace(CAMERA, **distortion)
    (frame,) = simulate_clip(wide, log, camera, [exposure], samples=12)
    photo = simulate(wide, log, camera, exposure, samples=12).blurred
    # Both integrate alike; the middle of the readout, summed in another order, differs by float64's rounding.
    np.testing.assert_allclose(frame, photo, atol=1e-6)


def test_a_still_camera_films_the_scene(wide):
    frames = list(simulate_clip(wide, STILL, CAMERA, EXPOSURES))
    assert len(frames) == 2
    for frame in frames:
        # float32 and the cubic interpolation at whole pixels
        assert np.abs(frame - wide[20:92, 24:120]).max() < 1e-4


SLIDE = Translation([0.0, 0.9], [[0, 0, 0], [0.009, -0.018, 0]], depth=2.0)


@pytest.fixture(scope="module")
def disc():
    """A mask of a disc in the middle of the scene."""
    return (np.hypot(*np.mgrid[-56:56, -72:72]) < 12).astype(float)


def places(frames):
    """Return the centres of gravity (x, y) of white frames."""
    return [np.array([np.average(axis, weights=frame) for axis in np.mgrid[:72, :96][::-1]]) for frame in frames]


@pytest.mark.parametrize("direction", ["top-down", "right-left"])
@pytest.mark.parametrize("depth", [2.0, 0.5])
def test_near_things_move_by_more(disc, direction, depth):
    """By f times the camera's way over their distance."""
    camera = Camera(96, 72, 110.0, readout_direction=direction)
    first, last = places(simulate_clip(disc, STILL, camera, EXPOSURES, translation=replace(SLIDE, depth=depth)))
    way = 0.4 / 0.9 * np.array([0.009, -0.018])
    np.testing.assert_allclose(last - first, -110.0 * way / depth, atol=0.02)


@pytest.mark.parametrize("shape", [(64, 64), (67, 150), (140, 80)])
def test_any_size_in_range(shape: tuple[int, int]) -> None:
    picture = scene(*shape)
    assert picture.shape == (*shape, 3)
    assert picture.dtype == np.float32
    assert picture.min() >= 0.0
    assert picture.max() <= 1.0


def test_structure_at_all_scales() -> None:
    grey = scene(192, 256).mean(axis=2)
    spectrum = np.abs(np.fft.fft2(grey - grey.mean()))
    radius = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(192)))
    # Amplitudes of photographs fall about as 1/f; a factor of 10 per octave would mean an empty band.
    octaves = [spectrum[(radius > r) & (radius <= 2 * r)].mean() for r in (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4)]
    ratios = np.array(octaves[:-1]) / np.array(octaves[1:])
    assert np.all((ratios > 0.8) & (ratios < 5.0)), ratios


# Drift, sway and tremor, Hz.
BANDS = (0.1, 2.0), (3.0, 7.0), (8.0, 12.0)


def band_rms(log: GyroLog, low: float, high: float) -> np.ndarray:
    """Return the rms rate per axis of a log between two frequencies in Hz."""
    from scipy import signal  # takes 0.5 s to import, in every process that collects the tests

    t = np.arange(*log.span, 1.0 / 200.0)
    even = np.stack([np.interp(t, log.t, log.omega[:, axis]) for axis in range(3)], axis=1)
    frequency, power = signal.welch(even, 200.0, nperseg=2000, axis=0)
    inside = (frequency >= low) & (frequency <= high)
    return np.asarray(np.sqrt(power[inside].sum(axis=0) * frequency[1]))


def test_covers_the_duration() -> None:
    log = hand_shake(0.5, rate=210.0)
    assert log.span[0] == 0.0
    assert log.span[1] >= 0.5
    assert log.rate == pytest.approx(210.0)
    assert log.epoch_ns == 0


def test_strength_is_a_factor_and_seeds_differ() -> None:
    log = hand_shake(0.5, seed=1)
    np.testing.assert_allclose(hand_shake(0.5, seed=1, strength=0.25).omega, 0.25 * log.omega, atol=1e-15)
    assert not np.allclose(hand_shake(0.5, seed=2).omega, log.omega)
    assert not hand_shake(0.5, strength=0.0).omega.any()


def test_energy_lies_in_the_bands() -> None:
    log = hand_shake(60.0, seed=0)
    inside = sum(band_rms(log, low - 0.2, high + 0.2) ** 2 for low, high in BANDS)
    # Welch's window leaks about a bin of 0.1 Hz; 98 % leaves room for it.
    assert np.all(inside > 0.98 * band_rms(log, 0.0, 100.0) ** 2)
