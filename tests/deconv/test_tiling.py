"""Tiles, their OTFs, pictures made periodic, and borders that are left open."""

import numpy as np
import pytest
from scipy import ndimage

from benchmarks.paper.continuations import reflected, smooth, tapered
from rsdeblur import Camera, Exposure, PsfBank, deblur, deconvolve, scene
from rsdeblur.deconv.otf import OtfPlanner
from rsdeblur.deconv.priors import TO_PICTURE
from rsdeblur.deconv.tiling import Tiling, hat_weights
from rsdeblur.deconv.unknown_border import UnknownBorderQuadratic, extended
from rsdeblur.motion import BlurPaths
from rsdeblur.psf import tile_centres

N = 1000

# (centres, kernel, margin): even tiles, uneven ones, ones beyond the picture's ends, and one for each position.
CASES = {
    "one": (tile_centres(1, N), 9, 20),
    "two": (tile_centres(2, N), 9, 20),
    "many": (tile_centres(16, N), 31, 17),
    "uneven": (np.array([3.0, 100.2, 130.9, 700.0, 998.5]), 5, 0),
    "beyond": (np.array([-80.0, 300.0, 1100.0]), 7, 11),
    "dense": (tile_centres(N, N), 3, 6),
}


def rebuilt(tiling):
    total = np.zeros(N)
    for tile in tiling.tiles:
        total[tile.first : tile.first + len(tile.weights)] += tile.weights
    return total


@pytest.fixture(params=CASES)
def case(request):
    return CASES[request.param]


@pytest.mark.parametrize("periodic", [False, True])
def test_weights_sum_to_one_and_are_positive(case, periodic):
    tiling = Tiling.plan(case[0], N, *case[1:], periodic=periodic)
    assert len(tiling.tiles) == len(case[0])
    # Two float32 weights meet at a position.
    np.testing.assert_allclose(rebuilt(tiling), 1.0, rtol=0, atol=1e-6)
    for tile in tiling.tiles:
        assert tile.weights.min() > 0
        assert tile.weights.dtype == np.float32


@pytest.mark.parametrize("periodic", [False, True])
def test_a_tile_is_longer_than_its_part_by_a_margin_that_fades(case, periodic):
    centres, kernel, margin = case
    tiling = Tiling.plan(centres, N, kernel, margin, periodic=periodic)
    longest = max(len(tile.weights) for tile in tiling.tiles)
    for tile in tiling.tiles:
        assert tile.start <= tile.first
        # The fade at the tile's end lies beyond its part of the picture.
        assert tile.first + len(tile.weights) <= tile.start + tiling.length - tiling.taper
    if tiling.length < N:
        assert tiling.taper == tiling.length - longest >= margin


def test_weights_interpolate_linearly():
    centres = np.array([10.0, 14.0, 30.5])
    values = np.array([3.0, -1.0, 7.0])
    expected = np.interp(np.arange(50), centres, values)
    np.testing.assert_allclose(values @ hat_weights(centres, 50), expected, atol=1e-12)


CURVE = np.stack([5 * np.sin(np.linspace(0, 3, 60)), 4 * np.cos(np.linspace(1, 5, 60))], axis=-1)


def bank_of(path, places=1):
    paths = np.broadcast_to(path, (places, 1, *np.shape(path)))
    return PsfBank.from_paths(BlurPaths(paths, 10.0 + 20 * np.arange(places), np.array([30.0])))


@pytest.mark.parametrize("lengths", [(64, 48), (45, 63)])
@pytest.mark.parametrize("path", [CURVE, 0.05 * CURVE, [[0.5, 0.5], [0.5, 0.5]], [[-2.2, 0.0], [9.0, 7.7]]])
def test_otf_of_a_path_is_its_fourier_transform(path, lengths):
    found = OtfPlanner((41, 41), lengths).whole(bank_of(path), 0, 0)
    times = np.linspace(0, 1, 4001)
    x, y = (np.interp((times[1:] + times[:-1]) / 2, np.linspace(0, 1, len(path)), axis) for axis in np.transpose(path))
    # At the highest frequency of an even length, both signs are one.
    down, across = (
        np.where(np.abs(f) == 0.5, np.cos(np.pi * d)[:, None], np.exp(-2j * np.pi * np.outer(d, f)))
        for d, f in zip((y, x), map(np.fft.fftfreq, lengths), strict=True)
    )
    # Aliases of the window and rounding by float32.
    np.testing.assert_allclose(found, down.T @ across / len(x), rtol=0, atol=3e-4)
    assert found[0, 0] == pytest.approx(1, abs=1e-6)


def test_softness_is_a_gaussian():
    sharp = bank_of(CURVE)
    soft = PsfBank.from_paths(BlurPaths(sharp.displacements, sharp.rows, sharp.cols, softness=0.8))
    planner = OtfPlanner((41, 41), (64, 48))
    down, across = (np.exp(-2 * np.square(np.pi * 0.8 * np.fft.fftfreq(n))) for n in (64, 48))
    expected = planner.whole(sharp, 0, 0) * np.outer(down, across)
    # Rounding by float32.
    np.testing.assert_allclose(planner.whole(soft, 0, 0), expected, atol=1e-6)


@pytest.mark.parametrize("lengths", [(64, 48), (45, 63)])
def test_otf_of_a_kernel_is_its_transform(lengths):
    bank = PsfBank.for_picture(np.random.default_rng(0).dirichlet(np.ones(35)).reshape(5, 7), lengths)
    placed = np.zeros(lengths)
    placed[:5, :7] = bank.kernels[0, 0]
    expected = np.fft.fft2(np.roll(placed, (-2, -3), axis=(0, 1)))
    np.testing.assert_allclose(OtfPlanner(bank.size, lengths).whole(bank, 0, 0), expected, rtol=0, atol=1e-6)


H, W = 60, 85


@pytest.fixture
def light():
    return np.random.default_rng(0).random((H, W, 3), dtype=np.float32)


@pytest.fixture
def bank():
    kernels = np.random.default_rng(1).random((2, 2, 9, 15), dtype=np.float32)
    return PsfBank(kernels / kernels.sum(axis=(2, 3), keepdims=True), [20.0, 40.0], [20.0, 60.0])


def test_a_constant_stays_one(bank):
    flat = np.full((H, W, 1), 0.3, dtype=np.float32)
    for longer in (
        extended(flat, bank),
        smooth(flat, H + 3, W + 5),
        reflected(flat, H + 7, W + 4),
        tapered(flat, bank.kernels[0, 0]),
    ):
        np.testing.assert_allclose(longer, 0.3, atol=1e-6)


@pytest.mark.parametrize("shape", [(1, 40, 1), (40, 1, 1), (1, 1, 1)])
def test_lines_of_pixels_are_filled_too(shape):
    line = np.random.default_rng(0).random(shape, dtype=np.float32)
    longer = extended(line, PsfBank.for_picture(KERNEL, shape))
    np.testing.assert_array_equal(longer[: shape[0], : shape[1]], line)
    assert line.min() - 1e-6 <= longer.min()
    assert longer.max() <= line.max() + 1e-6


def test_the_smooth_filling_has_no_laplacian(light):
    longer = smooth(light, H + 11, W + 9).astype(np.float64)
    laplacian = sum(np.roll(longer, by, axis) for axis in (0, 1) for by in (-1, 1)) - 4 * longer
    # Not where two parts meet, and not along their straight sides: each part is harmonic on its own.
    for part in (np.s_[H:, 1 : W - 1], np.s_[1 : H - 1, W:], np.s_[H + 1 : -1, W + 1 : -1]):
        np.testing.assert_allclose(laplacian[part], 0, atol=1e-5)
    # A harmonic function stays within the range of its border.
    assert light.min() - 1e-6 <= longer.min()
    assert longer.max() <= light.max() + 1e-6


def test_the_filling_leads_straight_from_end_to_start(light, bank):
    longer = extended(light, bank)
    np.testing.assert_array_equal(longer[:H, :W], light)
    np.testing.assert_allclose(np.diff(longer[H - 1 :], n=2, axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(np.diff(longer[:, W - 1 :], n=2, axis=1), 0, atol=1e-6)
    repeats = longer[-1] + (longer[-1] - longer[-2])
    np.testing.assert_allclose(repeats, longer[0], atol=1e-5)


# Rows and columns of a picture that repeats, and those of them that were recorded.
SHAPE, RECORDED = (18, 20), (12, 13)
KERNEL = np.random.default_rng(0).random((5, 7)) / 17.5
KERNEL /= KERNEL.sum()
# A straight blur, which loses whole frequencies.
STREAK = np.eye(15) / 15


def solver(threads: int | None = None, nsr: float = 0.0) -> UnknownBorderQuadratic:
    bank = PsfBank.for_picture(KERNEL, SHAPE)
    return UnknownBorderQuadratic(bank, (*SHAPE, 2), recorded=RECORDED, nsr=nsr, threads=threads)


def guess(seed: int) -> np.ndarray:
    """Return a picture whose recorded part does not depend on the seed."""
    picture = np.random.default_rng(seed).random((*SHAPE, 2), dtype=np.float32)
    picture[: RECORDED[0], : RECORDED[1]] = np.random.default_rng(9).random((*RECORDED, 2), dtype=np.float32)
    return picture


def minimiser(picture: np.ndarray, target: np.ndarray, beta: float) -> np.ndarray:
    """Return the minimiser of `|M (A u - g)|^2 + beta |u - v|^2` of one channel by dense matrices."""
    pixels = np.eye(picture.size).reshape(-1, *SHAPE)
    # Kernels are centred, and light moves by the kernel's offsets: a convolution.
    blur = np.array([ndimage.convolve(pixel, KERNEL, mode="wrap").ravel() for pixel in pixels]).T
    mask = np.zeros(SHAPE, dtype=bool)
    mask[: RECORDED[0], : RECORDED[1]] = True
    seen = blur[mask.ravel()]
    normal = seen.T @ seen + beta * np.eye(picture.size)
    return np.linalg.solve(normal, seen.T @ picture[mask] + beta * target.ravel()).reshape(SHAPE)


@pytest.mark.parametrize("beta", [0.01, 0.3])
def test_solves_lead_to_the_minimiser_of_the_recorded_pixels(beta: float) -> None:
    target = np.random.default_rng(3).random((*SHAPE, 2), dtype=np.float32)
    for seed in (1, 2):
        plan = solver()
        plan.observe(0, guess(seed))
        # Each solution starts from the one before.
        for _ in range(80):
            found = plan.solve(beta, target.copy(), TO_PICTURE)
        for channel in range(2):
            expected = minimiser(guess(seed)[..., channel].astype(float), target[..., channel], beta)
            # Float32, and a condition of 1 / beta.
            np.testing.assert_allclose(found[..., channel], expected, atol=2e-3 if beta < 0.1 else 2e-4)


def test_what_is_consistent_stays_as_it_is() -> None:
    plan = solver(nsr=0.01)
    plan.observe(0, np.full((*SHAPE, 2), 0.4, dtype=np.float32))
    np.testing.assert_allclose(plan.solve(0.1, None), 0.4, atol=1e-5)


@pytest.fixture(scope="module")
def blurred() -> tuple[np.ndarray, np.ndarray]:
    """Return a sharp picture and a blurred one with a little noise; the blur brings in light from beyond the frame."""
    wide = scene(110, 130)[..., 0]
    noise = np.random.default_rng(0).normal(0, 2e-3, wide.shape)
    inside = np.s_[15:-15, 15:-15]
    return wide[inside], (ndimage.convolve(wide, STREAK) + noise)[inside].astype(np.float32)


def test_it_is_better_than_any_continuation(blurred: tuple[np.ndarray, np.ndarray]) -> None:
    sharp, picture = blurred

    def error(border: str) -> float:
        image = deconvolve(picture, STREAK, prior="tv", border=border).image
        return float(np.sqrt(np.mean(np.square(image - sharp))))

    assert error("unknown") < min(map(error, ("blend", "periodic")))


def test_own_psfs_leave_the_border_open_where_they_can(blurred: tuple[np.ndarray, np.ndarray]) -> None:
    picture = blurred[1]
    for border, options in (
        ("unknown", {"prior": "tv"}),
        ("unknown", {"quality": "best"}),
        ("blend", {"prior": "wiener"}),
        ("blend", {"prior": "tv", "max_memory": 10**9}),
    ):
        result = deconvolve(picture, STREAK, **options)
        np.testing.assert_array_equal(result.image, deconvolve(picture, STREAK, **options, border=border).image)


def test_a_motion_blends_borders() -> None:
    from rsdeblur.simulation.shake import hand_shake

    log, camera, exposure = hand_shake(0.2, seed=3), Camera(96, 80, 110.0, readout_time=0.03), Exposure(0.05, 1 / 30)
    picture = scene(80, 96)
    images = [deblur(picture, log, camera, exposure, prior="tv", border=each).image for each in ("auto", "blend")]
    np.testing.assert_array_equal(*images)
    other = deblur(picture, log, camera, exposure, prior="tv", border="unknown")
    assert np.isfinite(other.image).all()
    assert not np.array_equal(other.image, images[0])
