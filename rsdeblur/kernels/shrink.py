"""Shrinkage of a picture's derivatives, the C kernels and their NumPy twins.

D takes forward differences. Beyond the last row and column they are zero or, if `periodic`, wrap around. All channels
of a pixel are one vector, which is shortened as a whole: vectors up to a threshold vanish, and of others the share

    sum_k polynomial[k] (2 threshold / magnitude - 1)^k

is left.
"""

from collections.abc import Callable

import numpy as np

from rsdeblur.kernels import native
from rsdeblur.types import Float32Array

# Number of coefficients of the polynomial.
TERMS = 9
# Rows of a picture on which a row of the output depends, on each side.
REACH = 2


def workspace(picture: Float32Array) -> Float32Array:
    """Return memory that one thread at a time needs to shrink the derivatives of a picture (H, W, C)."""
    _, width, channels = picture.shape
    return np.empty((10, channels, width + 2), np.float32)


def gradient(picture: Float32Array, *, periodic: bool) -> tuple[Float32Array, Float32Array]:
    """Return the forward differences across and down, both shaped like `picture` (H, W, C)."""
    across, down = (np.roll(picture, -1, axis) - picture for axis in (1, 0))
    if not periodic:
        across[:, -1] = 0
        down[-1] = 0
    return across, down


def _adjoint(differences: Float32Array, axis: int) -> Float32Array:
    """Return D^T times the differences along an axis; without wrapping around, the last ones are zero."""
    result: Float32Array = np.roll(differences, 1, axis) - differences
    return result


def _shrunk(threshold: np.float32, polynomial: Float32Array, *parts: Float32Array) -> list[Float32Array]:
    """Return the parts of vectors, over all channels, shortened."""
    magnitude = np.sqrt(sum((part**2).sum(axis=2, keepdims=True) for part in parts))
    places = 2 * threshold / np.maximum(magnitude, threshold) - 1
    factors = np.where(magnitude > threshold, np.polynomial.polynomial.polyval(places, polynomial), 0.0)
    return [(factors * part).astype(np.float32) for part in parts]


def _near(picture: Float32Array, top: int, rows: int, periodic: bool) -> tuple[Float32Array, slice]:
    """Return the rows on which `rows` rows from `top` on depend, and where these are among them."""
    if periodic:
        return picture[np.arange(top - REACH, top + rows + REACH) % len(picture)], slice(REACH, REACH + rows)
    first = max(top - REACH, 0)
    return picture[first : top + rows + REACH], slice(top - first, top - first + rows)


def shrunk_grad_adjoint_numpy(
    picture: Float32Array,
    top: int,
    rows: int,
    threshold: np.float32,
    polynomial: Float32Array,
    periodic: bool,
    workspace: Float32Array,
    out: Float32Array,
) -> None:
    """Compute `D^T w`, where w is the shrunk gradient of `picture`; both directions of a pixel are one vector.

    Of `picture` and `out`, (H, W, C) and C-contiguous, the `rows` from `top` on count. Gradients up to `threshold`
    become 0; `polynomial` (TERMS,) is the share that is left of others. `workspace` is overwritten, see
    :func:`workspace`.
    """
    near, own = _near(picture, top, rows, periodic)
    across, down = _shrunk(threshold, polynomial, *gradient(near, periodic=periodic))
    out[top : top + rows] = (_adjoint(across, 1) + _adjoint(down, 0))[own]


def shrunk_derivatives_adjoint_numpy(
    picture: Float32Array,
    top: int,
    rows: int,
    threshold: np.float32,
    polynomial: Float32Array,
    periodic: bool,
    workspace: Float32Array,
    out: Float32Array,
) -> None:
    """Compute `sum_k D_k^T w_k / 2` over five derivatives D_k, where w_k is the shrunk derivative of `picture`.

    The derivatives are `D_x u`, `D_y u`, `D_x^T D_x u / 2`, `D_y^T D_y u / 2` and `D_x D_y u / sqrt(2)`, and each of
    them is shortened alone. They have about equal noise. `sum_k D_k^T D_k` is `D^T D + (D^T D)^2 / 4`. Parameters are
    those of :func:`shrunk_grad_adjoint_numpy`.
    """
    near, own = _near(picture, top, rows, periodic)

    def shrunk(derivative: Float32Array, limit: np.float32) -> Float32Array:
        return _shrunk(limit, polynomial, derivative)[0]

    across, down = gradient(near, periodic=periodic)
    # The second derivatives and the mixed one are divided by 2 and sqrt(2), so half of w_k has the factors 1/8 and 1/4.
    twist = gradient(down, periodic=periodic)[0]
    mixed = np.float32(np.sqrt(2.0)) * threshold
    pull = np.float32(0.25) * _adjoint(_adjoint(shrunk(twist, mixed), 1), 0)
    for axis, slope in ((1, across), (0, down)):
        pull += np.float32(0.5) * _adjoint(shrunk(slope, threshold), axis)
        # D^T D is symmetric, so it is its own adjoint.
        bend = shrunk(_adjoint(slope, axis), np.float32(2.0) * threshold)
        pull += np.float32(0.125) * _adjoint(gradient(bend, periodic=periodic)[1 - axis], axis)
    out[top : top + rows] = pull[own]


shrunk_grad_adjoint: Callable[..., None] = native.shrunk_grad_adjoint if native else shrunk_grad_adjoint_numpy
shrunk_derivatives_adjoint: Callable[..., None] = (
    native.shrunk_derivatives_adjoint if native else shrunk_derivatives_adjoint_numpy
)
