"""Strengths of a solution."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Strengths:
    """Strengths of a solution, derived from a picture's noise and blur or set by the options.

    Parameters
    ----------
    nsr : float
        Noise-to-signal ratio.
    weight : float or None
        Weight of the prior; None for the Wiener filter.
    peak : float
        Value of the picture's bright parts, see :func:`rsdeblur.deconv.priors.brightness`; 1 for the Wiener filter.
    variances : tuple of float
        Variances of :class:`rsdeblur.deconv.wavelet.WaveletPrior`; empty for other priors.
    noise : float, optional
        Standard deviation of the picture's noise; None where no strength needed it.
    """

    nsr: float
    weight: float | None
    peak: float
    variances: tuple[float, ...] = ()
    noise: float | None = None
