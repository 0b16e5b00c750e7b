"""Sharpness and ringing of pictures, band by band, without the true picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rsdeblur.errors import InputError
from rsdeblur.estimate.motion_evidence import MOST_TILES
from rsdeblur.estimate.noise import halved
from rsdeblur.types import FloatImage

Figures = dict[str, tuple[float | None, ...]]

# Equal parts, those in which the check measures ringing.
BANDS = MOST_TILES
# Rec. 709.
LUMA = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
# Percentile of the gradient's magnitude that measures edges. In pure noise it is 2.6 times the median (Rayleigh's
# distribution); a band of the input in which it is less than about twice that, `EDGES` times the median, has no edges.
STEEP = 99.0
EDGES = 5.0


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
        For each picture, the ringing that the check measured, in percent of the picture's contrast; None without a
        check.
    """

    edges: tuple[int, ...]
    sharpness: Figures
    ringing: Figures


def band_figures(
    pictures: Mapping[str, NDArray[np.floating]],
    ringings: Mapping[str, Sequence[float]],
    *,
    across: bool = False,
) -> BandFigures:
    """Measure the sharpness of each picture in equal bands, and list the ringing beside it.

    Sharpness is measured at half the size, where most of the noise of single pixels is averaged out: the steepness of
    edges is the gradient that one pixel in a hundred exceeds. Ringing beside edges makes them steeper; so read both
    figures together.

    Parameters
    ----------
    pictures : mapping of str to ndarray
        Display values in [0, 1], (H, W) or (H, W, C), all of one size; the first picture is the blurred one.
    ringings : mapping of str to sequence of float
        For each checked picture, :attr:`rsdeblur.estimate.QualityCheck.ringings`.
    across : bool, default False
        Whether bands are columns instead of rows, as for a horizontal readout.

    Returns
    -------
    BandFigures
        Six bands.

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
    edges = np.linspace(0, len(next(iter(greys.values()))), BANDS + 1).round().astype(int).tolist()
    halves = {label: halved(grey[..., None])[..., 0] for label, grey in greys.items()}
    parts = [slice(first // 2, max(last // 2, 1)) for first, last in pairwise(edges)]
    ringing: Figures = dict.fromkeys(pictures, (None,) * BANDS)
    ringing |= {label: tuple(100.0 * part for part in parts) for label, parts in ringings.items()}
    return BandFigures(tuple(edges), _sharpness(halves, parts), ringing)


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
