"""Power spectra of a few of a picture's PSFs, and of a sharp picture as the lens shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from rsdeblur.deconv.otf import OtfPlanner
from rsdeblur.estimate.noise import gradient_energy, noise_spectrum
from rsdeblur.psf import PsfBank
from rsdeblur.types import FloatArray, FloatImage

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

    `signal` is that of the picture, L / |D|^2, zero for the mean, which no filter changes. `gradient` is |D|^2, the
    squared response of the differences, and `halved` that of halving and of the differences at half the size. `power`
    is the mean of |H|^2 over the PSFs, `undone` is |H|^2 of the PSF that a filter undoes, and `match` the mean of H
    times the conjugate of the undone one; both equal `power` where each filter undoes its own PSF.
    """

    signal: FloatArray
    gradient: FloatArray
    power: FloatArray
    undone: FloatArray
    match: FloatArray
    halved: FloatArray

    @property
    def gradient_left(self) -> float:
        """Share of the sharp gradient's energy that is left in the blurred picture."""
        return float((self.signal * self.gradient * self.power).mean())

    def energy(self, light: FloatImage, octave_noise: Sequence[float], path_error: float) -> float:
        """Return the mean squared gradient of the sharp picture whose blurred one is `light`, shape (H, W, C).

        `octave_noise` has the standard deviation of its noise in each octave, `path_error` is the mean square of the
        errors of the paths, px^2.
        """
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
