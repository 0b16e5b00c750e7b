"""OTFs of tiles: of kernels and of paths."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import Deconvolver, PsfBank
from rsdeblur.deconv.otf import OtfPlanner
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.motion import BlurPaths

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


def test_whole_pixels_shift_a_picture():
    picture = np.random.default_rng(0).random((40, 60), dtype=np.float32)
    blur = TileBlur(bank_of([[3.0, -2.0], [3.0, -2.0]]), picture.shape, border="periodic")
    # Float32, with a window whose spectrum varies by a factor of 1000.
    np.testing.assert_allclose(blur.forward(picture), np.roll(picture, (-2, 3), axis=(0, 1)), atol=1e-3)


def test_a_still_path_is_the_identity_at_any_nsr():
    picture = np.random.default_rng(0).random((50, 60), dtype=np.float32)
    result = Deconvolver(bank_of(np.zeros((3, 2)), places=2), picture.shape, nsr=0.05).apply(picture)
    np.testing.assert_allclose(result, picture, atol=1e-4)
