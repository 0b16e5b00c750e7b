"""Priors on the gradient: the shrinkage, the quadratic problem of tiles, and the splitting."""

import numpy as np
import pytest
from scipy import ndimage

from rsdeblur import PsfBank, scene
from rsdeblur.deconv import DerivativePrior, TileQuadratic
from rsdeblur.deconv.priors import (
    KINDS,
    PENALTIES,
    TO_GRADIENT,
    TO_PICTURE,
    brightness,
    extrapolate,
    shrinkage,
    threshold,
)
from rsdeblur.kernels.shrink import gradient

H, W = 90, 122
NSR = 0.003
NOISE = 0.01


def restore(solver, picture, *, prior, weight, exponent=2 / 3, progress=None):
    return solver.apply(picture, prior=DerivativePrior(prior, weight, exponent), progress=progress)


def kernel() -> np.ndarray:
    values = np.random.default_rng(1).random((7, 11)).astype(np.float32) ** 4
    return values / values.sum()


def otf() -> np.ndarray:
    placed = np.zeros((H, W))
    placed[:7, :11] = kernel()
    return np.fft.fft2(np.roll(placed, (-3, -5), axis=(0, 1)))[:, :, None]


def blur(picture: np.ndarray) -> np.ndarray:
    return np.fft.ifft2(otf() * np.fft.fft2(picture, axes=(0, 1)), axes=(0, 1)).real


@pytest.fixture(scope="module")
def sharp() -> np.ndarray:
    # Enlarged twofold: unlike drawings, photographs have little detail at the scale of single pixels.
    return ndimage.zoom(scene(64, 64), (2, 2, 1), order=1)[:H, :W]


@pytest.fixture(scope="module")
def blurred(sharp: np.ndarray) -> np.ndarray:
    noise = np.random.default_rng(2).normal(0, NOISE, sharp.shape)
    return (blur(sharp) + noise).astype(np.float32)


def solver(*, kernels: np.ndarray | None = None, border: str = "periodic", nsr: float = NSR, threads: int = 1):
    bank = PsfBank.for_picture(kernel() if kernels is None else kernels, (H, W))
    return TileQuadratic(bank, (H, W, 3), nsr=nsr, border=border, threads=threads)


def grad_adjoint_of(across: np.ndarray, down: np.ndarray) -> np.ndarray:
    return (np.roll(across, 1, 1) - across + np.roll(down, 1, 0) - down).astype(np.float32)


@pytest.mark.parametrize("exponent", [0.1, 0.5, 2 / 3, 0.9, 1.0])
def test_shrinkage_minimises(exponent: float) -> None:
    least, polynomial = threshold(exponent), shrinkage(exponent)
    w = np.linspace(0, 1, 200_001)
    for t in least * np.array([0.5, 0.999, 1.001, 1.1, 2.0, 30.0]):
        kept = np.polynomial.polynomial.polyval(2 * least / t - 1, polynomial) if t > least else 0.0
        best = w[((w * t) ** exponent + (w * t - t) ** 2).argmin()]
        # 1e-5 of the grid, and the polynomial's error: 3e-4 up to 2/3, and less than 1e-3 at 0.9.
        assert kept == pytest.approx(best, abs=5e-4 if exponent < 0.7 else 1.2e-3)


@pytest.mark.parametrize("beta", [0.003, 3.0])
@pytest.mark.parametrize("coupling", [TO_GRADIENT, TO_PICTURE])
def test_global_is_the_equation(blurred: np.ndarray, beta: float, coupling: tuple[float, ...]) -> None:
    target = np.random.default_rng(4).normal(0, 0.1, (2, H, W, 3))
    grad_adjoint = grad_adjoint_of(*target)
    own = solver()
    own.observe(0, blurred)
    y, x = np.fft.fftfreq(H)[:, None, None], np.fft.fftfreq(W)[:, None]
    picture, slope, _ = coupling
    differences = picture + slope * (4 * np.sin(np.pi * y) ** 2 + 4 * np.sin(np.pi * x) ** 2)
    above = (1 + NSR) * otf().conj() * np.fft.fft2(blurred, axes=(0, 1)) + beta * np.fft.fft2(grad_adjoint, axes=(0, 1))
    normal = np.abs(otf()) ** 2 + NSR + beta * differences
    expected = np.fft.ifft2(above / normal, axes=(0, 1)).real
    # float32 transforms, times a gain of at most 1 / (2 sqrt(nsr)) = 9.
    np.testing.assert_allclose(own.solve(beta, grad_adjoint.copy(), coupling), expected, atol=5e-5)


def gradient_penalty(picture: np.ndarray, exponent: float) -> float:
    across, down = gradient(picture, periodic=True)
    return float((np.sqrt((across**2 + down**2).sum(axis=2)) ** exponent).sum())


def derivatives_penalty(picture: np.ndarray, exponent: float) -> float:
    across, down = gradient(picture, periodic=True)
    bends = (np.roll(part, 1, axis) - part for part, axis in ((across, 1), (down, 0)))
    twist = gradient(down, periodic=True)[0]
    derivatives = (across, down, *(bend / 2 for bend in bends), twist / np.sqrt(2))
    return float(sum((np.sqrt((part**2).sum(axis=2)) ** exponent).sum() for part in derivatives)) / 2


@pytest.mark.parametrize(
    ("kind", "exponent"), [("tv", 1.0), *(("hyper-laplacian", exponent) for exponent in (0.5, 2 / 3, 1.0))]
)
def test_the_splitting_descends(blurred: np.ndarray, kind: str, exponent: float) -> None:
    prior, weight = DerivativePrior(kind, 0.002, exponent), 0.002
    coupling, penalty = KINDS[kind].coupling, gradient_penalty if kind == "tv" else derivatives_penalty
    own = solver(nsr=0.0)
    own.observe(0, blurred)

    def objective(picture: np.ndarray) -> float:
        return float(((blur(picture) - blurred) ** 2).sum() + weight * penalty(picture, exponent))

    before = objective(own.solve(weight * PENALTIES[0], None, coupling))
    changes = []
    for latent, change in prior.steps(own, threads=1):
        now = objective(latent)
        assert now < before
        before = now
        changes.append(change)
    assert len(changes) == len(PENALTIES)
    # Measured: 0.4 to 0.8 of the first change.
    assert changes[-1] < changes[1]


def test_second_derivatives_restore_slopes() -> None:
    # Total variation makes steps of a noisy slope.
    ramp = np.broadcast_to(np.linspace(0.1, 0.9, W)[None, :, None], (H, W, 3))
    noisy = (ramp + np.random.default_rng(6).normal(0, NOISE, ramp.shape)).astype(np.float32)
    point = np.zeros((3, 3), np.float32)
    point[1, 1] = 1.0
    own = solver(kernels=point, border="blend", nsr=0.0)

    def error(prior: str) -> float:
        restored = [restore(own, noisy, prior=prior, weight=weight, exponent=1.0) for weight in (0.005, 0.02, 0.08)]
        return min(float(np.abs(picture - ramp)[8:-8, 8:-8].mean()) for picture in restored)

    assert error("hyper-laplacian") < error("tv")


def test_a_settled_picture_stops_early() -> None:
    flat = np.full((H, W, 3), 0.4, dtype=np.float32)
    fractions: list[float] = []
    result = restore(solver(), flat, prior="tv", weight=0.01, progress=fractions.append)
    np.testing.assert_allclose(result, flat, atol=1e-5)
    assert fractions == [1 / len(PENALTIES), 2 / len(PENALTIES), 1.0]


def test_gradients_that_all_vanish_stop_nothing() -> None:
    # A weak prior, but a penalty so small against the peak that no gradient of the noise survives the first shrinkages.
    noise = np.random.default_rng(5).normal(0.4, 0.01, (H, W, 3)).astype(np.float32)
    fractions: list[float] = []
    result = restore(solver(), noise, prior="hyper-laplacian", weight=0.001, progress=fractions.append)
    assert len(fractions) > 2
    first = solver()
    first.observe(0, noise)
    # The first solve alone amplifies the noise.
    assert result.std() < first.solve(0.001 * PENALTIES[0]).std() / 2


def test_the_peak_is_that_of_the_picture(blurred: np.ndarray) -> None:
    prior = DerivativePrior("hyper-laplacian", 0.01)
    dim, bright = 0.1 * blurred, DerivativePrior("hyper-laplacian", 0.01, peak=brightness(0.1 * blurred))
    np.testing.assert_array_equal(solver().apply(dim, prior=prior), solver().apply(dim, prior=bright))
    full = DerivativePrior("hyper-laplacian", 0.01, peak=1.0)
    assert np.abs(solver().apply(dim, prior=prior) - solver().apply(dim, prior=full)).max() > 1e-3


def test_a_step_ahead_of_a_straight_line_stays_on_it() -> None:
    step = np.arange(3 * W * H, dtype=np.float32).reshape(H, W, 3) / (W * H)
    first, second = np.ones_like(step), 1 + step
    change = extrapolate(first, second, np.float32(0.5), threads=2)
    # Rounding of float32.
    np.testing.assert_allclose(first, 1 + 1.5 * step, rtol=1e-6)
    assert change == pytest.approx(np.linalg.norm(step) / np.linalg.norm(second), rel=1e-5)
