"""The camera, its lens and the exposure: rays and times stay with the scene; probable mistakes are named."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsdeblur import Camera, Exposure, GyroLog, InputError, RsdeblurWarning, triage
from rsdeblur.choices import READOUT_DIRECTIONS
from rsdeblur.motion import lens
from rsdeblur.motion.camera_values import doubts

MOUNT = Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix()


@pytest.fixture(params=READOUT_DIRECTIONS)
def camera(request):
    return Camera(
        96, 64, (90.0, 85.0), (44.2, 33.9), readout_time=0.03, readout_direction=request.param, imu_to_camera=MOUNT,
        time_offset=-0.7, time_offset_sd=0.002, distortion_model="radtan", distortion=(-0.1, 0.02, 0.001, -0.002),
        timestamp_marks="middle",
    )  # fmt: skip


def directions(camera, points):
    """Return the rays of unit depth through points (n, 2)."""
    return np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(camera.matrix).T


def project(camera, rays):
    x, y, z = (rays @ camera.matrix.T).T
    return np.stack([x / z, y / z], axis=-1)


def gyro_windows(camera, exposure, rows):
    """Return the exposure times of each row, in gyro time."""
    opens, closes = exposure.window(rows, camera)
    return opens - camera.time_offset, closes - camera.time_offset


POINTS = np.array([[0, 0], [95, 63], [10, 50], [44.2, 33.9], [70.25, 3.5]])


def test_one_focal_length_and_the_centre():
    camera = Camera(7, 4, 5)
    assert camera.focal_length == (5.0, 5.0)
    assert camera.principal_point == (3.0, 1.5)
    assert camera.readout_time == camera.time_offset == 0.0
    assert np.array_equal(camera.imu_to_camera, np.eye(3))
    np.testing.assert_array_equal(camera.matrix, [[5, 0, 3], [0, 5, 1.5], [0, 0, 1]])


class TestTurned:
    def test_four_turns_are_the_identity(self, camera):
        assert camera.turned().turned().turned().turned() == camera

    def test_pixels_follow_rot90(self, camera):
        picture = np.arange(64 * 96).reshape(64, 96)
        turned = np.rot90(picture, -1)
        after = camera.turned()
        assert (after.height, after.width) == turned.shape
        # In the turned axes (x' = -y, y' = x), the ray through a pixel meets the same pixel of the turned picture.
        points = np.array([[0, 0], [95, 0], [17, 60]])
        x, y, z = directions(camera, points).T
        x1, y1 = np.rint(project(after, np.stack([-y, x, z], axis=1))).astype(int).T
        assert np.array_equal(turned[y1, x1], picture[points[:, 1], points[:, 0]])


@pytest.mark.parametrize("s", [0.5, 2.0, 0.25, 1.0, 0.3])
def test_rays_keep_their_pixel_edges(camera, s):
    small = camera.scaled(s)
    assert (small.width, small.height) == (round(96 * s), round(64 * s))
    # Resizing maps pixel edges onto each other. They are at halves, because pixel centres are at integers.
    ratio = np.array([small.width / 96, small.height / 64])
    np.testing.assert_allclose(directions(small, (POINTS + 0.5) * ratio - 0.5), directions(camera, POINTS), atol=1e-12)


class TestCropped:
    BOX = (13, 7, 50, 40)

    def test_rays_stay(self, camera):
        left, top, width, height = self.BOX
        cut = camera.cropped(*self.BOX)
        assert (cut.width, cut.height) == (width, height)
        np.testing.assert_allclose(directions(cut, POINTS - [left, top]), directions(camera, POINTS), atol=1e-14)

    def test_rows_keep_their_times(self, camera):
        left, top, width, height = self.BOX
        cut, exposure = camera.cropped(*self.BOX), Exposure(3.0, 0.02)
        first, size = (left, width) if camera.horizontal_readout else (top, height)
        rows = np.arange(size)
        whole = gyro_windows(camera, exposure, first + rows)
        np.testing.assert_allclose(gyro_windows(cut, exposure, rows), whole, atol=1e-14)


def test_cameras_of_equal_values_are_equal(camera):
    for same in (replace(camera), pickle.loads(pickle.dumps(camera))):
        assert same == camera
        assert hash(same) == hash(camera)
    for change in (
        {"width": 97},
        {"distortion_model": "none", "distortion": ()},
        {"time_offset": 0.0},
        {"imu_to_camera": MOUNT.T},
    ):
        assert replace(camera, **change) != camera
    assert camera != "camera"


def test_files_keep_cameras(camera, tmp_path):
    path = tmp_path / "camera.toml"
    camera.save(path)
    assert Camera.load(path) == camera
    # Three keys are enough. Without a readout time, that of a phone is a guess.
    path.write_text("width = 64\nheight = 48\nfocal_length = 80\n")
    loaded = Camera.load(path)
    assert loaded == Camera(64, 48, 80.0, readout_time=loaded.readout_time, readout_sd=loaded.readout_sd)
    assert 0 < loaded.readout_sd < loaded.readout_time
    assert loaded.cropped(0, 0, 64, 24).readout_sd == loaded.readout_sd / 2
    path.write_text("width = 64\nheight = 48\nfocal_length = 80\nreadout_time = 0.0\n")
    assert Camera.load(path) == Camera(64, 48, 80.0)


EXPOSURE = Exposure(2.0, 0.01)


def camera_of(direction, readout_time=0.03):
    return Camera(60, 40, 50.0, readout_time=readout_time, readout_direction=direction)


@pytest.mark.parametrize(
    ("direction", "first", "last"),
    [("top-down", 0, 39), ("bottom-up", 39, 0), ("left-right", 0, 59), ("right-left", 59, 0)],
)
def test_first_and_last_line(direction, first, last):
    camera = camera_of(direction)
    opens, closes = EXPOSURE.window([first, last], camera)
    assert opens[0] == 2.0
    # The readout ends one row past the last.
    assert opens[1] == pytest.approx(2.0 + 0.03 * (camera.lines - 1) / camera.lines)
    np.testing.assert_allclose(closes - opens, 0.01, atol=1e-15)


@pytest.mark.parametrize("direction", READOUT_DIRECTIONS)
def test_span_holds_every_window_and_no_more(direction):
    camera = camera_of(direction)
    opens, closes = EXPOSURE.window(np.arange(camera.lines), camera)
    assert EXPOSURE.span(camera) == (opens.min(), closes.max())


@pytest.mark.parametrize("direction", ["top-down", "bottom-up", "left-right", "right-left"])
def test_the_timestamp_marks_what_the_camera_says(direction: str) -> None:
    exposure = Exposure(1.0, 0.04)
    rows = np.arange(10.0)

    def windows(timestamp: str) -> tuple[np.ndarray, np.ndarray]:
        camera = Camera(10, 10, 50.0, readout_time=0.02, readout_direction=direction, timestamp_marks=timestamp)
        return exposure.window(rows, camera)

    assert windows("start")[0].min() == 1.0
    # Rounding of a few sums near 1.
    assert windows("end")[1].max() == pytest.approx(1.0, abs=1e-15)
    opens, closes = windows("middle")
    assert (opens + closes).mean() / 2 == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("camera", "hint"),
    [
        (Camera(4000, 3000, (4.7, 4.7)), "is it in mm?"),
        (Camera(640, 480, (500, 500), readout_time=18.0), "did you mean 18 ms?"),
    ],
)
def test_mistakes_are_named(camera: Camera, hint: str) -> None:
    (doubt,) = doubts(camera)
    assert hint in doubt


def test_a_wrong_unit_warns_at_once() -> None:
    with pytest.warns(RsdeblurWarning, match="18 ms"):
        Camera(640, 480, 500, readout_time=18.0)
    # 43.267 mm is the diagonal of film: 800 px here.
    with pytest.warns(RsdeblurWarning, match="is it in mm.* means 481 px"):
        camera = Camera(640, 480, 26)
    # No second warning, which would be an error here.
    assert camera.scaled(0.5).width == 320


def test_ordinary_cameras_raise_no_doubt() -> None:
    # A phone, an action camera's fisheye, and a telescope of 600 mm on a full-frame sensor.
    fisheye = Camera(4000, 3000, 1000, distortion_model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0))
    for camera in (Camera(4000, 3000, 3000, readout_time=0.03), fisheye, Camera(6000, 4000, 100_000)):
        assert doubts(camera) == []


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


WIDTH, HEIGHT = 192, 160
LENSES = {
    "radtan": ("radtan", (-0.28, 0.07, 0.002, -0.003)),
    "radtan 5": ("radtan", (-0.3, 0.12, 0.001, 0.002, -0.02)),
    "rational": ("radtan", (0.2, -0.1, 0.001, 0.002, 0.01, 0.1, 0.02, 0.01)),
    "fisheye": ("fisheye", (0.05, -0.02, 0.01, -0.003)),
    "none": ("none", ()),
}
MODELS = pytest.mark.parametrize(("model", "k"), LENSES.values(), ids=LENSES)


def camera_with(model: str, k: tuple[float, ...], **changes: object) -> Camera:
    return Camera(WIDTH, HEIGHT, (150.0, 155.0), (93.0, 82.0), distortion_model=model, distortion=k, **changes)


@pytest.fixture(scope="module")
def pixels() -> np.ndarray:
    return np.stack(np.meshgrid(np.linspace(0, WIDTH - 1, 23), np.linspace(0, HEIGHT - 1, 17)), axis=-1)


class TestInverse:
    @MODELS
    def test_rays_are_projected_back(self, model, k, pixels):
        camera = camera_with(model, k)
        # Newton's method stops at 1e-13 in normalised coordinates.
        np.testing.assert_allclose(camera.project(camera.rays(pixels)), pixels, atol=1e-9)

    def test_a_fisheye_sees_behind_its_plane(self):
        camera = Camera(400, 400, 100.0, distortion_model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0))
        direction = camera.rays(np.array([[199.5 + 100 * 1.8, 199.5]]))
        np.testing.assert_allclose(direction, [[np.sin(1.8), 0.0, np.cos(1.8)]], atol=1e-12)
        np.testing.assert_allclose(camera.project(direction), [[199.5 + 180, 199.5]], atol=1e-9)

    def test_beyond_the_reach_there_is_no_direction(self):
        # r - 0.1 r^3 rises to 1.217 at most
        camera = camera_with("radtan", (-0.1, 0.0, 0.0, 0.0))
        radius = np.array([[1.21], [1.22]])
        seen = camera.rays(radius * (150.0, 0.0) + camera.principal_point)
        assert np.isnan(seen).all(axis=-1).tolist() == [False, False]
        assert np.isnan(seen[..., :2]).all(axis=-1).tolist() == [False, True]


@MODELS
def test_points_are_those_of_opencvs_documentation(model, k, pixels):
    camera = camera_with(model, k)
    x, y, z = np.moveaxis(camera.rays(pixels), -1, 0)
    a, b = x / z, y / z
    r = np.hypot(a, b)
    if model == "fisheye":
        a, b = (side * np.polyval([*np.insert(k[::-1], range(1, 5), 0), 1, 0], np.arctan(r)) / r for side in (a, b))
    else:
        k1, k2, p1, p2, k3, k4, k5, k6 = np.append(k, np.zeros(8 - len(k)))
        radial = np.polyval([k3, k2, k1, 1], r**2) / np.polyval([k6, k5, k4, 1], r**2)
        bent = (
            a * radial + 2 * p1 * a * b + p2 * (r**2 + 2 * a**2),
            b * radial + p1 * (r**2 + 2 * b**2) + 2 * p2 * a * b,
        )
        a, b = bent
    np.testing.assert_allclose(np.stack([150 * a + 93, 155 * b + 82], axis=-1), pixels, atol=1e-8)


def test_wild_coefficients_are_refused_or_right(pixels: np.ndarray) -> None:
    """NumPy does not warn, and every direction is projected back to its pixel."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        model, count = (("radtan", int(rng.choice([4, 5, 8]))), ("fisheye", 4))[rng.integers(2)]
        try:
            camera = camera_with(model, tuple(rng.normal(0, 10.0 ** rng.uniform(-3, 2), count)))
        except InputError:
            continue
        points = pixels * 3 - 100
        seen = camera.rays(points)
        known = np.isfinite(seen).all(axis=-1)
        np.testing.assert_allclose(camera.project(seen[known]), points[known], atol=1e-5)
    edge = Camera(400, 400, 100.0, distortion_model="fisheye", distortion=(0.0,) * 4)
    np.testing.assert_allclose(edge.project(np.array([1.0, 0.0, 0.0])), [199.5 + 50 * np.pi, 199.5])


def test_the_fisheye_is_inverted_where_newtons_method_swings() -> None:
    """Near the inflection of this polynomial, of a real lens profile, steps lead from one side to the other."""
    k = (0.2637886549359052, -0.3408966786255753, 1.079728890594674, -0.9412173670690532)
    points = np.stack([np.linspace(0.0, 1.28, 300), np.zeros(300)], axis=-1)
    np.testing.assert_allclose(lens.project(lens.rays(points, "fisheye", k), "fisheye", k), points, atol=1e-9)


@pytest.mark.parametrize("model", ["none", "radtan"])
def test_what_lies_behind_the_camera_is_not_seen(model):
    camera = Camera(540, 380, 500.0, distortion_model=model, distortion=() if model == "none" else (0.1, 0.0, 0.0, 0.0))
    assert np.isnan(camera.project([0.1, 0.1, -1.0])).all()
