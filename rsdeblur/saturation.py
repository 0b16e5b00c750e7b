"""Highlights beyond full scale: found where the picture is clipped, taken out before it is solved, put back after.

A clipped trail of a lamp is no blurred lamp, and a lamp is so bright that a small error of its PSF outshines what is
around: both make streaks, in every mode and with every prior. So the picture is parted into highlights l, which are
found by themselves, and a rest, which has none and is solved as usual,

    g = A l + rest,    restored = l + solved(rest).

Highlights are light, so never negative, and stand only where clipped pixels can have come from. Richardson-Lucy keeps
both; a clipped pixel asks for no more than to be at least as bright as it is recorded (Whyte et al. 2014 [1]_ model
the sensor alike; Cho et al. 2011 [2]_ leave such pixels out). What highlights spoil is filled in from beside them.

.. [1] O. Whyte, J. Sivic and A. Zisserman, "Deblurring shaken and partially saturated images", IJCV 110, 2014.
.. [2] S. Cho, J. Wang and S. Lee, "Handling outliers in non-blind image deconvolution", ICCV 2011.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from rsdeblur.psf import PsfBank
from rsdeblur.wiener import TileBlur

Picture = NDArray[np.float32]
Mask = NDArray[np.bool_]
Saturation = Literal["ignore", "auto"]
SATURATIONS: tuple[Saturation, ...] = ("ignore", "auto")

# Pixels that share an edge or a corner, of one channel.
TOUCHING = np.ones((3, 3, 1), dtype=np.bool_)
# Share of full scale that counts as clipped beside pixels at full scale, which JPEG and resampling soften: 250 of 255.
NEAR = 0.98
# Share of a point's light that must have gone to clipped pixels for it to be taken for a highlight.
SEEN = 0.2
# Around clipped pixels so many px are spoiled too, and all that highlights give more than this light to: PSFs are good
# to some percent of it.
SPOILED, LIT = 2, 0.03
ITERATIONS = 30
# Clipped spots whose surroundings have more light than this are parts of a bright wall, sky or sheet of paper: what was
# cut off there is little, and filling them in would cost more than it mends.
BRIGHT = 0.5
# Least light that is divided by, and standard deviation in px of what smooths the filling.
DARK, SMOOTH = 1e-3, 2.0


class Parted(NamedTuple):
    """A picture as highlights, sharp, and the blurred rest; both of shape (H, W, C), linear light."""

    highlights: Picture
    rest: Picture


def clipped(values: NDArray[Any]) -> Mask:
    """Return which values are clipped.

    Parameters
    ----------
    values : ndarray, shape (H, W, C), uint8, uint16 or float
        As stored, without alpha. Floats that exceed 1 anywhere were not clipped there.
    """
    white = np.iinfo(values.dtype).max if values.dtype.kind == "u" else 1.0
    full = values == white
    if not full.any() or (values > white).any():
        return np.zeros(values.shape, dtype=np.bool_)
    near: Mask = ndimage.binary_propagation(full, structure=TOUCHING, mask=values >= NEAR * white)
    return near


def part(
    light: Picture,
    lost: Mask,
    bank: PsfBank,
    *,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Parted | None:
    """Take the highlights out of a picture.

    Parameters
    ----------
    light : ndarray, shape (H, W, C), float32
        Linear light.
    lost : ndarray, shape (H, W, C), bool
        See :func:`clipped`.
    bank : PsfBank
        PSFs of the picture.
    threads : int, optional
        Threads that share the work; default all processors.
    progress : callable, optional
        Called with the finished fraction.

    Returns
    -------
    Parted or None
        None where no point can be a highlight.
    """
    lost = _standing_out(lost, light)
    if not lost.any():
        return None
    blur = TileBlur(bank, light.shape, threads=threads)
    # One place for all channels, or highlights would have coloured fringes.
    possible = (blur.adjoint(lost.astype(np.float32)) > SEEN).any(axis=2, keepdims=True)
    if not possible.any():
        return None
    around = _around(light, lost).clip(DARK)
    found = np.where(possible, (light - around).clip(DARK), np.float32(0))
    for n in range(ITERATIONS):
        given = blur.forward(found).clip(0) + around
        ratio = light.clip(0) / given
        np.maximum(ratio, 1, out=ratio, where=lost)
        found *= blur.adjoint(ratio).clip(0)
        if progress is not None:
            progress((n + 1) / ITERATIONS)
    given = blur.forward(found).clip(0)
    lit = (given > LIT).any(axis=2)
    return Parted(found, filled(light - given, _spoiled(lost) | lit))


def filled(light: Picture, spoiled: Mask) -> Picture:
    """Fill pixels (H, W) that are spoiled, in any channel, with the nearest others, smoothed."""
    if not spoiled.any() or spoiled.all():
        return light
    row, col = ndimage.distance_transform_edt(spoiled, return_distances=False, return_indices=True)
    smooth = ndimage.gaussian_filter(light[row, col], (SMOOTH, SMOOTH, 0))
    return np.where(spoiled[..., None], smooth, light)


def _spoiled(lost: Mask) -> Mask:
    spoiled: Mask = ndimage.binary_dilation(np.any(lost, axis=2), iterations=SPOILED)
    return spoiled


def _around(light: Picture, lost: Mask) -> Picture:
    """Return the light that clipped spots would have without highlights."""
    return np.minimum(filled(light, _spoiled(lost)), light)


def _standing_out(lost: Mask, light: Picture) -> Mask:
    """Return the clipped spots whose surroundings are darker than `BRIGHT`."""
    spots, count = ndimage.label(lost.any(axis=2), TOUCHING[..., 0])
    dark = ndimage.mean(_around(light, lost).mean(axis=2), spots, np.arange(1, count + 1)) < BRIGHT
    kept: Mask = lost & np.append(False, dark)[spots][..., None]
    return kept
