"""A denoiser as the prior: plug-and-play restoration.

Half-quadratic splitting alternates between

    u = argmin |A u - g|^2 + beta |u - v|^2    and    v = denoise(u, sigma)

The second step is the removal of white noise of the standard deviation sigma from u, so any denoiser can take its place
[1]_. While sigma falls from coarse to the picture's own noise, ``beta = weight / sigma^2`` grows [2]_.

.. [1] S. Venkatakrishnan, C. Bouman and B. Wohlberg, "Plug-and-play priors for model based reconstruction", GlobalSIP
   2013.
.. [2] K. Zhang, Y. Li, W. Zuo, L. Zhang, L. Van Gool and R. Timofte, "Plug-and-play image restoration with deep
   denoiser prior", IEEE Trans. Pattern Analysis and Machine Intelligence 44, 2022.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module

import numpy as np

from rsdeblur._util import validate
from rsdeblur.choices import DENOISERS
from rsdeblur.deconv.priors import LEAST_PEAK, TO_PICTURE, QuadraticSolver, brightness
from rsdeblur.errors import InputError
from rsdeblur.types import Denoiser, FloatImage

# The weight is this multiple of the variance of the noise, as in Zhang et al. With 0.15 some results are
# better, and others keep their noise.
WEIGHT_OF_VARIANCE = 0.23
# The last sigma is at most this share of the first.
LEAST_FALL = 0.5


@dataclass(frozen=True, slots=True)
class PlugAndPlayPrior:
    """A denoiser as the prior, with its strength.

    Parameters
    ----------
    denoise : callable
        Called as ``denoise(image, sigma)`` with linear light, shape (H, W) for grey pictures or (H, W, C), float32, and
        the standard deviation of its noise. Returns the picture without the noise, in the same shape. A solver of
        strips or chunks calls it once for each.
    weight : float
        Strength, from 1e-20 to 1e20: 0.23 times the variance of the picture's noise in linear light.
        :attr:`rsdeblur.tuning.Tuning.denoiser_weight` derives it from a picture.
    peak : float, optional
        Value of the picture's bright parts, to which the first sigma is scaled; default that of the picture that is
        solved.

    Raises
    ------
    InputError
        If an argument is out of range; while solving, if `denoise` returns another shape or values that are not finite.
    """

    denoise: Denoiser
    weight: float
    peak: float | None = None

    def __post_init__(self) -> None:
        if not callable(self.denoise):
            raise InputError(f"denoise must be a function, got {validate.shown(self.denoise)}")
        object.__setattr__(self, "weight", validate.strength("weight", self.weight))
        if self.peak is not None:
            object.__setattr__(self, "peak", validate.finite("peak", self.peak, maximum=validate.MOST_LIGHT))

    def with_peak_of(self, image: FloatImage) -> PlugAndPlayPrior:
        """Return this prior with the `peak` of a picture, unless it has one."""
        return self if self.peak is not None else replace(self, peak=brightness(image))

    def restore(
        self,
        solver: QuadraticSolver,
        *,
        threads: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> FloatImage:
        """Return the picture after the last denoising; see :meth:`rsdeblur.deconv.priors.LatentPrior.restore`."""
        sigmas = self.sigmas
        # A quadratic prior on the gradient gives the start.
        latent = solver.solve(self.weight / sigmas[0] ** 2)
        for done, sigma in enumerate(sigmas, 1):
            latent = self._denoised(solver.solve(self.weight / sigma**2, latent, TO_PICTURE, out=latent), sigma)
            if progress is not None:
                progress(done / len(sigmas))
        return latent

    @property
    def sigmas(self) -> list[float]:
        """Standard deviations of the noise that the steps remove, falling evenly in their logarithm."""
        peak = 1.0 if self.peak is None else self.peak
        # Zhang et al. use eight steps, and this first sigma where the bright parts of the picture have the value 1.
        first = 49 / 255 * max(peak, LEAST_PEAK)
        last = min(np.sqrt(self.weight / WEIGHT_OF_VARIANCE), LEAST_FALL * first)
        return [float(sigma) for sigma in np.geomspace(first, last, 8)]

    def _denoised(self, latent: FloatImage, sigma: float) -> FloatImage:
        grey = latent.shape[2] == 1
        denoised = validate.array("the denoiser's result", self.denoise(latent[..., 0] if grey else latent, sigma))
        expected = latent.shape[:2] if grey else latent.shape
        if denoised.shape != expected or denoised.dtype.kind != "f" or not np.isfinite(denoised).all():
            raise InputError(
                f"the denoiser must return finite linear light as floats of shape {expected}, got values of type "
                f"{denoised.dtype} and shape {denoised.shape}"
            )
        # A copy, because the solver overwrites it and the denoiser may keep its own.
        return np.array(denoised, dtype=np.float32, order="C").reshape(latent.shape)


def named_denoiser(prior: str, threads: int | None) -> Denoiser:
    """Return a denoiser of the package by the name of its prior, with its number of threads."""
    module, function = DENOISERS[prior]
    return partial(getattr(import_module(module), function), threads=threads)
