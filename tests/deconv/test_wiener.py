"""The Deconvolver: against its equation, and the laws that tiling must not break."""

import numpy as np
import pytest

from rsdeblur import Deconvolver, InputError, PsfBank, scene

H, W = 90, 122
# Forward and inverse float32 transforms of values near 1, times a gain of at most 1 / (2 sqrt(nsr)) = 5.
FLOAT32 = 2e-5


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(7).random((H, W, 3), dtype=np.float32)


def random_kernels(*shape: int, seed: int = 1) -> np.ndarray:
    kernels = np.random.default_rng(seed).random(shape).astype(np.float32) ** 4
    return kernels / kernels.sum(axis=(-2, -1), keepdims=True)


def delta(*grid: int, size: tuple[int, int] = (5, 7)) -> np.ndarray:
    kernels = np.zeros((*grid, *size), dtype=np.float32)
    kernels[..., size[0] // 2, size[1] // 2] = 1.0
    return kernels


@pytest.mark.parametrize("nsr", [0.3, 0.01, 0.0005])
def test_global_is_the_wiener_equation(picture: np.ndarray, nsr: float) -> None:
    kernel = random_kernels(9, 13)
    result = Deconvolver(PsfBank.for_picture(kernel, picture.shape), picture.shape, nsr=nsr, border="periodic").apply(
        picture
    )
    placed = np.zeros((H, W))
    placed[:9, :13] = kernel
    otf = np.fft.fft2(np.roll(placed, (-4, -6), axis=(0, 1)))
    wiener = (1 + nsr) * otf.conj() / (np.abs(otf) ** 2 + nsr)
    expected = np.fft.ifft2(wiener[..., None] * np.fft.fft2(picture, axes=(0, 1)), axes=(0, 1)).real
    # The gain, and float32's error with it, grows like 1 / (2 sqrt(nsr)).
    np.testing.assert_allclose(result, expected, atol=2e-6 / nsr**0.5)


def test_same_kernel_everywhere_equals_global() -> None:
    """Tiles that share one kernel differ from the whole only by the fade in their margins."""
    picture = scene(150, 200)
    kernel = random_kernels(7, 9)
    whole, tiled = (
        Deconvolver(PsfBank.for_picture(np.broadcast_to(kernel, (*grid, 7, 9)), picture.shape), picture.shape).apply(
            picture
        )
        for grid in ((1, 1), (4, 3))
    )
    # Leave out three PSFs at the border, where the continuation differs: the opposite ends are nearer.
    inside = np.s_[27:-27, 27:-27]
    leak = np.sqrt(np.mean((tiled - whole)[inside] ** 2))
    # Across a margin of 1.3 decay lengths the filter's response still has some percent of its size;
    # measured 0.6 % of what the filter adds to the picture.
    assert leak < 0.02 * np.sqrt(np.mean((whole - picture)[inside] ** 2))


@pytest.mark.parametrize("grid", [(1, 1), (2, 3)])
def test_a_refused_picture_is_left_as_it_was(picture: np.ndarray, grid: tuple[int, int]) -> None:
    solver = Deconvolver(PsfBank.for_picture(delta(*grid), picture.shape), picture.shape)
    picture[40, 50, 1] = np.inf
    before = picture.copy()
    with pytest.raises(InputError, match="finite"):
        solver.apply(picture, out=picture)
    np.testing.assert_array_equal(picture, before)
