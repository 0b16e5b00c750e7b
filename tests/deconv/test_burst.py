"""Several pictures of one scene solved together."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur import Camera, Deconvolver, Exposure, PsfBank, hand_shake
from rsdeblur.choices import Solver
from rsdeblur.deconv import DerivativePrior, RowDeconvolver, TileQuadratic
from rsdeblur.deconv.burst import BurstQuadratic, RowBurst
from rsdeblur.deconv.priors import LatentPrior
from rsdeblur.deconv.rowwise_blur import RowBlur
from rsdeblur.deconv.wiener import TileBlur
from rsdeblur.motion import BlurPaths
from rsdeblur.motion.alignment import Alignment, burst_captures
from rsdeblur.simulation.scene import scene

SHAPE = 96, 112, 3
TV = DerivativePrior("tv", 2e-3)


def bar(down: int, across: int) -> PsfBank:
    """Bars of one length, upright in the upper half of the picture and flat in the lower half."""
    kernels = np.zeros((2, 1, 9, 9))
    kernels[0, 0, 4 - down : 5 + down, 4] = 1 / (2 * down + 1)
    kernels[1, 0, 4, 4 - across : 5 + across] = 1 / (2 * across + 1)
    return PsfBank.for_picture(kernels, SHAPE)


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    return scene(*SHAPE[:2]).astype(np.float32)


@pytest.mark.parametrize("wiener", [True, False])
def test_one_frame_is_the_solver_of_one_picture(picture: np.ndarray, wiener: bool) -> None:
    bank = bar(3, 4)
    burst = BurstQuadratic([bank], [1.0], SHAPE, nsr=0.01, wiener=wiener)
    if wiener:
        expected, got = Deconvolver(bank, SHAPE, nsr=0.01).apply(picture), burst.apply([picture])
    else:
        expected = TileQuadratic(bank, SHAPE, nsr=0.01).apply(picture, prior=TV)
        got = burst.apply([picture], prior=TV)
    # float32, and the order of a few operations.
    np.testing.assert_allclose(got, expected, atol=2e-5)


def test_equal_frames_are_one_and_their_order_is_free(picture: np.ndarray) -> None:
    bank, other = bar(3, 4), bar(1, 2)
    once = BurstQuadratic([bank, other], [0.5, 0.5], SHAPE).apply([picture, picture], prior=TV)
    twice = BurstQuadratic([bank, bank, other], [0.25, 0.25, 0.5], SHAPE).apply([picture] * 3, prior=TV)
    np.testing.assert_allclose(twice, once, atol=2e-5)
    turned = BurstQuadratic([other, bank], [0.5, 0.5], SHAPE).apply([picture, picture], prior=TV)
    np.testing.assert_allclose(turned, once, atol=2e-5)


def test_frames_restore_what_each_has_lost(picture: np.ndarray) -> None:
    banks = [bar(4, 1), bar(1, 4)]
    blurred = [TileBlur(bank, SHAPE).forward(picture) for bank in banks]
    rng = np.random.default_rng(1)
    noisy = [light + rng.normal(0, 0.01, SHAPE).astype(np.float32) for light in blurred]
    solver = BurstQuadratic(banks, [0.5, 0.5], SHAPE, nsr=0.01, wiener=True)
    inner = np.s_[12:-12, 12:-12]

    def error(result: np.ndarray) -> float:
        return float(np.square(result - picture)[inner].mean())

    alone = [error(Deconvolver(b, SHAPE, nsr=0.01).apply(g)) for b, g in zip(banks, noisy, strict=True)]
    # Noise alone would give half; what one bar has lost, the other has kept.
    assert error(solver.apply(noisy)) < 0.5 * min(alone)


@pytest.fixture(scope="module")
def paths() -> list[BlurPaths]:
    """Paths of every row of two frames, bent differently."""
    log, camera = hand_shake(0.5, seed=4), Camera(112, 96, 130.0, readout_time=0.02)
    captures = burst_captures(log, camera, [Exposure(0.1, 1 / 20), Exposure(0.2, 1 / 25)])
    rows, cols = np.arange(96.0), np.array([27.0, 83.0])
    return [Alignment(capture, captures[0]).paths(rows, cols) for capture in captures]


@pytest.mark.parametrize("solver", ["direct", "cg"])
@pytest.mark.parametrize("prior", [None, DerivativePrior("gradient", 1e-2)], ids=["wiener", "gradient"])
def test_rowwise_frames_add_up(picture: np.ndarray, paths: list[BlurPaths], solver: Solver, prior: LatentPrior) -> None:
    single = RowDeconvolver(paths[0], SHAPE, solver=solver).apply(picture, prior=prior)
    once = RowBurst(paths[:1], [1.0], SHAPE, solver=solver).apply([picture], prior=prior)
    np.testing.assert_array_equal(once, single)
    # float32 and, for conjugate gradients, the tolerance of the residual.
    twice = RowBurst([paths[0], paths[0]], [0.25, 0.75], SHAPE, solver=solver).apply([picture, picture], prior=prior)
    np.testing.assert_allclose(twice, single, atol=2e-4 if solver == "direct" else 2e-2)


def test_what_the_steps_keep_changes_nothing(
    picture: np.ndarray, paths: list[BlurPaths], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is no room for the normal matrices, they are computed anew in every step."""
    solver = RowBurst(paths, [0.5, 0.5], SHAPE, solver="direct")
    kept = solver.apply([picture, picture], prior=TV)
    for room in (0, 4 * solver._assembled_sizes[0]):
        monkeypatch.setattr("rsdeblur.deconv.rowwise_solver.ASSEMBLED_BYTES", room)
        # Sums are taken in another order.
        np.testing.assert_allclose(solver.apply([picture, picture], prior=TV), kept, atol=2e-5)


def test_rowwise_frames_restore_what_each_has_lost(picture: np.ndarray, paths: list[BlurPaths]) -> None:
    solver, rng, noisy = RowBurst(paths, [0.5, 0.5], SHAPE, nsr=0.003), np.random.default_rng(1), []
    for path in paths:
        blur = RowBlur(path, SHAPE[1], channels=SHAPE[2])
        below = blur.latent_shape[0] + blur.top - SHAPE[0]
        blurred = blur.forward(np.pad(picture, ((-blur.top, below), (0, 0), (0, 0)), mode="reflect"))
        noisy.append(blurred + rng.normal(0, 0.01, SHAPE).astype(np.float32))
    inner = np.s_[12:-12, 12:-12]

    def error(result: np.ndarray) -> float:
        return float(np.square(result - picture)[inner].mean())

    alone = [error(RowDeconvolver(p, SHAPE, nsr=0.003).apply(g)) for p, g in zip(paths, noisy, strict=True)]
    assert error(solver.apply(noisy)) < 0.6 * min(alone)
