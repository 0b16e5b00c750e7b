"""Laws of shrinking gradients, on the Numba kernel and on its NumPy twin."""

from __future__ import annotations

import numpy as np
import pytest

from rsdeblur.deconv.priors import shrinkage
from rsdeblur.kernels import shrink

TABLE = shrinkage(2 / 3)
# A few roundings of values up to 10.
FLOAT32 = 1e-5


@pytest.fixture(params=["numba", "numpy"])
def grad_adjoint(request):
    kernel = getattr(shrink, "shrunk_grad_adjoint" + ("" if request.param == "numba" else "_numpy"))

    def run(picture, threshold, *, table=TABLE, periodic=False, block=1000):
        out = np.full_like(picture, np.nan)
        for top in range(0, len(picture), block):
            rows = min(block, len(picture) - top)
            kernel(picture, top, rows, np.float32(threshold), table, periodic, out)
        return out

    return run


@pytest.fixture(params=[(19, 23, 3), (19, 23, 1), (1, 9, 3), (9, 1, 1), (2, 2, 2)])
def picture(request):
    return np.random.default_rng(0).random(request.param, dtype=np.float32)


@pytest.mark.parametrize("periodic", [False, True])
def test_what_is_not_shrunk_is_the_laplacian(grad_adjoint, picture, periodic):
    # Gradients that do not vanish are kept whole.
    out = grad_adjoint(picture, 1e-9, table=np.ones(2, np.float32), periodic=periodic)
    wide = np.pad(picture, ((1, 1), (1, 1), (0, 0)), mode="wrap" if periodic else "edge")
    expected = 4 * picture - wide[2:, 1:-1] - wide[:-2, 1:-1] - wide[1:-1, 2:] - wide[1:-1, :-2]
    np.testing.assert_allclose(out, expected, atol=FLOAT32)


@pytest.mark.parametrize("periodic", [False, True])
def test_pull_is_the_adjoint_applied_to_the_shrunk_gradient(grad_adjoint, picture, periodic):
    out = grad_adjoint(picture, 0.3, periodic=periodic)
    across, down = shrink.gradient(picture, periodic=periodic)
    magnitude = np.sqrt((across**2 + down**2).sum(axis=2, keepdims=True))
    kept = np.interp(0.3 / np.maximum(magnitude, 1e-9), np.linspace(0, 1, len(TABLE)), TABLE) * (magnitude > 0.3)
    other = np.random.default_rng(1).random(picture.shape)
    of_other = shrink.gradient(other, periodic=periodic)
    expected = sum((kept * part * with_part).sum() for part, with_part in zip((across, down), of_other, strict=True))
    assert (out * other).sum() == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("periodic", [False, True])
def test_blocks_of_rows_make_the_whole(grad_adjoint, picture, periodic):
    np.testing.assert_array_equal(
        grad_adjoint(picture, 0.3, periodic=periodic, block=4), grad_adjoint(picture, 0.3, periodic=periodic)
    )


def test_small_gradients_vanish(grad_adjoint, picture):
    np.testing.assert_array_equal(grad_adjoint(picture, 10.0), 0.0)


@pytest.mark.parametrize("periodic", [False, True])
def test_twins_agree(picture, periodic):
    fast, slow = np.empty_like(picture), np.empty_like(picture)
    shrink.shrunk_grad_adjoint(picture, 0, len(picture), np.float32(0.3), TABLE, periodic, fast)
    shrink.shrunk_grad_adjoint_numpy(picture, 0, len(picture), 0.3, TABLE, periodic, slow)
    np.testing.assert_allclose(fast, slow, atol=FLOAT32)
