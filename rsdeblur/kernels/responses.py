"""Filters of the quadratic solver of tiles: the Numba kernel and its NumPy twin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsdeblur.kernels._jit import njit


@njit(nogil=True, error_model="numpy")
def responses(otf, across, down, nsr, beta, scale, of_pull, out):
    """Compute the frequency response of the filter for the observed picture, or for the pull of a prior.

    With `N = |H|^2 + nsr + beta (across + down)`, they are `scale (1 + nsr) conj(H) / N` and `scale beta / N`.

    Parameters
    ----------
    otf : ndarray, shape (K, L), complex64
        Optical transfer function H of the tile.
    across, down : ndarray, shape (K,) and (L,), float32
        Squared magnitudes of the frequency responses of the horizontal and the vertical difference, or any other two
        parts of the prior's quadratic term.
    nsr, beta : float32
        Weights of the squared picture and of the prior's quadratic term.
    scale : float32
        Factor on the response.
    of_pull : bool
        Whether the filter is for the pull: the adjoint gradient, or a target picture.
    out : ndarray, shape (K, L), complex64
        Output.
    """
    norm = np.float32(1.0) + nsr
    for k in range(otf.shape[0]):
        for j in range(otf.shape[1]):
            h = otf[k, j]
            gain = scale / (h.real * h.real + h.imag * h.imag + nsr + beta * (across[k] + down[j]))
            if of_pull:
                out[k, j] = np.complex64(beta * gain)
            else:
                out[k, j] = np.complex64(complex(norm * gain * h.real, -norm * gain * h.imag))


def responses_numpy(
    otf: NDArray[np.complex64],
    across: NDArray[np.float32],
    down: NDArray[np.float32],
    nsr: float,
    beta: float,
    scale: float,
    of_pull: bool,
    out: NDArray[np.complex64],
) -> None:
    """Readable twin of :func:`responses`."""
    normal = np.abs(otf) ** 2 + nsr + beta * (across[:, None] + down)
    out[...] = scale * (beta if of_pull else (1 + nsr) * otf.conj()) / normal
