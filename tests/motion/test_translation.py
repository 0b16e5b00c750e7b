"""A camera that moves sideways, and its poses in the world; a rolling-shutter picture as that of a single moment."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skimage.metrics import peak_signal_noise_ratio

from rsdeblur import Camera, Exposure, GyroLog, Translation, deblur, scene, simulate
from rsdeblur.motion import BlurPaths, Capture, Trajectory
from rsdeblur.motion.alignment import rectify
from rsdeblur.motion.axes import imu_to_camera

CAMERA = Camera(160, 120, 200.0, readout_time=0.02)
EXPOSURE = Exposure(0.05, 0.04)
T = np.linspace(0, 0.2, 41)
STILL = GyroLog(T, np.zeros((len(T), 3)))
DEPTH = 0.5


def sway(amplitude=0.02):
    """Return a sway of centimetres within 0.1 s: about 10 px for a scene at half a metre."""
    x, y = amplitude * np.sin(25 * T), 0.7 * amplitude * np.cos(31 * T)
    return Translation(T, np.stack([x, y, 0.1 * x], axis=-1), DEPTH)


def paths(log, translation, camera=CAMERA, motion="rotation"):
    capture = Capture.from_log(log, camera, EXPOSURE, translation, motion=motion)
    return BlurPaths.from_capture(capture, [10.0, 60.0, 110.0], [20.0, 80.0], samples=21)


def test_the_picture_moves_against_the_camera():
    speed = 0.1  # m/s to the right
    right = Translation([0.0, 0.2], [[0, 0, 0], [0.2 * speed, 0, 0]], DEPTH)
    camera = replace(CAMERA, readout_time=0.0)
    for motion in ("rotation", "small-angle"):
        d = paths(STILL, right, camera, motion).displacements
        shift = -200.0 * speed * EXPOSURE.duration / DEPTH
        # Exact for a translation parallel to the picture.
        np.testing.assert_allclose(d[..., -1, 0] - d[..., 0, 0], shift, atol=1e-9)
        np.testing.assert_allclose(d[..., 1], 0, atol=1e-9)


def to_the_right(depth):
    return Translation([0.0, 0.2], [[0, 0, 0], [0.02, 0, 0]], depth)


@pytest.mark.parametrize("motion", ["rotation", "small-angle"])
def test_near_things_move_more_than_far_ones(motion):
    # A wall that comes nearer to the right and downwards: its inverse depth is linear.
    corners = 1 / np.array([[2.0, 4.0], [3.0, 5.0]])
    camera = replace(CAMERA, readout_time=0.0)
    d = paths(STILL, to_the_right(corners), camera, motion).displacements
    shifts = d[..., -1, :] - d[..., 0, :]
    down, across = np.array([10.0, 60.0, 110.0])[:, None] / 119, np.array([20.0, 80.0]) / 159
    speed, inverse = 0.1, 2 + 2 * across + down
    # Exact for a translation parallel to the picture.
    np.testing.assert_allclose(shifts[..., 0], -200 * speed * EXPOSURE.duration * inverse, atol=1e-9)
    np.testing.assert_allclose(shifts[..., 1], 0, atol=1e-9)


def test_a_map_turns_with_the_picture():
    depths = np.array([[0.5, 1.0, 2.0], [0.7, 1.5, 3.0]])
    camera = replace(CAMERA, readout_time=0.0)
    track = replace(sway(), depth=depths)
    stored = BlurPaths.from_capture(Capture.from_log(STILL, camera, EXPOSURE, track), [30.0], [50.0], samples=9)
    capture = Capture.from_log(STILL, camera.turned(), EXPOSURE, track.turned())
    turned = BlurPaths.from_capture(capture, [50.0], [119 - 30.0], samples=9).displacements[0, 0]
    # A quarter clockwise: the new x is the old -y, the new y the old x.
    x, y = stored.displacements[0, 0].T
    np.testing.assert_allclose(turned, np.stack([-y, x], axis=-1), atol=1e-9)


def quality(image, truth):
    inside = np.s_[24:-24, 24:-24]
    return peak_signal_noise_ratio(truth[inside], image[inside], data_range=1.0)


@pytest.mark.parametrize(
    ("turned", "lens"),
    [
        (False, ("none", ())),
        (False, ("radtan", (-0.2, 0.05, 0.0, 0.0))),
        (True, ("fisheye", (0.15, -0.06, 0.03, -0.009))),
    ],
)
def test_what_the_simulator_moves_is_undone(shaky_log, turned, lens):
    log, track = shaky_log((0.5, 0.5, 0.5)), sway()
    camera, sharp = replace(CAMERA, distortion_model=lens[0], distortion=lens[1]), scene(200, 240)[..., 1]
    if turned:
        camera, track, sharp = camera.turned(), track.turned(), np.rot90(sharp, -1)
    pictures = simulate(sharp, log, camera, EXPOSURE, noise=1e-3, translation=track)
    for geometry, truth in (("keep", pictures.rolling), ("rectify", pictures.rectified)):
        options = {"nsr": 3e-3, "geometry": geometry, "prior": "wiener", "check": False}
        right, ignored = (
            quality(deblur(pictures.blurred, log, camera, EXPOSURE, translation=known, **options).image, truth)
            for known in (track, None)
        )
        # Without the translation half of the motion is unknown. With it, the gain is that for rotations: 3 dB and more
        # on such a small picture, whose borders are a large part.
        assert right > max(ignored, quality(pictures.blurred, truth)) + 3, geometry


@pytest.mark.parametrize("motion", ["rotation", "small-angle"])
def test_at_rest_nothing_moves_whatever_the_lens(motion):
    camera = replace(CAMERA, distortion_model="radtan", distortion=(-0.2, 0.05, 0.01, 0.0))
    rest = Translation([0.0, 0.2], np.zeros((2, 3)), DEPTH)
    for track in (rest, None):
        capture = Capture.from_log(STILL, camera, EXPOSURE, track, motion=motion)
        found = BlurPaths.from_capture(capture, [0.0, 60.0], [0.0, 80.0]).displacements
        # The lens is inverted by iteration.
        np.testing.assert_allclose(found, 0, atol=1e-6)


def test_a_drift_is_a_shift_of_the_scene_on_top_of_a_known_track() -> None:
    camera, exposure = Camera(64, 48, (600.0, 500.0)), Exposure(0.22, 0.05, 7)
    still = GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)), 7)
    sideways = Translation([0.1, 0.4], [[0, 0, 0], [0.03, 0, 0]], depth=2.0, epoch_ns=7)
    for known, x in ((None, 0.0), (sideways, -600 * 0.1 / 2.0 * 0.05)):
        drift = Translation.drift((3, -2), camera, exposure, known=known)
        paths = BlurPaths.from_capture(Capture.from_log(still, camera, exposure, drift), [24.0], [32.0])
        samples = paths.displacements[0, 0]
        # Rounding of doubles.
        np.testing.assert_allclose(samples[-1] - samples[0], [3 + x, -2], atol=1e-9)


# The last one counts its times from another epoch, 0.1 s later.
@pytest.mark.parametrize(
    "known",
    [
        None,
        Translation([0.1, 0.4], [[0, 0, 0], [0.03, 0, 0]], depth=2.0),
        Translation([0.0, 0.3], [[0, 0, 0], [0.03, 0, 0]], depth=2.0, epoch_ns=100_000_000),
    ],
)
def test_an_acceleration_bends_a_drift_into_a_parabola(known) -> None:
    camera, exposure = Camera(64, 48, (600.0, 500.0)), Exposure(0.22, 0.05)
    still = GyroLog(np.arange(0, 1, 0.01), np.zeros((100, 3)))

    def path(*acceleration):
        drift = Translation.drift((3, -2), camera, exposure, acceleration=acceleration, known=known)
        capture = Capture.from_log(still, camera, exposure, drift)
        return BlurPaths.from_capture(capture, [24.0], [32.0], samples=65).displacements[0, 0]

    since = np.linspace(-0.025, 0.025, 65)
    parabola = 0.5 * np.square(since)[:, None] * (4000.0, -8000.0)
    bend = path(4000.0, -8000.0) - path(0.0, 0.0)
    # Chords that take a 32nd of the exposure, 1.6 ms, are at most 8000 / 8 * 0.0016**2 = 0.0025 px off.
    np.testing.assert_allclose(bend - bend[32], parabola, atol=0.003)


TIMES = np.linspace(0.0, 1.0, 31)
STAMPED = Exposure(0.25, 0.2, 7 * 10**18)
MOUNTED = Camera(160, 120, 200.0, readout_time=0.02, imu_to_camera="phone-landscape")
# A straight way to the right of the camera, in its axes, at 0.3 m/s.
WAY = np.outer(TIMES, (0.3, 0.0, 0.0))
# The camera in the world: askew, without turning.
POSE = Rotation.from_rotvec((0.4, -1.1, 0.7))


def seen(body_to_camera: np.ndarray, axes: str) -> np.ndarray:
    """Return positions at the start and the end of the exposure, of a body mounted like this."""
    world = POSE.apply(WAY) + np.array([10.0, -20.0, 3.0])
    body = POSE * Rotation.from_matrix(body_to_camera)
    trajectory = Trajectory(TIMES, world, np.tile(body.as_quat(), (len(TIMES), 1)), STAMPED.epoch_ns)
    track = trajectory.translation(STAMPED, MOUNTED, 2.0, axes=axes)
    assert track.epoch_ns == STAMPED.epoch_ns
    return 2.0 * track.at(np.array([0.25, 0.45]))


@pytest.mark.parametrize("axes", ["camera", "imu", "phone-portrait", "gyroflow", "YxZ"])
def test_the_way_is_that_in_the_cameras_axes(axes: str) -> None:
    matrix = {"camera": np.eye(3), "imu": MOUNTED.imu_to_camera.copy()}.get(axes)
    found = seen(imu_to_camera(axes) if matrix is None else matrix, axes)
    # From zero at the start of the exposure.
    np.testing.assert_allclose(found, [[0, 0, 0], [0.06, 0, 0]], atol=1e-12)


def test_the_orientation_is_that_at_the_start_of_the_exposure() -> None:
    turning = Rotation.from_rotvec(np.outer(TIMES - STAMPED.start, (0.0, 0.5, 0.0)))
    trajectory = Trajectory(TIMES, WAY, turning.as_quat(), STAMPED.epoch_ns)
    track = trajectory.translation(STAMPED, MOUNTED, 1.0)
    # At the start the body's axes are the world's; a rotation about y is interpolated without error.
    np.testing.assert_allclose(track.at(np.array(0.45)), (0.06, 0, 0), atol=1e-12)


def test_without_orientations_positions_are_in_the_cameras_axes() -> None:
    track = Trajectory(TIMES, WAY, None, STAMPED.epoch_ns).translation(STAMPED, MOUNTED, 1.0)
    np.testing.assert_allclose(track.at(np.array(0.45)), (0.06, 0, 0), atol=1e-12)


@pytest.mark.parametrize("early", [2e-10, 9e-10])
def test_an_exposure_may_open_a_tick_of_the_clock_before_the_first_pose(early: float) -> None:
    poses = Rotation.from_rotvec(np.outer(TIMES, (0.0, 0.5, 0.0))).as_quat()
    trajectory = Trajectory(TIMES + STAMPED.start + early, WAY, poses, STAMPED.epoch_ns)
    whole = replace(trajectory, t=TIMES + STAMPED.start)
    first, second = (each.translation(STAMPED, MOUNTED, 2.0).at(np.array([0.45])) for each in (trajectory, whole))
    # 1 ns of 0.3 m/s.
    np.testing.assert_allclose(first, second, atol=1e-9)


HEIGHT, WIDTH, PAD = 80, 96, 16
SHORT = Exposure(0.12, 0.02)
INSIDE = np.s_[12:-12, 12:-12]


def camera_of(readout_time=0.03, **options):
    return Camera(WIDTH, HEIGHT, 110.0, readout_time=readout_time, **options)


@pytest.fixture(scope="module")
def large():
    """Return a scene that continues beyond the frame and contains no detail too fine for a spline."""
    picture = scene(HEIGHT + 2 * PAD, WIDTH + 2 * PAD, seed=2)
    spectrum = np.fft.rfft2(picture, axes=(0, 1))
    fy, fx = np.fft.fftfreq(picture.shape[0])[:, None, None], np.fft.rfftfreq(picture.shape[1])[:, None]
    spectrum *= np.exp(-0.5 * (2 * np.pi * 0.8) ** 2 * (fx**2 + fy**2))
    return np.fft.irfft2(spectrum, picture.shape[:2], axes=(0, 1)).astype(np.float32)


@pytest.mark.parametrize("direction", ["top-down", "bottom-up"])
@pytest.mark.parametrize("seed", range(3))
def test_the_rolling_picture_becomes_the_rectified_one(large, shaky_log, direction, seed):
    log, camera = shaky_log(seed=seed), camera_of(readout_direction=direction)
    truth = simulate(large, log, camera, SHORT)
    image, coverage = rectify(truth.rolling, Capture.from_log(log, camera, SHORT))
    before, after = (
        peak_signal_noise_ratio(truth.rectified[INSIDE], p[INSIDE], data_range=1) for p in (truth.rolling, image)
    )
    # Errors of two spline interpolations of a picture blurred by 0.8 px; a skew of a pixel or more would be larger.
    assert after > 45
    assert after > before + 12
    assert coverage[INSIDE].all()


@pytest.mark.parametrize("rate", [(0, 0, 0), (2, -1, 3)])
def test_without_readout_it_is_the_identity(large, rate):
    log = GyroLog(np.linspace(0, 0.4, 81), np.tile(np.float64(rate), (81, 1)))
    image = large[:HEIGHT, :WIDTH]
    rectified, coverage = rectify(image, Capture.from_log(log, camera_of(0.0), SHORT))
    # Float32 spline coefficients.
    np.testing.assert_allclose(rectified, image, atol=3e-6)
    assert coverage.all()


@pytest.mark.parametrize("rate", [1.0, -1.0])
def test_coverage_marks_what_no_row_saw(rate):
    # A pan of 1 rad/s about y moves the picture by f omega = 110 px/s: rows 15 ms from the middle are off by 1.65 px.
    log = GyroLog(np.linspace(0, 0.4, 81), np.tile([0.0, rate, 0.0], (81, 1)))
    ramp = np.tile(np.arange(WIDTH, dtype=np.float32)[:, None], (HEIGHT, 1, 1))
    image, coverage = rectify(ramp, Capture.from_log(log, camera_of(), SHORT))
    # Positive rates move the scene to the left: the first rows show it too far right and miss its right end.
    corners = coverage[[0, 0, -1, -1], [0, -1, 0, -1]]
    np.testing.assert_array_equal(corners, [True, False, False, True] if rate > 0 else [False, True, True, False])
    assert coverage[:, 3:-3].all()
    assert coverage[HEIGHT // 2].all()
    # Where no row saw the scene, the border pixel is repeated.
    repeated = image[~coverage][:, 0]
    np.testing.assert_allclose(np.minimum(repeated, WIDTH - 1 - repeated), 0.0, atol=1e-3)
    # Elsewhere the ramp is moved back.
    assert image[0, 40, 0] - 40 == pytest.approx(np.sign(rate) * 1.65, abs=0.1)
