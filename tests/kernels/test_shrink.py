"""Laws of shrinking derivatives, on the C kernels, which equal their NumPy twins."""

import numpy as np
import pytest

from rsdeblur.deconv.priors import TO_DERIVATIVES, shrinkage
from rsdeblur.kernels import shrink

POLYNOMIAL = shrinkage(2 / 3)
# Vectors that do not vanish are kept whole.
ONE = np.eye(shrink.TERMS, dtype=np.float32)[0]
# A few roundings of values up to 10.
FLOAT32 = 1e-5


KERNELS = ("shrunk_grad_adjoint", "shrunk_derivatives_adjoint")


def in_blocks(kernel):
    def run(picture, threshold, *, polynomial=POLYNOMIAL, periodic=False, block=1000):
        out, memory = np.full_like(picture, np.nan), np.full_like(shrink.workspace(picture), np.nan)
        for top in range(0, len(picture), block):
            rows = min(block, len(picture) - top)
            kernel(picture, top, rows, np.float32(threshold), polynomial, periodic, memory, out)
        return out

    return run


grad_adjoint, derivatives_adjoint = (in_blocks(getattr(shrink, name)) for name in KERNELS)


@pytest.fixture(params=KERNELS)
def either(request):
    return in_blocks(getattr(shrink, request.param))


# The last two are wider than the runs of values that the kernel omits where all vanish, with detail at their ends.
@pytest.fixture(params=[(19, 23, 3), (1, 9, 1), (12, 150, 1), (12, 150, 3)], ids=str)
def picture(request):
    picture = np.random.default_rng(0).random(request.param, dtype=np.float32)
    if picture.shape[1] == 150:
        picture[:, np.delete(np.arange(150), [0, 31, 64, 149])] = 0.5
    return picture


def laplacian(picture, periodic):
    """Return D^T D times a picture."""
    wide = np.pad(picture, ((1, 1), (1, 1), (0, 0)), mode="wrap" if periodic else "edge")
    return 4 * picture - wide[2:, 1:-1] - wide[:-2, 1:-1] - wide[1:-1, 2:] - wide[1:-1, :-2]


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("sign", [-1, 1])
def test_values_that_are_no_numbers_are_not_hidden(either, channels, sign):
    picture = np.zeros((5, 150, channels), np.float32)
    picture[2, 70] = np.copysign(np.nan, sign)
    assert np.isnan(either(picture, 0.2)).any()


@pytest.mark.parametrize("periodic", [False, True])
def test_derivatives_that_are_not_shrunk_make_the_term_that_solvers_add(picture, periodic):
    # Also at the ends: solvers know D^T D only.
    out = derivatives_adjoint(picture, 1e-9, polynomial=ONE, periodic=periodic)
    _, gradient, bend = TO_DERIVATIVES
    once = laplacian(picture, periodic)
    expected = gradient * once + bend * laplacian(once, periodic)
    np.testing.assert_allclose(out, expected, atol=FLOAT32)


@pytest.mark.parametrize("periodic", [False, True])
def test_blocks_of_rows_make_the_whole(either, picture, periodic):
    np.testing.assert_array_equal(
        either(picture, 0.3, periodic=periodic, block=4), either(picture, 0.3, periodic=periodic)
    )


def test_small_derivatives_vanish(either, picture):
    np.testing.assert_array_equal(either(picture, 10.0), 0.0)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("name", KERNELS)
def test_twins_agree(name, picture, periodic):
    fast, slow = (in_blocks(getattr(shrink, name + twin))(picture, 0.3, periodic=periodic) for twin in ("", "_numpy"))
    np.testing.assert_allclose(fast, slow, atol=FLOAT32)
