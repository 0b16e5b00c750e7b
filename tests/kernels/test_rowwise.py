"""Laws of the rowwise kernels, on the C code and on its SciPy twin."""

from types import SimpleNamespace

import numpy as np
import pytest

from rsdeblur.kernels import native, rowwise, why_pure
from rsdeblur.kernels.rowwise import BLOCK, LANES, RowModel

needs_native = pytest.mark.skipif(native is None, reason=f"no C extension: {why_pure}")
SHIFTS, LENGTH = 12, 50


@pytest.fixture(params=[pytest.param("native", marks=needs_native), "numpy"])
def kernels(request):
    suffix = "" if request.param == "native" else "_numpy"
    names = ("forward", "adjoint", "solve", "workspace_size")
    return SimpleNamespace(**{name: getattr(rowwise, name + suffix) for name in names})


def random_model(rng, rows, tallest):
    """Return a model whose rows see 1 to `tallest` latent rows near their own position."""
    taps = [
        (y, first + n, int(rng.integers(SHIFTS)), rng.random() / tallest)
        for y in range(rows)
        for height in [int(rng.integers(1, tallest + 1))]
        for first in [y + int(rng.integers(tallest - height + 1))]
        for n in range(height)
        for _ in range(2)
    ]
    blocks = -(-(rows + tallest) // BLOCK)
    seen = [[y for y, latent, _, _ in taps if latent // BLOCK == b] for b in range(blocks)]
    first = [min(ys, default=0) for ys in seen]
    end = [max(ys, default=-1) + 1 for ys in seen]
    sees = [min(latent // BLOCK for y, latent, _, _ in taps if y == row) for row in range(rows)]
    coupled = [min([max(b - 1, 0), *sees[first[b] : end[b]]]) for b in range(blocks)]
    order = [
        [t for t in taps if t[0] == y and t[1] == latent]
        for latent in range(BLOCK * blocks)
        for y in range(first[latent // BLOCK], end[latent // BLOCK])
    ]
    start = np.cumsum([0, *map(len, order)])
    shift, weight = zip(*[(s, w) for pair in order for _, _, s, w in pair], strict=True)
    arrays = [np.array(values, dtype=np.int32) for values in (first, end, coupled, start, shift)]
    return RowModel._make([*arrays, np.array(weight, dtype=np.float32)]), taps


def case(rows=20, tallest=7, channels=3, seed=0):
    rng = np.random.default_rng(seed)
    model, taps = random_model(rng, rows, tallest)
    data, latent = (rng.uniform(-1, 1, (channels, n, 2, LANES)).astype(np.float32) for n in (rows, model.latents))
    table = rowwise.phase_table(1, -4, SHIFTS, LENGTH)
    return SimpleNamespace(model=model, taps=taps, data=data, latent=latent, table=table, rows=rows)


def workspace(kernels, c, solve):
    return np.empty(kernels.workspace_size(c.model, c.table, c.rows, solve), dtype=np.float32)


def dense(c):
    """Return the matrices A of all lanes, computed by definition, shape (16, H, L)."""
    matrices = np.zeros((LANES, c.rows, c.model.latents), dtype=complex)
    for y, latent, shift, weight in c.taps:
        matrices[:, y, latent] += weight * np.exp(-2j * np.pi * (LANES + np.arange(LANES)) * (shift - 4) / LENGTH)
    return matrices


def values(lanes):
    """Return lanes as complex numbers, shape (16, R, C)."""
    return np.moveaxis(lanes[:, :, 0] + 1j * lanes[:, :, 1].astype(complex), (0, 1, 2), (2, 1, 0))


def penalty(slope=0.0, bend=0.0):
    """Return weights (3, 16) that change from frequency to frequency."""
    ramp = np.linspace(0.5, 1.0, LANES, dtype=np.float32)
    return np.stack([np.float32(0.1) * ramp, np.float32(slope) * ramp, np.float32(bend) * ramp[::-1]])


def term(weights, n):
    """Return the matrices of a penalty, shape (16, n, n)."""
    d = np.diff(np.eye(n), axis=0)
    once = d.T @ d
    powers = np.stack([np.eye(n), once, once @ once])
    return np.einsum("kl,kij->lij", weights.astype(float), powers)


# Weights of the first and of the second differences.
PENALTIES = [(0.0, 0.0), (0.2, 0.1)]
# Numbers of channels below and above the block of three.
CASES = [(26, 9, 1), (7, 3, 4), (9, 1, 5)]


@pytest.mark.parametrize(("rows", "tallest", "channels"), CASES)
def test_forward_and_adjoint_are_the_matrix(kernels, rows, tallest, channels):
    c = case(rows, tallest, channels)
    blur, data, latent = dense(c), np.empty_like(c.data), np.empty_like(c.latent)
    kernels.forward(c.model, c.table, data, c.latent, workspace(kernels, c, False))
    kernels.adjoint(c.model, c.table, c.data, latent, workspace(kernels, c, False))
    # Sums of some dozen values below 1 in float32.
    np.testing.assert_allclose(values(data), blur @ values(c.latent), atol=2e-6)
    np.testing.assert_allclose(values(latent), blur.conj().swapaxes(1, 2) @ values(c.data), atol=2e-6)


@pytest.mark.parametrize(("rows", "tallest", "channels"), CASES)
@pytest.mark.parametrize(("slope", "bend"), PENALTIES)
def test_the_solution_is_that_of_the_normal_equations(kernels, rows, tallest, channels, slope, bend):
    c = case(rows, tallest, channels, seed=1)
    blur = dense(c)
    adjoint, weights, found = blur.conj().swapaxes(1, 2), penalty(slope, bend), c.latent.copy()
    kernels.solve(c.model, c.table, c.data, found, workspace(kernels, c, True), weights)
    matrix, above = adjoint @ blur + term(weights, c.model.latents), adjoint @ values(c.data) + values(c.latent)
    expected = np.linalg.solve(matrix, above)
    # Rounding 6e-8 times the condition number, at most (1 + 4 slope + 16 bend) / 0.05 = 70, times a few steps.
    np.testing.assert_allclose(values(found), expected, atol=2e-5 * np.abs(expected).max())
    if native and kernels.solve is rowwise.solve:
        # The same in two steps.
        space, above = workspace(kernels, c, True), c.latent.copy()
        normal = np.empty(rowwise.assembled_size(c.model, c.table, c.rows), dtype=np.float32)
        rowwise.assemble(c.model, c.table, normal, space, c.rows)
        rowwise.adjoint(c.model, c.table, c.data, again := np.empty_like(above), space)
        again += above
        rowwise.solve_assembled(c.model, c.table, normal, again, space, weights, c.rows)
        np.testing.assert_allclose(values(again), expected, atol=2e-5 * np.abs(expected).max())


@needs_native
def test_differences_need_coupled_neighbours():
    c = case(9, 1)
    model = c.model._replace(coupled=np.arange(len(c.model.coupled), dtype=np.int32))
    space = np.empty(native.rowwise_workspace(*model, c.table, c.rows, 1), np.float32)
    native.rowwise_solve(*model, c.table, c.data, c.latent, space, penalty())
    normal = np.zeros(native.rowwise_assembled_size(*model, c.table, c.rows), np.float32)
    native.rowwise_solve_assembled(*model, c.table, normal, c.latent, space, penalty(), c.rows)
    for weights in (penalty(0.1), penalty(0.0, 0.1)):
        with pytest.raises(ValueError, match="inconsistent"):
            native.rowwise_solve(*model, c.table, c.data, c.latent, space, weights)
        with pytest.raises(ValueError, match="inconsistent"):
            native.rowwise_solve_assembled(*model, c.table, normal, c.latent, space, weights, c.rows)
