"""The quadratic term by which a prior couples the sharp picture to a target, as solvers see it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rsdeblur.types import Float32Array


class Coupling(NamedTuple):
    """Weights of `|u|^2`, `|D u|^2` and `|D^T D u|^2` in a prior's quadratic term of strength 1.

    D takes forward differences in both directions. In the Fourier domain all three are factors, powers of `|D|^2`.

    Parameters
    ----------
    picture, gradient, bend : float
        The weights, at least 0.
    """

    picture: float
    gradient: float
    bend: float

    def weights(self, beta: float) -> tuple[np.float32, np.float32, np.float32]:
        """Return the weights for the strength `beta`."""
        return np.float32(beta * self.picture), np.float32(beta * self.gradient), np.float32(beta * self.bend)

    def response(self, squared: Float32Array) -> Float32Array:
        """Return the term's factor at frequencies at which `|D|^2` has the values `squared`."""
        picture, gradient, bend = self.weights(1.0)
        response: Float32Array = picture + squared * (gradient + squared * bend)
        return response


# The target is a picture, a gradient, or the derivatives of kernels.shrink.shrunk_derivatives_adjoint: half of |D u|^2,
# and half of a quarter of |D^T D u|^2, which contains the mixed derivative.
TO_PICTURE = Coupling(1.0, 0.0, 0.0)
TO_GRADIENT = Coupling(0.0, 1.0, 0.0)
TO_DERIVATIVES = Coupling(0.0, 0.5, 0.125)
