"""Only recorded pixels count: the solution does not explain what was guessed beyond the frame."""

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur import Camera, Exposure, PsfBank, deblur, deconvolve, scene
from rsdeblur.deconv.priors import TO_PICTURE
from rsdeblur.deconv.unknown_border import UnknownBorderQuadratic

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
def test_conjugate_gradients_lead_to_the_minimiser_of_the_recorded_pixels(beta: float) -> None:
    target = np.random.default_rng(3).random((*SHAPE, 2), dtype=np.float32)
    for seed in (1, 2):
        plan = solver()
        plan.prepare(guess(seed))
        # Each solution starts from the one before.
        for _ in range(40):
            found = plan.solve(beta, target.copy(), TO_PICTURE)
        for channel in range(2):
            expected = minimiser(guess(seed)[..., channel].astype(float), target[..., channel], beta)
            # Float32, and a condition of 1 / beta.
            np.testing.assert_allclose(found[..., channel], expected, atol=2e-3 if beta < 0.1 else 2e-4)


def test_what_is_consistent_stays_as_it_is() -> None:
    plan = solver(nsr=0.01)
    plan.prepare(np.full((*SHAPE, 2), 0.4, dtype=np.float32))
    np.testing.assert_allclose(plan.solve(0.1, None), 0.4, atol=1e-5)


@pytest.fixture(scope="module")
def blurred() -> tuple[np.ndarray, np.ndarray]:
    """Return a sharp picture and a blurred one with a little noise; the blur brings in light from beyond the frame."""
    wide = scene(110, 130)[..., 0]
    noise = np.random.default_rng(0).normal(0, 2e-3, wide.shape)
    inside = np.s_[15:-15, 15:-15]
    return wide[inside], (ndimage.convolve(wide, STREAK) + noise)[inside].astype(np.float32)


@pytest.mark.parametrize("prior", ["tv", "wavelet"])
def test_it_is_better_than_any_continuation(blurred: tuple[np.ndarray, np.ndarray], prior: str) -> None:
    sharp, picture = blurred

    def error(border: str) -> float:
        image = deconvolve(picture, STREAK, prior=prior, border=border).image
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
