"""Several pictures of one scene solved together."""

import numpy as np
import pytest

from rsdeblur import Camera, Deconvolver, Exposure, PsfBank, hand_shake, scene
from rsdeblur.choices import Solver
from rsdeblur.deconv import DerivativePrior, RowDeconvolver, TileQuadratic
from rsdeblur.deconv.burst import BurstQuadratic, RowBurst
from rsdeblur.deconv.priors import LatentPrior
from rsdeblur.motion import BlurPaths
from rsdeblur.motion.alignment import Alignment, burst_captures

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
