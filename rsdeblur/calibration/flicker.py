"""Readout time from the bands that a flickering lamp leaves in a picture.

A lamp on the mains flickers at twice their frequency. A rolling shutter exposes each row a little later than the one
before, so the flicker becomes bands along the readout, and their number is readout time times flicker frequency. The
bands are the same across the whole picture, unlike the scene: strips of the picture must agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rsdeblur._util import validate
from rsdeblur.choices import Auto, Transfer
from rsdeblur.errors import InputError
from rsdeblur.image.encoded import EncodedImage
from rsdeblur.types import FloatArray

# Least number of bands in the picture: fewer look like the scene's own shading.
FEWEST = 1.5
# Least share of the bands' power that the strips have in common, and least share of all changes that bands explain.
COHERENT, EXPLAINED = 0.9, 0.5
# Smallest side of a picture in px.
SMALLEST = 64


@dataclass(frozen=True, slots=True)
class Flicker:
    """Bands of a lamp in one or several pictures."""

    readout_time: float | None  # s; None if the pictures show no clear bands
    bands: float  # likeliest number of bands in the picture
    coherence: float  # share of the bands' power that all strips of the picture have in common, in [0, 1]
    reason: str  # why `readout_time` is None; empty otherwise


def measure_flicker(
    images: Sequence[ArrayLike],
    *,
    mains: float = 50.0,  # Hz; the lamp flickers at twice this frequency
    horizontal: bool = False,  # whether the readout runs along the x axis
    transfer: Transfer | Auto = "auto",
) -> Flicker:
    """Measure the readout time by the bands of a lamp, in pictures of an evenly lit wall that are all of one size.

    From several pictures of one scene, the scene is removed.
    """
    mains = validate.finite("mains", mains, above=0.0)
    profiles = [_profiles(image, horizontal, transfer) for image in images]
    if not profiles or len({profile.shape for profile in profiles}) > 1:
        raise InputError("measuring the flicker needs pictures of one size")
    stack = np.array(profiles)
    if len(stack) > 1:
        stack -= stack.mean(axis=0)
    # More than 40 bands need a readout of over 0.4 s.
    bands = np.arange(FEWEST, min(40.0, stack.shape[-1] / 8), 0.02)
    found = np.array([_explained(stack, count) for count in bands])
    at = int(found[:, 0].argmax())
    peak, (explained, share) = float(bands[at]), found[at].tolist()
    reason = ""
    if share < COHERENT or explained < EXPLAINED:
        reason = (
            "no clear bands: use an evenly lit wall, a lamp that flickers, several pictures, and a short exposure, no "
            f"multiple of 1/{2 * mains:g} s"
        )
    elif at == 0:
        reason = f"fewer than {FEWEST:g} bands: the readout is too short to be measured in this way"
    return Flicker(None if reason else peak / (2 * mains), peak, share, reason)


def _profiles(image: ArrayLike, horizontal: bool, transfer: Transfer | Auto) -> FloatArray:
    """Return the logarithm of the light along the readout in each strip, without shading, shape (strips, n)."""
    light = EncodedImage.of(image, transfer).grey(slice(None))
    light = light.T if horizontal else light
    if min(light.shape) < SMALLEST:
        raise InputError(f"a picture for measuring the flicker must have sides of at least {SMALLEST} px")
    # Strips must agree on the phase of the bands.
    strips = np.array([part.mean(axis=1) for part in np.array_split(light, 16, axis=1)], dtype=np.float64)
    # Darker light does not count, so that its logarithm does not diverge.
    return _without_shading(np.log(np.maximum(strips, 0.01)))


def _without_shading(profiles: FloatArray) -> FloatArray:
    """Return profiles without the shading of a wall, the best parabola along the last axis."""
    shading, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, profiles.shape[-1]), 3))
    residual: FloatArray = profiles - (profiles @ shading) @ shading.T
    return residual


def _explained(stack: FloatArray, count: float) -> tuple[float, float]:
    """Return the share of the changes that `count` bands explain, and that of their power common to all strips.

    Phases may differ between the pictures of a `stack` (pictures, strips, n), not between strips.
    """
    phase = 2 * np.pi * count * np.arange(stack.shape[-1]) / stack.shape[-1]
    # The shading has been removed from the profiles, so it is removed from the waves too.
    waves, _ = np.linalg.qr(_without_shading(np.stack([np.cos(phase), np.sin(phase)])).T)
    mean = stack.mean(axis=1)
    common, each = (float(((part @ waves) ** 2).sum()) for part in (mean, stack))
    tiny = np.finfo(np.float64).tiny
    return common / (float((mean**2).sum()) + tiny), common / (each / stack.shape[1] + tiny)
