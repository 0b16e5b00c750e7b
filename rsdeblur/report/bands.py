"""Sharpness and ringing of pictures, band by band, measured without the true picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from rsdeblur.errors import InputError
from rsdeblur.estimate.noise import halved, noise_level
from rsdeblur.types import FloatArray, FloatImage

Figures = dict[str, tuple[float | None, ...]]

BANDS = 8
# Least height of a band, px: fewer rows say little about it.
SHORTEST = 16
# Rec. 709.
LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
# Percentile of the gradient's magnitude that measures edges. In pure noise it is 2.6 times the median (Rayleigh's
# distribution); a band of the input in which it is less than about twice that, `EDGES` times the median, has no edges.
STEEP = 99.0
EDGES = 5.0
# The input is even where its roughness over one PSF is below one and a half steps of 8 bits. With noise the limit rises
# to `EVEN_NOISE` times the noise level, but not above `MOST_EVEN`, because texture may pass for noise.
EVEN, MOST_EVEN = 0.006, 0.02
EVEN_NOISE = 1.5
# Share of a band that must be even before ringing is measured there.
FEWEST_EVEN = 0.01


@dataclass(frozen=True, slots=True)
class BandFigures:
    """Sharpness and ringing in each band along the readout axis, in picture order.

    Parameters
    ----------
    edges : tuple of int
        Start of each band and end of the last one, px.
    sharpness : dict of str to tuple of float or None
        For each picture, the steepness of its edges as a multiple of the first picture's; None where that has no edges.
    ringing : dict of str to tuple of float or None
        For each picture, the root mean square of the structure that it adds where the first picture is even, in percent
        of the range from black to white; None where too little is even.
    """

    edges: tuple[int, ...]
    sharpness: Figures
    ringing: Figures


def band_figures(
    pictures: Mapping[str, NDArray[np.floating]], reach: tuple[int, int], *, across: bool = False
) -> BandFigures:
    """Measure sharpness and ringing in equal bands of each picture.

    Both are measured at half the size, where most of the noise of single pixels is averaged out. The steepness of
    edges is the gradient that one pixel in a hundred exceeds. Where the blurred picture is even over a whole PSF, the
    scene is assumed to be even as well, and structure in a restored picture is ringing. Detail that the blur erased
    entirely counts as ringing too, and ringing beside edges makes them steeper; so read both figures together.

    Parameters
    ----------
    pictures : mapping of str to ndarray
        Display values in [0, 1], (H, W) or (H, W, C), all of one size; the first picture is the blurred one.
    reach : (int, int)
        Height and width of the largest PSF, px.
    across : bool, default False
        Whether bands are columns instead of rows, as for a horizontal readout.

    Returns
    -------
    BandFigures
        Eight bands, or fewer of at least 16 rows each.

    Raises
    ------
    InputError
        If there is no picture, or their sizes differ.
    """
    if not pictures:
        raise InputError("pictures must contain at least the blurred one")
    greys = {label: _grey(picture) for label, picture in pictures.items()}
    if len({grey.shape for grey in greys.values()}) > 1:
        raise InputError(f"all pictures must have one size, got {[grey.shape for grey in greys.values()]}")
    if across:
        greys = {label: np.ascontiguousarray(grey.T) for label, grey in greys.items()}
        reach = reach[::-1]
    blurred = next(iter(greys.values()))
    noise = 0.5 * noise_level(blurred[..., None])
    edges = np.linspace(0, len(blurred), max(1, min(BANDS, len(blurred) // SHORTEST)) + 1).round().astype(int)
    halves = {label: halved(grey[..., None])[..., 0] for label, grey in greys.items()}
    parts = [slice(first // 2, max(last // 2, 1)) for first, last in pairwise(edges.tolist())]
    return BandFigures(
        tuple(edges.tolist()),
        _sharpness(halves, parts),
        _ringing(halves, parts, [max(n // 2, 3) for n in reach], noise),
    )


def _grey(picture: NDArray[np.floating]) -> FloatImage:
    values = np.asarray(picture, dtype=np.float32)
    if values.ndim == 2:
        return values
    grey: FloatImage = values[..., :3] @ LUMA if values.shape[2] >= 3 else values[..., 0]
    return grey


def _sharpness(halves: dict[str, FloatImage], parts: list[slice]) -> Figures:
    steepness = {label: [_steepness(half[part]) for part in parts] for label, half in halves.items()}
    blurred = next(iter(steepness.values()))
    return {
        label: tuple(
            steep / first if first > EDGES * common else None
            for (steep, _), (first, common) in zip(mine, blurred, strict=True)
        )
        for label, mine in steepness.items()
    }


def _steepness(half: FloatImage) -> tuple[float, float]:
    """Return the gradient's magnitude at the edges, and its median."""
    if min(half.shape) < 2:
        return 0.0, 0.0
    steep, common = np.percentile(np.hypot(*np.gradient(half)), [STEEP, 50.0])
    return float(steep), float(common)


def _ringing(halves: dict[str, FloatImage], parts: list[slice], window: list[int], noise: float) -> Figures:
    rough = {label: _roughness(half, window) for label, half in halves.items()}
    blurred = next(iter(rough.values()))
    even = uniform_filter(blurred, window, mode="nearest") < np.clip(EVEN_NOISE * noise, EVEN, MOST_EVEN) ** 2
    enough = [even[part].mean() >= FEWEST_EVEN for part in parts]
    return {
        label: tuple(
            _excess(mine[part], blurred[part], even[part]) if known else None
            for part, known in zip(parts, enough, strict=True)
        )
        for label, mine in rough.items()
    }


def _roughness(half: FloatImage, window: list[int]) -> FloatArray:
    """Return the squared difference of each pixel from the mean over a window."""
    values = half.astype(np.float64)
    return np.square(values - uniform_filter(values, window, mode="nearest"))


def _excess(mine: FloatArray, blurred: FloatArray, even: NDArray[np.bool_]) -> float:
    return float(100.0 * np.sqrt(max(mine[even].mean() - blurred[even].mean(), 0.0)))
