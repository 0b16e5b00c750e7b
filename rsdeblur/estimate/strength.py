"""How strongly to regularise: `nsr` and `weight` from the picture's noise and the blur.

The sharp picture's gradient is taken to have an even spectrum as the scene gives it, which a lens then softens; so the
picture's own is `S = E L / |D|^2`, `|D|^2` being the squared transfer function of its differences and E the energy of
its gradient. E follows from the blurred picture's gradient and from how much of it the PSFs leave. Three things act as
noise:

- The sensor's and the file's noise, of variance `sigma^2`.
- The errors of the blur's model. A path that is off by e px changes H by up to `2 pi f e` at the frequency f. That adds
  `e^2 |D|^2 S`.
- What the continuation beyond the frame gets wrong, in proportion to the signal: `b S`.

The expected squared error of a filter is a sum over frequencies, and the strengths of the Wiener filter and of the
gradient prior are those with the least of it. One filter for the whole picture meets other PSFs than its own; what it
makes of them counts too. The weights of the sparse priors follow from the gradient prior's, with the powers of
brightness that their exponents demand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from rsdeblur._util import validate
from rsdeblur.choices import Prior
from rsdeblur.estimate.noise import gradient_energy, noise_level
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray

# All constants: docs/benchmarks/priors.md. Results are judged as stored, where shadows count more than bright light and
# so does noise that is even in light; and pictures hold less of the finest detail than a lens leaves. Both together:
FINE_NOISE = 4.0
# Softness of a sharp picture: the lens, the pixels' area and demosaicing, standard deviation in px.
LENS = 0.75
# Error of the paths: px, whatever the blur (interpolation between tiles, linear interpolation in kernels), and as a
# share of the PSF's radius (focal length, time offset, rates).
PATH_ERROR, PATH_ERROR_SHARE = 0.12, 0.005
# A total variation's weight where the gradient prior's is 1 and E is 1; it grows like the root of the exponent.
SPARSE_STRENGTH = 2.0
# Candidates for the NSR and for the gradient prior's weight.
LADDER = np.geomspace(1e-5, 10.0, 73)
# Kernels looked at along each axis of the bank.
KERNELS = 3
# The published method's NSR, taken to hold at base sensitivity.
BASE_NSR, BASE_ISO = 0.01, 100.0


def nsr_of_iso(iso: float) -> float:
    """Return the NSR for a sensitivity: the variance of shot noise in the picture grows like the gain.

    An option that Sindelar and Sroubek (2013) tried and found of little effect. ISO 100 has their 0.01.
    """
    return BASE_NSR * validate.finite("iso", iso, above=0.0) / BASE_ISO


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
    def of(cls, light: ArrayLike, bank: PsfBank, *, one_filter: bool = False, continued: bool = True) -> Tuning:
        """Measure a blurred picture and its PSFs.

        Parameters
        ----------
        light : array_like, shape (H, W) or (H, W, C)
            The blurred picture in linear light, floats.
        bank : PsfBank
            PSFs of the picture; a few that are spread over it are enough.
        one_filter : bool, default False
            Whether the middle PSF is undone everywhere, as in ``mode="global"``.
        continued : bool, default True
            Whether the solver continues the picture beyond its top and bottom. In rowwise, rows there are unknowns.

        Raises
        ------
        InputError
            If `light` has another shape, holds integers, or is not finite.
        """
        light = validate.picture(light)
        light = light.reshape(*light.shape[:2], -1)
        spectra = Spectra.of(bank, one_filter=one_filter)
        noise = noise_level(light)
        # In an even picture there is nothing to restore, and any energy will do.
        energy = gradient_energy(light, noise) / spectra.left_of_gradient or 1.0
        share = bank.size[1] / light.shape[1]
        if continued:
            share = max(share, bank.size[0] / light.shape[0])
        return cls(noise, energy, _radius(bank), share**2 / 4, spectra)

    @property
    def gradient_weight(self) -> float:
        """Weight of the prior with exponent 2 that has the least expected error."""
        return self._best(lambda weight: self.border_error + weight * self.spectra.gradient)

    def weight(self, prior: Prior, exponent: float) -> float:
        """Weight of a prior on the gradient; `exponent` is the hyper-Laplacian's."""
        weight = self.gradient_weight
        if prior == "gradient":
            return weight
        power = 1.0 if prior == "tv" else exponent
        return float(SPARSE_STRENGTH * power**0.5 * weight * self.energy ** (1 - power / 2))

    @property
    def wiener_nsr(self) -> float:
        """The `nsr` whose Wiener filter has the least expected error."""
        return self._best(lambda nsr: nsr)

    def _best(self, penalty: Callable[[float], float | FloatArray]) -> float:
        """Return the strength whose filter `conj(H) / (|H|^2 + penalty)`, times what keeps a mean, errs least."""
        of = self.spectra
        path_error_2 = PATH_ERROR**2 + (PATH_ERROR_SHARE * self.radius) ** 2
        noise = FINE_NOISE * self.noise**2 / self.energy + (path_error_2 * of.gradient + self.border_error) * of.signal

        def error(strength: float) -> float:
            added = np.broadcast_to(penalty(strength), of.undone.shape)
            gain = (1.0 + added[0, 0]) / (of.undone + added)
            left = 1.0 - 2.0 * gain * of.match + np.square(gain) * of.undone * of.power
            return float((left * of.signal + np.square(gain) * of.undone * noise).sum())

        return float(min(LADDER, key=error))

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
    """Of a picture whose gradient has the energy 1, and of the PSFs.

    Parameters
    ----------
    signal : ndarray
        L / |D|^2; zero for the mean, which no filter changes.
    gradient : ndarray
        |D|^2.
    power : ndarray
        Mean of |H|^2.
    undone : ndarray
        |H|^2 of the PSF that a filter undoes: `power` where each undoes its own.
    match : ndarray
        Mean of H times the conjugate of the one that is undone, likewise.
    left_of_gradient : float
        Share of the sharp gradient's energy that the blurred picture has at half its size.
    """

    signal: FloatArray
    gradient: FloatArray
    power: FloatArray
    undone: FloatArray
    match: FloatArray
    left_of_gradient: float

    @classmethod
    def of(cls, bank: PsfBank, *, one_filter: bool) -> Spectra:
        """Transform a few kernels, spread over the bank; `one_filter` undoes the middle one."""
        side = fft.next_fast_len(max(128, *(n + n // 2 for n in bank.size)))
        rows, cols = (np.unique(np.linspace(0, n - 1, KERNELS).astype(int)) for n in bank.kernels.shape[:2])
        kernels = bank.kernels[np.ix_(rows, cols)].reshape(-1, *bank.size)
        found = [fft.fft2(kernel, (side, side)) for kernel in kernels]
        power = undone = match = np.mean([np.square(np.abs(h)) for h in found], axis=0)
        if one_filter:
            middle = found[len(found) // 2]
            undone, match = np.square(np.abs(middle)), (np.conj(middle) * np.mean(found, axis=0)).real
        down, across = np.meshgrid(*2 * [np.pi * fft.fftfreq(side)], indexing="ij")
        once, twice = (4 * (np.sin(step * down) ** 2 + np.sin(step * across) ** 2) for step in (1, 2))
        lens = np.exp(-4 * LENS**2 * (down**2 + across**2))
        lens /= lens.mean()
        signal = np.divide(lens, once, out=np.zeros_like(once), where=once > 0)
        halving = np.square(np.cos(down) * np.cos(across)) * twice * signal
        return cls(signal, once, power, undone, match, float((halving * power).mean()))


def _radius(bank: PsfBank) -> float:
    down, across = (np.arange(n) - n // 2 for n in bank.size)
    squared = np.square(down)[:, None] + np.square(across)
    return float(np.sqrt((bank.kernels * squared).sum(axis=(2, 3)).mean()))
