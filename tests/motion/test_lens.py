"""Laws of the lens: projection and rays are inverse, OpenCV agrees, and blur is computed and undone through it."""

import numpy as np
import pytest

from rsdeblur import Camera, InputError
from rsdeblur.motion import lens
from tests.installed import needs

WIDTH, HEIGHT = 192, 160
LENSES = {
    "radtan": ("radtan", (-0.28, 0.07, 0.002, -0.003)),
    "radtan 5": ("radtan", (-0.3, 0.12, 0.001, 0.002, -0.02)),
    "rational": ("radtan", (0.2, -0.1, 0.001, 0.002, 0.01, 0.1, 0.02, 0.01)),
    "fisheye": ("fisheye", (0.05, -0.02, 0.01, -0.003)),
    "none": ("none", ()),
}
MODELS = pytest.mark.parametrize(("model", "k"), LENSES.values(), ids=LENSES)


def camera_of(model: str, k: tuple[float, ...], **changes: object) -> Camera:
    return Camera(WIDTH, HEIGHT, (150.0, 155.0), (93.0, 82.0), distortion_model=model, distortion=k, **changes)


@pytest.fixture(scope="module")
def pixels() -> np.ndarray:
    return np.stack(np.meshgrid(np.linspace(0, WIDTH - 1, 23), np.linspace(0, HEIGHT - 1, 17)), axis=-1)


class TestInverse:
    @MODELS
    def test_rays_are_projected_back(self, model, k, pixels):
        camera = camera_of(model, k)
        # Newton's method stops at 1e-13 in normalised coordinates.
        np.testing.assert_allclose(camera.project(camera.rays(pixels)), pixels, atol=1e-9)

    def test_a_fisheye_sees_behind_its_plane(self):
        camera = Camera(400, 400, 100.0, distortion_model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0))
        direction = camera.rays(np.array([[199.5 + 100 * 1.8, 199.5]]))
        np.testing.assert_allclose(direction, [[np.sin(1.8), 0.0, np.cos(1.8)]], atol=1e-12)
        np.testing.assert_allclose(camera.project(direction), [[199.5 + 180, 199.5]], atol=1e-9)

    def test_beyond_the_reach_there_is_no_direction(self):
        # r - 0.1 r^3 rises to 1.217 at most
        camera = camera_of("radtan", (-0.1, 0.0, 0.0, 0.0))
        radius = np.array([[1.21], [1.22]])
        seen = camera.rays(radius * (150.0, 0.0) + camera.principal_point)
        assert np.isnan(seen).all(axis=-1).tolist() == [False, False]
        assert np.isnan(seen[..., :2]).all(axis=-1).tolist() == [False, True]


@MODELS
def test_opencv_projects_alike(model, k, pixels):
    cv2 = needs("bench")
    camera = camera_of(model, k)
    directions = np.ascontiguousarray(camera.rays(pixels).reshape(-1, 1, 3))
    zero, coefficients = np.zeros(3), np.array(k or (0.0,) * 4)
    if model == "fisheye":
        points, _ = cv2.fisheye.projectPoints(directions, zero, zero, camera.matrix, coefficients)
    else:
        points, _ = cv2.projectPoints(directions, zero, zero, camera.matrix, coefficients)
    np.testing.assert_allclose(points.reshape(pixels.shape), pixels, atol=1e-8)


def test_wild_coefficients_are_refused_or_right(pixels: np.ndarray) -> None:
    """NumPy does not warn, and every direction is projected back to its pixel."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        model, count = (("radtan", int(rng.choice([4, 5, 8]))), ("fisheye", 4))[rng.integers(2)]
        try:
            camera = camera_of(model, tuple(rng.normal(0, 10.0 ** rng.uniform(-3, 2), count)))
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
