"""Strength of the regularisation, `nsr` and `weight`, from the picture's noise and the blur.

The sharp picture is assumed to have the spectrum `S = E L / |D|^2`: an even one of its gradient, of energy E, which the
lens softens (L). Noise of the sensor and the file format, errors of the paths (`e^2 |D|^2 S`) and of the continuation
beyond the frame (`b S`) act as noise. The Wiener filter and the gradient prior get the strengths with the least
expected squared error, a sum over frequencies; those of the sparse priors follow (docs/theory/priors.md, Strengths).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from rsdeblur._util import validate
from rsdeblur._util.one_line import one_line
from rsdeblur._util.threads import once
from rsdeblur.choices import DERIVATIVE_PRIORS, Prior
from rsdeblur.deconv.otf import OtfPlanner
from rsdeblur.deconv.plug_and_play import WEIGHT_OF_VARIANCE
from rsdeblur.deconv.priors import KINDS
from rsdeblur.psf import PsfBank
from rsdeblur.tuning.noise import (
    ASSUMED,
    OCTAVES,
    Floors,
    gradient_energy,
    measure_floors,
    noise_level,
    noise_spectrum,
    overall_noise,
)
from rsdeblur.types import FloatArray, FloatImage

# docs/benchmarks/quality.md has the measurements behind all constants.
# Factor on the variance of the noise, for two reasons. Errors count in encoded values, where shadows have more weight,
# and so has noise that is even in light. And pictures have less of the finest detail than a lens leaves.
FINE_NOISE = 4.0
# Factor on the fitted error of the paths: gains of cells absorb a part of it. Chosen on 126 simulated captures.
ABSORBED = 2.5
# The same for kernels that are given, which count as exact: most of what looks like an error of theirs is noise.
ABSORBED_BY_EXACT = 1.5
# Factor on the mean square of the error in a photo that a camera has denoised: its processing changes the scene, too.
# Chosen by eye on real photos (docs/developer/decisions.md).
OF_PROCESSED = 3.0
# Error of the paths in px, where the picture is too small to measure it.
PATH_ERROR = ABSORBED * ASSUMED
# Largest error of the paths as a share of the PSF's radius, where that is more than `PATH_ERROR`, and of the paths'
# spread about their mean. In a photo that is nearly still, what a phone's processing leaves looks like a larger error.
MOST_PATH_ERROR_SHARE, MOST_OF_SPREAD = 0.25, 0.5
# Share of a sparse prior's weight in a picture of one channel, whose derivatives are shorter than those of three
# channels together, and which of them vanish is decided with more noise. (docs/developer/decisions.md)
GREY_STRENGTH = 0.6
# Softness of a sharp picture (lens, area of the pixels, demosaicing): standard deviation in px.
LENS = 0.75
# Least share of the measured gradient that counts as the scene's: where noise dominates, an error of its estimate must
# not leave a gradient of zero.
LEAST_OF_SCENE = 0.1
# Kernels used along each axis of the bank.
KERNELS = 3


@dataclass(frozen=True, slots=True, eq=False)
class BlurSpectra:
    """Power spectra of a picture whose gradient has the energy 1, and of its PSFs; all have the same shape.

    Where each filter undoes its own PSF, `undone` and `match` equal `power`.
    """

    signal: FloatArray  # L / |D|^2 of the picture, zero for the mean, which no filter changes
    gradient: FloatArray  # |D|^2, the squared response of the differences
    power: FloatArray  # mean of |H|^2 over the PSFs
    undone: FloatArray  # |H|^2 of the PSF that a filter undoes
    match: FloatArray  # mean of H times the conjugate of the undone one
    halved: FloatArray  # squared response of halving and of the differences at half the size

    @property
    def gradient_left(self) -> float:
        """Share of the sharp gradient's energy that is left in the blurred picture."""
        return float((self.signal * self.gradient * self.power).mean())

    def energy(self, light: FloatImage, octave_noise: Sequence[float], path_error: float) -> float:
        """Return the mean squared gradient of the sharp picture whose blurred one is `light`, shape (H, W, C)."""
        measured = gradient_energy(light)
        of_noise = light.shape[2] * float((self.halved * noise_spectrum(octave_noise, len(self.halved))).mean())
        # What the PSFs leave, and what errors of the paths add.
        left = float((self.halved * self.signal * (self.power + path_error * self.gradient)).mean())
        return float(max(measured - of_noise, LEAST_OF_SCENE * measured) / left)

    @classmethod
    def mean(cls, frames: Sequence[BlurSpectra], shares: FloatArray) -> BlurSpectra:
        """Return the spectra of frames of one scene together, weighted by their shares; all have the same shape."""
        power, undone, match = (
            np.tensordot(shares, [getattr(frame, name) for frame in frames], axes=1)
            for name in ("power", "undone", "match")
        )
        return replace(frames[0], power=power, undone=undone, match=match)

    @classmethod
    def of(cls, bank: PsfBank, *, one_filter: bool) -> BlurSpectra:
        """Return the spectra of a few kernels that are spread over the bank; `one_filter` undoes the middle one."""
        side = fft.next_fast_len(max(128, *(n + n // 2 for n in bank.size)))
        rows, cols = (np.unique(np.linspace(0, n - 1, KERNELS).astype(int)) for n in bank.kernels.shape[:2])
        planner = OtfPlanner(bank.size, (side, side))
        otfs = [planner.whole(bank, b, s) for b in rows for s in cols]
        power = undone = match = np.mean([np.square(np.abs(otf)) for otf in otfs], axis=0)
        if one_filter:
            middle = otfs[len(otfs) // 2]
            undone, match = np.square(np.abs(middle)), (np.conj(middle) * np.mean(otfs, axis=0)).real
        down, across = np.meshgrid(*2 * [np.pi * fft.fftfreq(side)], indexing="ij")
        once, twice = (4 * (np.sin(step * down) ** 2 + np.sin(step * across) ** 2) for step in (1, 2))
        lens = np.exp(-4 * LENS**2 * (down**2 + across**2))
        lens /= lens.mean()
        signal = np.divide(lens, once, out=np.zeros_like(once), where=once > 0)
        halved = np.square(np.cos(down) * np.cos(across)) * twice
        return cls(signal, once, power, undone, match, halved)


@one_line("octave_noise", "energy", "radius", "border_error")
@dataclass(frozen=True, eq=False)
class Tuning:
    """Measurements of a picture and its PSFs, from which the strength of every prior follows.

    Parameters
    ----------
    octave_noise : tuple of float
        Standard deviation of the noise in linear light, below 0.125 cycles/px, up to 0.25, and above; white noise has
        the same in all three.
    energy : float
        E, mean squared gradient of the sharp picture; both directions and all channels are added up.
    radius : float
        Root mean square radius of the PSFs, px.
    border_error : float
        Share b of the signal's power that the continuation beyond the frame gets wrong; it is also the `nsr` to use
        with priors on derivatives.
    spectra : BlurSpectra
        Spectra of the PSFs.
    path_error : float
        Mean square of the errors of the paths, px^2.
    channels : int
        Number of channels of the picture, whose derivatives sparse priors shorten together.

    Examples
    --------
    >>> import numpy as np
    >>> import rsdeblur
    >>> light = np.random.default_rng(0).random((64, 64))
    >>> bank = rsdeblur.PsfBank.for_picture(np.full((1, 5), 0.2), light.shape)
    >>> tuning = rsdeblur.tuning.Tuning.of(light, bank, noise=0.01)
    >>> tuning.weight("tv", 1.0) > 0, tuning.octave_noise
    (True, (0.01, 0.01, 0.01))
    """

    octave_noise: tuple[float, ...]
    energy: float
    radius: float
    border_error: float
    spectra: BlurSpectra
    path_error: float
    channels: int = 3

    @classmethod
    def of(
        cls,
        light: ArrayLike,
        bank: PsfBank,
        *,
        noise: float | None = None,
        one_filter: bool = False,
        continued: bool = True,
        repeats: bool = False,
    ) -> Tuning:
        """Measure a blurred picture and its PSFs.

        Parameters
        ----------
        light : array_like, shape (H, W) or (H, W, C)
            The blurred picture in linear light, floats.
        bank : PsfBank
            PSFs of the picture; a few that are spread over it are enough.
        noise : float, optional
            Standard deviation of white noise in linear light; by default noise is estimated in each octave.
        one_filter : bool, default False
            Whether the middle PSF is undone everywhere, as in ``mode="global"``.
        continued : bool, default True
            Whether the solver continues the picture beyond its top and bottom. In rowwise, rows there are unknowns.
        repeats : bool, default False
            Whether the picture repeats, and the solver knows it, so that nothing beyond the frame is guessed.

        Raises
        ------
        InputError
            If `light` has another shape, holds integers, or is not finite, or `noise` is not from 0 to 1e12.
        """
        light = validate.linear_light(light)
        validate.instance("bank", bank, PsfBank)
        for name, value in {"one_filter": one_filter, "continued": continued, "repeats": repeats}.items():
            validate.boolean(name, value)
        light = light.reshape(*light.shape[:2], -1)
        spectra = BlurSpectra.of(bank, one_filter=one_filter)
        # The scene is taken as the lens shows it, which has a power of its own in each octave.
        octaves = len(OCTAVES) + 1
        floors = measure_floors(light, bank.without_softness()) or Floors((noise_level(light),) * octaves, ASSUMED**2)
        octave_noise = floors.octave_noise if noise is None else (validate.noise("noise", noise),) * octaves
        # A constant picture has nothing to restore, so any energy other than 0 will do.
        energy = spectra.energy(light, octave_noise, floors.path_error) or 1.0
        share = bank.size[1] / light.shape[1]
        if continued:
            share = max(share, bank.size[0] / light.shape[0])
        down, across = (np.square(np.arange(n) - n // 2) for n in bank.size)
        # Own kernels with negative values may have a negative second moment.
        moment = (bank.kernels * (down[:, None] + across)).sum(axis=(2, 3)).mean()
        radius = float(np.sqrt(max(moment, 0.0)))
        most = max(MOST_PATH_ERROR_SHARE * radius, min(PATH_ERROR, MOST_OF_SPREAD * _spread(bank)))
        # Own kernels count as exact.
        factor = ABSORBED_BY_EXACT**2
        if bank.displacements is not None:
            factor = ABSORBED**2 * (1.0 + floors.processed * (OF_PROCESSED - 1.0))
        path_error = min(factor * floors.path_error, most**2)
        border_error = 0.0 if repeats else share**2 / 4
        return cls(octave_noise, energy, radius, border_error, spectra, path_error, light.shape[2])

    def noise_power(self, energy: float) -> float:
        """Return the power of noise and of errors of the model, as white noise that matters as much for a scene.

        Parameters
        ----------
        energy : float
            E of the sharp picture.
        """
        shown = self.spectra.signal * self.spectra.gradient
        return FINE_NOISE * float((shown * self._sensor_noise).sum() / shown.sum()) + energy * self.path_error

    @property
    def noise(self) -> float:
        """Standard deviation of the noise in linear light."""
        return overall_noise(self.octave_noise)

    @once
    def gradient_weight(self) -> float:
        """Weight of the prior with exponent 2 at which the expected error is least."""
        return self._best(lambda weight: self.border_error + weight * self.spectra.gradient)

    def weight(self, prior: Prior, exponent: float) -> float:
        """Return the weight of a prior on derivatives.

        Parameters
        ----------
        prior : {"gradient", "tv", "hyper-laplacian"}
            The prior.
        exponent : float
            Exponent of the hyper-Laplacian, in (0, 1]; the other priors ignore it.
        """
        kind = KINDS[validate.choice("prior", prior, DERIVATIVE_PRIORS)]
        weight = self.gradient_weight
        if kind.shrink is None:
            return weight
        power = kind.power(validate.exponent("exponent", exponent))
        factor = kind.strength * power**0.5
        if self.channels == 1:
            factor *= GREY_STRENGTH
        return _strength(factor * weight * self.energy ** (1 - power / 2))

    @property
    def denoiser_weight(self) -> float:
        """Weight of :class:`rsdeblur.deconv.PlugAndPlayPrior`, from the variance of noise and model errors together."""
        spectra = self.spectra
        # Priors cannot distinguish errors of the model from noise.
        errors = self.path_error * spectra.gradient + self.border_error
        wrong = errors * spectra.power + spectra.power - 2 * spectra.match + spectra.undone
        return _strength(WEIGHT_OF_VARIANCE * float((self._sensor_noise + self.energy * spectra.signal * wrong).mean()))

    @property
    def _sensor_noise(self) -> FloatArray:
        return noise_spectrum(self.octave_noise, len(self.spectra.signal))

    @property
    def wiener_nsr(self) -> float:
        """The `nsr` at which the expected error of the Wiener filter is least."""
        return self._best(lambda nsr: nsr)

    def _best(self, penalty: Callable[[float], float | FloatArray]) -> float:
        """Return the strength with the least error of `conj(H) / (|H|^2 + penalty)`, scaled to keep the mean."""
        spectra = self.spectra
        noise = (
            FINE_NOISE * self._sensor_noise / self.energy
            + (self.path_error * spectra.gradient + self.border_error) * spectra.signal
        )

        # The error is the sum of (1 - 2 gain match + gain^2 undone power) signal + gain^2 undone noise. Its constant
        # part is left out.
        linear, squared = spectra.match * spectra.signal, spectra.undone * (spectra.power * spectra.signal + noise)

        def error(strength: float) -> float:
            added = penalty(strength)
            gain = (1.0 + np.ravel(added)[0]) / (spectra.undone + added)
            return float((gain * (gain * squared - 2.0 * linear)).sum())

        return float(min(np.geomspace(1e-5, 10.0, 73), key=error))

    @property
    def gradient_nsr(self) -> float:
        """The `nsr` at which a Wiener filter restores the same frequencies as the gradient prior.

        A straight path of L px has `|H| = 1 / (pi L f)`. The prior's limit is the frequency at which this equals
        `sqrt(weight) 2 pi f`; there `|H|^2` is `2 sqrt(weight) / L`.
        """
        length = np.sqrt(12.0) * max(self.radius, 1.0)
        return float(2.0 * np.sqrt(self.gradient_weight) / length)


def _strength(value: float) -> float:
    """Return a strength within its bounds."""
    return float(np.clip(value, 1 / validate.MOST_STRENGTH, validate.MOST_STRENGTH))


def _spread(bank: PsfBank) -> float:
    """Return the root mean square distance of the paths from their means, px; infinite without paths."""
    if bank.displacements is None:
        return np.inf
    about = bank.displacements - bank.displacements.mean(axis=2, keepdims=True)
    return float(np.sqrt(np.square(about).sum(axis=-1).mean()))
