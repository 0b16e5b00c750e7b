"""Sharpness and ringing of pictures, band by band, without knowing the truth."""

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
# Fewer rows say little about a band.
SHORTEST = 16
# Rec. 709.
LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
# Percentile of the gradient's magnitude that stands for edges. In noise alone it is 2.6 times the median (Rayleigh's
# distribution); a band whose input has less than about twice that shows no edges.
STEEP = 99.0
EDGES = 5.0
# The input is even where its roughness over one PSF stays below one and a half steps of 8 bits. A noisy one may be
# rougher, but texture may pass for noise: so this many times the noise, and never more than a bound.
EVEN, MOST_EVEN = 0.006, 0.02
EVEN_NOISE = 1.5
# Share of a band that must be even before ringing is measured there.
FEWEST_EVEN = 0.01


@dataclass(frozen=True, slots=True)
class BandFigures:
    """What `band_figures` measured; figures run over the bands along the readout axis, in picture order.

    Parameters
    ----------
    edges : tuple of int
        Where the bands begin, px, and where the last one ends.
    sharpness : dict of str to tuple of float or None
        For each picture: how steep its edges are, as a multiple of the first picture's; None where that has none.
    ringing : dict of str to tuple of float or None
        For each picture: root mean square of what it has in addition where the first picture is even, in percent of
        the range from black to white; None where too little is even.
    """

    edges: tuple[int, ...]
    sharpness: Figures
    ringing: Figures


def band_figures(
    pictures: Mapping[str, NDArray[np.floating]], reach: tuple[int, int], *, across: bool = False
) -> BandFigures:
    """Measure sharpness and ringing in equal bands of each picture.

    Both are looked at in pictures of half the size, where noise of single pixels has mostly gone. The steepness of
    edges is the gradient that one pixel in a hundred exceeds. Where the blurred picture is even over a whole PSF, the
    scene is taken to be even as well; what a restored picture shows there is ringing. Detail that the blur erased
    entirely counts as ringing too, and ringing beside edges makes them steeper; so read both together.

    Parameters
    ----------
    pictures : mapping of str to ndarray
        Display values in [0, 1], (H, W) or (H, W, C), all of one size; the first one is the blurred one.
    reach : (int, int)
        Height and width of the largest PSF, px.
    across : bool, default False
        Bands are columns, not rows: the readout is horizontal.

    Raises
    ------
    InputError
        If there is no picture, or their sizes differ.
    """
    if not pictures:
        raise InputError("pictures must hold at least the blurred one")
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
    found = {label: [_steepness(half[part]) for part in parts] for label, half in halves.items()}
    blurred = next(iter(found.values()))
    return {
        label: tuple(
            steep / first if first > EDGES * common else None
            for (steep, _), (first, common) in zip(mine, blurred, strict=True)
        )
        for label, mine in found.items()
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
    """Square of the difference from the mean over a window."""
    values = half.astype(np.float64)
    return np.square(values - uniform_filter(values, window, mode="nearest"))


def _excess(mine: FloatArray, blurred: FloatArray, even: NDArray[np.bool_]) -> float:
    return float(100.0 * np.sqrt(max(mine[even].mean() - blurred[even].mean(), 0.0)))
