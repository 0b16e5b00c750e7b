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
    """Add one picture's part to the normal equations: `share conj(H) G` to `signal`, `share |H|^2` to `power`.

    `spectra` (B, C, K, L) are G and `otfs` (B, K, L) are H; `signal` and `power` have the same shapes. With `first`,
    the sums start here, and what they held before is ignored.
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
    """Solve the normal equations of :func:`add_normal` with a prior that pulls.

    At each frequency, `spectra` (B, C, K, L) has the spectrum V of what the adjoint makes of the prior's target. It is
    replaced by

        scale ((1 + nsr) signal + pull V) / (power + nsr + c0 + c1 d + c2 d^2)

    where c is `coupling` (:class:`rsdeblur.deconv.priors.Coupling`) and d the sum of `across` (K,) and `down` (L,), the
    squared magnitudes of the frequency responses of the horizontal and the vertical difference.
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
