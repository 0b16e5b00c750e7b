"""Tiling of one axis of the picture: overlapping tiles, how their ends meet, and the weights that blend their results.

Results are interpolated linearly between the tile centres. At a distance x from its centre a tile's PSF is wrong by an
amount that grows like x with a sign, so with linear weights the first-order errors of two neighbours cancel:
`(1 - w) (w e) + w (-(1 - w) e) = 0`. Smoother windows lack this property.

A discrete Fourier transform repeats its input, so a step from the last row to the first would ring through the result.
As in Sindelar and Sroubek (2013), opposite ends are blended over the PSF's width. The picture itself does not change:
it is continued by reflection, and only the continuation fades from one end into the other. `rsdeblur.kernels.lines`
does this while it moves data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsdeblur.deconv.fft import fast_length
from rsdeblur.errors import InputError
from rsdeblur.types import FloatArray

# Share by which a transform may be longer than needed, so that FFTW is fast. Along both whole axes this adds at most
# 8 % of pixels. Bands are short and overlap anyway. Strips do, too, but each frequency of their rows is a column on
# which all bands are filtered.
WHOLE_EXCESS = 0.038
BAND_EXCESS = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class Tile:
    """One tile along an axis: the positions that it reads, and those that it contributes to."""

    start: int  # first position read; may be negative: the border continues the picture there
    first: int  # first position that the tile contributes to
    weights: NDArray[np.float32]  # of the tile from there on, positive


@dataclass(frozen=True, slots=True, eq=False)
class Tiling:
    """All tiles of one axis, by position; they share one transform length."""

    length: int  # px
    taper: int  # positions at the end of each tile that fade into those before its start
    tiles: tuple[Tile, ...]

    @classmethod
    def plan(
        cls,
        centres: FloatArray,
        n: int,
        kernel: int,
        margin: int,
        *,
        periodic: bool,
        excess: float = WHOLE_EXCESS,
    ) -> Tiling:
        """Cut an axis of `n` px into tiles, of which each PSF holds at one of the `centres` (B,), px.

        A single tile spans the whole axis, and so do all tiles if they would be no shorter.

        - A tile of the whole axis is longer than it by the size `kernel` of the PSFs, px, unless the picture is
          periodic.
        - Any other tile is longer by `margin` px than the part that it contributes.
        - `excess` is the share by which the transforms of several tiles may be longer than needed.

        `InputError` is raised if two centres are less than a pixel apart, or one is outside the picture.
        """
        weights = hat_weights(centres, n)
        supports = [np.flatnonzero(row) for row in weights]
        if not all(map(len, supports)):
            raise InputError(
                f"PSF positions must lie within the picture's {n} px, a pixel or more apart, got {len(centres)} from "
                f"{centres[0]:g} to {centres[-1]:g} px"
            )
        whole = n if periodic else fast_length(n + kernel, excess=WHOLE_EXCESS)
        longest = max(len(support) for support in supports)
        # A margin may be larger than any picture; fast_length would search as far.
        length = whole if longest + margin >= whole else fast_length(longest + margin, excess=excess)
        if len(centres) == 1 or length >= whole:
            length, longest, starts = whole, n, [0] * len(centres)
        else:
            starts = [int(s[0]) - (longest - len(s)) // 2 for s in supports]
        parts = (w[s[0] : s[-1] + 1].astype(np.float32) for w, s in zip(weights, supports, strict=True))
        tiles = zip(starts, (int(s[0]) for s in supports), parts, strict=True)
        return cls(length, length - longest, tuple(Tile(*each) for each in tiles))


def fade(n: int) -> NDArray[np.float32]:
    """Return a smooth ramp of `n` values strictly between 0 and 1.

    At the end of a tile it is the weight of the pixels that precede the tile.
    """
    ramp: NDArray[np.float32] = (0.5 - 0.5 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))).astype(np.float32)
    return ramp


def hat_weights(centres: FloatArray, n: int) -> FloatArray:
    """Return weights (B, n) of linear interpolation between `centres` (B,) at positions 0 to n - 1.

    They are constant beyond the outer centres, and each column sums to 1.
    """
    positions = np.arange(n)
    return np.stack([np.interp(positions, centres, unit) for unit in np.eye(len(centres))])
