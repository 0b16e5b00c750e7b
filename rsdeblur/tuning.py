"""How strongly to regularise: `nsr` and `weight` from the picture's noise and the blur.

The sharp picture's gradient is taken to have an even spectrum of energy E, so the picture's own is `S = E / |D|^2`,
`|D|^2` being the squared transfer function of its differences. E follows from the blurred picture's gradient and from
how much of it the PSFs leave. Two things act as noise:

- The sensor's and the file's noise, of variance `sigma^2`.
- The errors of the blur's model. A path that is off by e px changes H by up to `2 pi f e` at the frequency f. That adds
  `(2 pi f e)^2 S = e^2 E`, even as well. What the continuation beyond the frame gets wrong is in proportion to the
  signal, `b S`.

The best linear filter for `S` and that noise is `conj(H) / (|H|^2 + b + (sigma^2 / E + e^2) |D|^2)`: the gradient
prior. The weights of the others follow with the powers of brightness that their exponents demand; the `nsr` of the
Wiener filter is the one with the least expected error.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rsdeblur import _validate
from rsdeblur._validate import FloatArray
from rsdeblur.noise import gradient_energy, noise_level
from rsdeblur.priors import Prior
from rsdeblur.psf import PsfBank

# All constants: docs/benchmarks/priors.md. Pictures hold less detail in the finest scales than an even spectrum does,
# so noise counts more by this factor.
FINE_NOISE = 10.0
# Error of the paths: px, whatever the blur (interpolation between tiles, linear interpolation in kernels), and as a
# share of the PSF's radius (focal length, time offset, rates).
PATH_ERROR, PATH_ERROR_SHARE = 0.13, 0.005
# A total variation's weight where the gradient prior's is 1 and E is 1; it is in proportion to the exponent.
SPARSE_STRENGTH = 0.9
# Candidates for the NSR.
NSR_LADDER = np.geomspace(1e-4, 10.0, 61)
# Kernels looked at along each axis of the bank.
KERNELS = 3
# The published method's NSR, taken to hold at base sensitivity.
BASE_NSR, BASE_ISO = 0.01, 100.0


def nsr_of_iso(iso: float) -> float:
    """Return the NSR for a sensitivity: the variance of shot noise in the picture grows like the gain.

    An option that Sindelar and Sroubek (2013) tried and found of little effect. ISO 100 has their 0.01.
    """
    return BASE_NSR * _validate.finite("iso", iso, above=0.0) / BASE_ISO


@dataclass(frozen=True, slots=True, eq=False)
class Tuning:
    """What the strength of every prior follows from.

    Parameters
    ----------
    noise : float
        Standard deviation of the noise in linear light.
    energy : float
        E, mean squared gradient of the sharp picture, over both directions and all channels.
    radius : float
        Root mean square radius of the PSFs, px.
    border_error : float
        b, share of the signal's power that the continuation beyond the frame gets wrong: the `nsr` that goes with
        priors on the gradient.
    spectra : Spectra
        Of the PSFs.
    """

    noise: float
    energy: float
    radius: float
    border_error: float
    spectra: Spectra = field(repr=False)

    @classmethod
    def of(cls, light: NDArray[np.float32], bank: PsfBank) -> Tuning:
        """Look at a blurred picture (H, W, C) in linear light, and at its PSFs.

        A few PSFs that are spread over the picture will do.
        """
        spectra = Spectra.of(bank)
        noise = noise_level(light)
        # In an even picture there is nothing to restore, and any energy will do.
        energy = gradient_energy(light, noise) / spectra.left_of_gradient or 1.0
        share = max(bank.size[0] / light.shape[0], bank.size[1] / light.shape[1])
        return cls(noise, energy, _radius(bank), share**2 / 4, spectra)

    @property
    def gradient_weight(self) -> float:
        """`sigma^2 / E + e^2`, the weight of the prior with exponent 2."""
        path_error_2 = PATH_ERROR**2 + (PATH_ERROR_SHARE * self.radius) ** 2
        return FINE_NOISE * self.noise**2 / self.energy + path_error_2

    def weight(self, prior: Prior, exponent: float) -> float:
        """Weight of a prior on the gradient; `exponent` is the hyper-Laplacian's."""
        if prior == "gradient":
            return self.gradient_weight
        power = 1.0 if prior == "tv" else exponent
        return float(SPARSE_STRENGTH * power * self.gradient_weight * self.energy ** (1 - power / 2))

    @property
    def wiener_nsr(self) -> float:
        """The `nsr` whose Wiener filter has the least expected error."""
        signal, power = self.spectra.signal, self.spectra.power
        noise = self.gradient_weight + self.border_error * signal

        def error(nsr: float) -> float:
            gain = (1.0 + nsr) / (power + nsr)
            return float((np.square(1.0 - gain * power) * signal + np.square(gain) * power * noise).sum())

        return float(min(NSR_LADDER, key=error))

    @property
    def gradient_nsr(self) -> float:
        """The `nsr` at which a Wiener filter restores frequencies up to where the gradient prior does.

        A straight path of L px has `|H| = 1 / (pi L f)`. The prior's limit is where that is `sqrt(weight) 2 pi f`, so
        `|H|^2` is `2 sqrt(weight) / L` there.
        """
        length = np.sqrt(12.0) * max(self.radius, 1.0)
        return float(2.0 * np.sqrt(self.gradient_weight) / length)


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """Of a picture with an even gradient of energy 1, and of the PSFs.

    Parameters
    ----------
    signal : ndarray
        1 / |D|^2; zero for the mean, which no filter changes.
    power : ndarray
        Mean of |H|^2.
    left_of_gradient : float
        Share of the sharp gradient's energy that the blurred picture has at half its size.
    """

    signal: FloatArray
    power: FloatArray
    left_of_gradient: float

    @classmethod
    def of(cls, bank: PsfBank) -> Spectra:
        """Transform a few kernels, spread over the bank."""
        side = fft.next_fast_len(max(128, *(n + n // 2 for n in bank.size)))
        rows, cols = (np.unique(np.linspace(0, n - 1, KERNELS).astype(int)) for n in bank.kernels.shape[:2])
        kernels = bank.kernels[np.ix_(rows, cols)].reshape(-1, *bank.size)
        power = np.mean([np.square(np.abs(fft.fft2(kernel, (side, side)))) for kernel in kernels], axis=0)
        down, across = np.meshgrid(*2 * [np.pi * fft.fftfreq(side)], indexing="ij")
        once, twice = (4 * (np.sin(step * down) ** 2 + np.sin(step * across) ** 2) for step in (1, 2))
        signal = np.divide(1.0, once, out=np.zeros_like(once), where=once > 0)
        halving = np.square(np.cos(down) * np.cos(across)) * twice * signal
        return cls(signal, power, float((halving * power).mean()))


def _radius(bank: PsfBank) -> float:
    down, across = (np.arange(n) - n // 2 for n in bank.size)
    squared = np.square(down)[:, None] + np.square(across)
    return float(np.sqrt((bank.kernels * squared).sum(axis=(2, 3)).mean()))
