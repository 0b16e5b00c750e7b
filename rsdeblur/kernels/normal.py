"""The normal equations of tiles, one per frequency.

Shapes: bands B, channels C, columns K, tile length L.
"""

from __future__ import annotations

import numpy as np

from rsdeblur.kernels._jit import njit

# Least normal matrix: frequencies that no PSF passes and no prior restores contain no signal.
TINY = np.finfo(np.float32).tiny


@njit(nogil=True, error_model="numpy")
def add_normal(spectra, otfs, share, first, signal, power):
    """Add one picture's part to the normal equations: `share conj(H) G` and `share |H|^2`.

    Parameters
    ----------
    spectra : ndarray, shape (B, C, K, L), complex64
        Spectra G of the picture.
    otfs : ndarray, shape (B, K, L), complex64
        Optical transfer functions H.
    share : float32
        Weight of the picture.
    first : bool
        Whether the sums start here; what `signal` and `power` held before is then ignored.
    signal : ndarray, shape (B, C, K, L), complex64
        Sum of the right-hand sides, changed in place.
    power : ndarray, shape (B, K, L), float32
        Sum of the matrices, changed in place.
    """
    for b in range(spectra.shape[0]):
        for k in range(otfs.shape[1]):
            for j in range(otfs.shape[2]):
                h = otfs[b, k, j]
                here = share * (h.real * h.real + h.imag * h.imag)
                power[b, k, j] = here if first else power[b, k, j] + here
            for c in range(spectra.shape[1]):
                for j in range(otfs.shape[2]):
                    h, g = otfs[b, k, j], spectra[b, c, k, j]
                    real = share * (h.real * g.real + h.imag * g.imag)
                    imag = share * (h.real * g.imag - h.imag * g.real)
                    here = np.complex64(complex(real, imag))
                    signal[b, c, k, j] = here if first else signal[b, c, k, j] + here


@njit(nogil=True, error_model="numpy")
def solve_normal(signal, power, across, down, nsr, coupling, pull, scale, spectra):
    """Solve the normal equations with a prior that pulls.

    The result is `scale ((1 + nsr) signal + pull V) / (power + nsr + c0 + c1 d + c2 d^2)` at each frequency, where c is
    `coupling` and d the sum of `across` and `down`.

    Parameters
    ----------
    signal, power : ndarray
        Sums of :func:`add_normal`.
    across, down : ndarray, shape (K,) and (L,), float32
        Squared magnitudes of the frequency responses of the horizontal and the vertical difference.
    nsr : float32
        Weight of the squared picture.
    coupling : (float32, float32, float32)
        Weights of the prior's quadratic term (:class:`rsdeblur.deconv.coupling.Coupling`).
    pull : float32
        Weight of the pull.
    scale : float32
        Factor on the result.
    spectra : ndarray, shape (B, C, K, L), complex64
        Spectra V of the pull: what the adjoint makes of the target. Receives the result.
    """
    norm, tiny = np.float32(1.0) + nsr, np.float32(TINY)
    picture, gradient, bend = coupling
    ridge = nsr + picture
    gains = np.empty(spectra.shape[3], np.float32)
    for b in range(spectra.shape[0]):
        for k in range(spectra.shape[2]):
            for j in range(spectra.shape[3]):
                squared = across[k] + down[j]
                normal = power[b, k, j] + ridge + squared * (gradient + squared * bend)
                gains[j] = scale / max(normal, tiny)
            for c in range(spectra.shape[1]):
                for j in range(spectra.shape[3]):
                    gain, s, v = gains[j], signal[b, c, k, j], spectra[b, c, k, j]
                    real = gain * (norm * s.real + pull * v.real)
                    imag = gain * (norm * s.imag + pull * v.imag)
                    spectra[b, c, k, j] = np.complex64(complex(real, imag))
